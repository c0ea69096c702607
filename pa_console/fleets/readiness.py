"""The messages that a link needs from a robot, and the reasons why the robot cannot start yet."""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from pa_console.fleets.link import LinkFinding, LinkNews, NotReady

KEPT = 64
"""The number of arrivals of a message from which its rate is computed."""

PATIENCE_S = 15.0


@dataclass(frozen=True)
class NeededMessage:
    """One message of a robot; `lacking` is the consequence of its absence."""

    name: str
    period_s: float
    """The longest time between two of them, 0 for one that is sent once."""
    lacking: str
    number: int = 0
    """Its number in a protocol that has numbers."""
    patience_s: float = PATIENCE_S
    """The silence after which it counts as missing, seconds."""
    source: str = ""
    """The node or the parameter that brings it."""

    @property
    def wanted(self) -> str:
        """How often it should come, and from where."""
        often = f"every {self.period_s:g} s" if self.period_s else "once"
        return f"{often}, from {self.source}" if self.source else often


@dataclass
class MessageWatch:
    """Counts one robot's messages; times are those of a monotonic clock, seconds."""

    needed: Sequence[NeededMessage]
    began_s: float
    _heard: dict[str, deque[float]] = field(default_factory=dict[str, deque[float]])

    def heard(self, name: str, now_s: float) -> None:
        """Count a message."""
        self._heard.setdefault(name, deque(maxlen=KEPT)).append(now_s)

    def missing(self, now_s: float) -> list[NeededMessage]:
        """Return the messages that do not come."""
        return [
            needed
            for needed in self.needed
            if now_s - max(self.last_s(needed.name), self.began_s) > needed.patience_s
            and (needed.period_s or not self.count(needed.name))
        ]

    def count(self, name: str) -> int:
        """Return how many of a message have come lately."""
        return len(self._heard.get(name, ()))

    def rate_hz(self, name: str, now_s: float) -> float:
        """Return how often a message has come lately, 0 if it did not."""
        times = self._heard.get(name, ())
        if len(times) < 2:
            return 0.0
        return (len(times) - 1) / max(now_s - times[0], 1e-3)

    def last_s(self, name: str) -> float:
        """Return when a message has come last, long ago if it never has."""
        times = self._heard.get(name)
        return times[-1] if times else -1e9

    def findings(self, agent: str, now_s: float) -> list[LinkFinding]:
        """Return how often each needed message comes, and what lacks without it."""
        findings: list[LinkFinding] = []
        for needed in self.needed:
            count, rate = self.count(needed.name), self.rate_hz(needed.name, now_s)
            found = f"{rate:.1f} a second" if rate else f"{count} so far" if count else "never"
            finding = LinkFinding(agent, needed.name, found)
            findings.append(finding.unless(count, needed.wanted, needed.lacking))
        return findings


@dataclass
class Readiness:
    """Reports why the asset `agent` cannot start yet, whenever that changes."""

    agent: str
    tell: Callable[[LinkNews], object]
    why: str = ""
    """The reasons, '' if it can start."""

    def note(self, reasons: Iterable[str]) -> None:
        """Take in the reasons as they are now."""
        why = "; ".join(reasons)
        if why != self.why:
            self.why = why
            self.tell(NotReady(self.agent, why))

    @property
    def finding(self) -> LinkFinding:
        """Whether it can start, as `doctor` shows it."""
        finding = LinkFinding(self.agent, "ready", f"no: {self.why}" if self.why else "yes")
        return finding.unless(not self.why, "", "it starts nothing")
