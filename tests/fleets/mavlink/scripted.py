"""One flight with an autopilot that does as a test says, on a clock that a test turns."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any

from pa_console.fleets.link import DeviceAnswer, LinkNews, LinkNotice
from pa_console.fleets.mavlink.commands import Cmd, Kind, MavCommand, MavItem, e7
from pa_console.fleets.mavlink.flight import Flight
from pa_console.fleets.mavlink.geofence import fence_of
from pa_console.fleets.mavlink.vehicles_file import MavlinkVehicles
from pa_console.fleets.reports import AssetReport
from pa_console.schema.base import Point
from pa_console.schema.command import DeviceCommand, Verb
from pa_console.schema.world import Origin, World
from pa_console.sim.worlds.geography import Geography
from pa_console.sim.worlds.terrain import Terrain

AGENT = "Drone_T01"
ORIGIN = Origin(latitude=2.0, longitude=-30.0, bearing=20.0)
GEOGRAPHY = Geography(ORIGIN)
ACCEPTED, IN_PROGRESS, DENIED = 0, 5, 2


def vehicles(**more: Any) -> MavlinkVehicles:
    """Return the file of one drone."""
    return MavlinkVehicles.model_validate({"vehicles": {AGENT: {"system_id": 1}}, **more})


@dataclass
class ScriptedAutopilot:
    """Notes what it is asked for; a test gives the answers."""

    kind: Kind = "px4"
    sent: list[MavCommand] = field(default_factory=list[MavCommand])
    holds: int = 0
    fence: tuple[MavItem, ...] = ()
    missions: list[tuple[MavItem, ...]] = field(default_factory=list[tuple[MavItem, ...]])
    cancelled: int = 0
    fence_reads: int = 0
    fence_uploads: int = 0
    enforcements: int = 0
    asked_again: int = 0

    def send(self, command: MavCommand, times: int) -> None:
        """Note a command."""
        self.sent.append(command)

    def ask_again(self) -> None:
        """Count a request for all messages."""
        self.asked_again += 1

    def hold(self) -> None:
        """Count a hold."""
        self.holds += 1

    def upload_mission(self, items: Sequence[MavItem]) -> None:
        """Keep a mission."""
        self.missions.append(tuple(items))

    def cancel_upload(self) -> None:
        """Count a cancelled upload."""
        self.cancelled += 1

    def upload_fence(self, items: Sequence[MavItem]) -> None:
        """Keep a fence."""
        self.fence_uploads += 1
        self.fence = tuple(items)

    def read_fence(self) -> None:
        """Count a read."""
        self.fence_reads += 1

    def enforce_fence(self) -> None:
        """Count a request to act on the fence."""
        self.enforcements += 1

    def asked(self) -> list[Cmd]:
        """Return the commands that were sent, in order."""
        return [command.command for command in self.sent]


class Rig:
    """A flight, its autopilot and its clock; the drone begins in the air at the checkpoint."""

    def __init__(
        self, world: World, *, flies: bool = True, kind: Kind = "px4", **settings: Any
    ) -> None:
        self.world = world
        self.now_s = 1000.0
        self.autopilot = ScriptedAutopilot(kind)
        self.news: list[LinkNews] = []
        self.flight = Flight(
            AGENT,
            self.autopilot,
            terrain=Terrain(world),
            geography=GEOGRAPHY,
            vehicles=vehicles(**settings),
            tell=self.news.append,
            now=lambda: self.now_s,
        )
        self.at: Point = (0.0, 0.0)
        self.height = 20.0 if flies else 0.0
        self.flight.heartbeat(1 | (128 if flies else 0), 4)
        self.flight.mode_changed("HOLD")
        self.flight.state.on_ground = not flies
        self.flight.state.battery_pct = 80.0

    def ready(self) -> "Rig":
        """Let the drone report where it is, and that its fence is the world's."""
        self.report()
        self.flight.step()
        self.read_fence()
        return self

    def read_fence(self, items: Sequence[MavItem] | None = None) -> None:
        """Answer that a fence was read, by default the world's; it is acted on."""
        areas = fence_of(self.world, GEOGRAPHY)
        own = tuple(item for area in areas for item in area.items)
        asked = self.autopilot.enforcements
        self.flight.fence_read("", own if items is None else items)
        if self.autopilot.enforcements > asked:
            self.flight.fence.enforced("")

    def report(
        self, at: Point | None = None, height: float | None = None, speed: float = 0.0
    ) -> None:
        """Let the drone report its position now."""
        self.at = at or self.at
        self.height = self.height if height is None else height
        self.flight.positioned(self.message(speed), self.arrival())

    def message(self, speed: float = 0.0) -> dict[str, Any]:
        """Return where the drone is as a GLOBAL_POSITION_INT."""
        latitude, longitude = GEOGRAPHY.degrees(self.at)
        return {
            "lat": e7(latitude), "lon": e7(longitude), "time_boot_ms": int(self.now_s * 1e3),
            "alt": int((self.height + 100.0) * 1e3), "relative_alt": int(self.height * 1e3),
            "vx": int(speed * 100), "vy": 0, "vz": 0, "hdg": 9000,
        }  # fmt: skip

    def arrival(self) -> datetime:
        """Return a time of arrival later than any real one so far."""
        return datetime.now(UTC) + timedelta(seconds=1.0)

    def wait(self, seconds: float, step_s: float = 0.2, *, reports: bool = True) -> None:
        """Let time pass; the drone reports where it is meanwhile."""
        for _ in range(round(seconds / step_s)):
            self.now_s += step_s
            if reports:
                self.report()
            self.flight.step()

    def order(self, name: str, verb: Verb, target: str | None = None) -> None:
        """Give the drone a command."""
        self.flight.take(DeviceCommand(command_id=name, agent=AGENT, verb=verb, target=target))

    def answer(self, command: Cmd, result: int = ACCEPTED) -> None:
        """Answer a command, as a COMMAND_ACK does."""
        self.flight.acknowledged(int(command), result)

    def answers(self, name: str) -> list[str]:
        """Return the statuses that a command got."""
        return [n.status for n in self.news if isinstance(n, DeviceAnswer) and n.command_id == name]

    def detail(self, name: str) -> str:
        """Return the detail of the last answer to a command."""
        said = [n for n in self.news if isinstance(n, DeviceAnswer) and n.command_id == name]
        return said[-1].detail if said else ""

    def notices(self) -> list[str]:
        """Return what the operator was told."""
        return [n.text for n in self.news if isinstance(n, LinkNotice)]

    def last(self) -> AssetReport:
        """Return the latest report."""
        return next(n for n in reversed(self.news) if isinstance(n, AssetReport))

    def target(self) -> Point:
        """Return the place of the reposition that was sent last."""
        command = next(c for c in reversed(self.autopilot.sent) if c.command == Cmd.REPOSITION)
        assert command.place is not None
        return GEOGRAPHY.metres(*command.place)
