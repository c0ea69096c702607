"""The messages that a link needs from a robot, and the reasons why the robot is not ready."""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from pa_console.fleets.link import LinkFinding, LinkNews, NotReady

KEPT = 64
"""The number of arrivals of a message from which its rate is computed."""

PATIENCE_S = 15.0
"""The default silence after which a message counts as missing, in seconds."""


@dataclass(frozen=True)
class NeededMessage:
    """One message that a robot must send."""

    name: str
    period_s: float
    """The longest time between two messages, in seconds; 0 if the message is sent only once."""
    lacking: str
    """The consequence if the message is missing."""
    number: int = 0
    """The number of the message, in a protocol that numbers messages."""
    patience_s: float = PATIENCE_S
    """The silence after which the message counts as missing, in seconds."""
    source: str = ""
    """The node that sends the message, or the parameter that enables it."""

    @property
    def wanted(self) -> str:
        """The expected period of the message and its source, in words."""
        often = f"every {self.period_s:g} s" if self.period_s else "once"
        return f"{often}, from {self.source}" if self.source else often


@dataclass
class MessageWatch:
    """The arrivals of one robot's messages; times are in seconds on a monotonic clock."""

    needed: Sequence[NeededMessage]
    began_s: float
    _heard: dict[str, deque[float]] = field(default_factory=dict[str, deque[float]])

    def heard(self, name: str, now_s: float) -> None:
        """Record the arrival of a message."""
        self._heard.setdefault(name, deque(maxlen=KEPT)).append(now_s)

    def missing(self, now_s: float) -> list[NeededMessage]:
        """Return the needed messages that are missing."""
        return [
            needed
            for needed in self.needed
            if now_s - max(self.last_s(needed.name), self.began_s) > needed.patience_s
            and (needed.period_s or not self.count(needed.name))
        ]

    def count(self, name: str) -> int:
        """Return the number of recorded arrivals of a message, at most KEPT."""
        return len(self._heard.get(name, ()))

    def rate_hz(self, name: str, now_s: float) -> float:
        """Return the rate of a message over its recorded arrivals; 0 for fewer than two."""
        times = self._heard.get(name, ())
        if len(times) < 2:
            return 0.0
        return (len(times) - 1) / max(now_s - times[0], 1e-3)

    def last_s(self, name: str) -> float:
        """Return the time of the last arrival of a message; a time long ago if there is none."""
        times = self._heard.get(name)
        return times[-1] if times else -1e9

    def findings(self, agent: str, now_s: float) -> list[LinkFinding]:
        """Return a finding for each needed message: its rate, and the consequence if missing."""
        findings: list[LinkFinding] = []
        for needed in self.needed:
            count, rate = self.count(needed.name), self.rate_hz(needed.name, now_s)
            arrivals = f"{rate:.1f} a second" if rate else f"{count} so far" if count else "never"
            finding = LinkFinding(agent, needed.name, arrivals)
            enough = count and not (needed.period_s and 0.0 < rate * needed.patience_s < 1.0)
            findings.append(finding.unless(enough, needed.wanted, needed.lacking))
        return findings


@dataclass
class Readiness:
    """The reasons why the asset `agent` cannot start yet; each change is passed to `tell`."""

    agent: str
    tell: Callable[[LinkNews], object]
    why: str = ""
    """The reasons; '' if the asset can start."""

    def note(self, reasons: Iterable[str]) -> None:
        """Set the current reasons, and report them if they have changed."""
        why = "; ".join(reasons)
        if why != self.why:
            self.why = why
            self.tell(NotReady(self.agent, why))


def readiness_finding(agent: str, why: str) -> LinkFinding:
    """Return the finding about an asset's readiness; `why` is the reason if it is not ready."""
    finding = LinkFinding(agent, "ready", f"no: {why}" if why else "yes")
    return finding.unless(not why, "", "it cannot start")
