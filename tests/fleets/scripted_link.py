"""A link of which a test says what comes over it, and that keeps what is sent over it."""

from collections.abc import Iterable, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any

from pa_console.fleets.link import AssetReport, DeviceAnswer, LinkNews
from pa_console.fleets.linked_fleet import LinkedFleet
from pa_console.schema.command import DeviceCommand, ReplyStatus
from pa_console.schema.events.event import Noticed
from pa_console.schema.world import World

EPOCH = datetime(2026, 3, 1, 12, 0, tzinfo=UTC)


class ScriptedLink:
    """Connects `agents`, which do nothing of themselves."""

    def __init__(self, name: str, agents: Iterable[str]) -> None:
        self.name, self.agents, self.problem = name, frozenset(agents), ""
        self.sent: list[DeviceCommand] = []
        self.news: list[LinkNews] = []
        self.closed = False

    def send(self, command: DeviceCommand) -> None:
        """Keep a command."""
        self.sent.append(command)

    def take(self) -> Sequence[LinkNews]:
        """Return what the test has made come in."""
        taken, self.news = self.news, []
        return taken

    def wait(self, seconds: float) -> bool:
        """Return whether anything has come in."""
        return bool(self.news)

    def close(self) -> None:
        """Note the end."""
        self.closed = True

    def answer(self, status: ReplyStatus, detail: str = "", number: int = -1) -> None:
        """Let the asset of a command that was sent give an answer to it."""
        command = self.sent[number]
        self.news.append(DeviceAnswer(command.command_id, command.agent, status, detail))


class SteppedTime:
    """The assets' clock in a test: it goes with the fleet's steps."""

    def __init__(self, world: World) -> None:
        self._dt_s, self.steps = world.dt_s, 0

    def now(self) -> datetime:
        """Return the time (UTC)."""
        return EPOCH + timedelta(seconds=self.steps * self._dt_s)


class Desk:
    """A fleet on scripted links, stepped by a test."""

    def __init__(self, world: World, *links: ScriptedLink) -> None:
        self.world, self.links, self.time = world, links, SteppedTime(world)
        self.fleet = LinkedFleet(world, links, now=self.time.now)
        self.notices: list[Noticed] = []
        self.replies: list[tuple[str, str, str]] = []
        """The id, the status and the detail of each reply."""

    def go(self, steps: int = 1) -> None:
        """Let time pass."""
        for _ in range(steps):
            self.time.steps += 1
            received = self.fleet.step()
            self.notices += [told for told in received.told if isinstance(told, Noticed)]
            self.replies += [(r.command_id, r.status, r.detail) for r in received.replies]

    def report(self, agent: str, at: str, age_s: float = 0.0, **said: Any) -> AssetReport:
        """Return a report of an asset that stands at the frame `at`, sent `age_s` ago."""
        values: dict[str, Any] = {
            "agent": agent,
            "sent": self.time.now() - timedelta(seconds=age_s),
            "position": self.world.frames[at].at,
            "heading_deg": 0.0,
            "speed_mps": 0.0,
            "status": "ok",
            "task": "idle",
            "battery_pct": 80.0,
            **said,
        }
        return AssetReport(**values)

    def told(self, subject: str) -> list[str]:
        """Return the notices about a subject."""
        return [notice.text for notice in self.notices if notice.subject == subject]
