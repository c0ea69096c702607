"""A link to the simulation in this process, so that runs over links compare with runs without."""

import math
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime, timedelta

from pa_console.fleets.link import DeviceAnswer, LinkNews
from pa_console.fleets.linked_fleet import LinkedFleet
from pa_console.fleets.reports import AssetReport, ContactReport, SensorReport
from pa_console.schema.base import Point
from pa_console.schema.command import DeviceCommand
from pa_console.schema.incident import Incident, PlaceAsset
from pa_console.schema.telemetry import AssetTelemetry
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.sensing_state import Detection
from tests.fleets.scripted_link import EPOCH

ALL = "simulated:all"


class SimulatedLink:
    """Connects every asset of `checkpoint`; each `take` but the first moves it on by a step."""

    name, problem = ALL, ""

    def __init__(self, checkpoint: Checkpoint) -> None:
        self.checkpoint = checkpoint
        self.agents = frozenset(checkpoint.world.assets)
        self._own_ids: dict[str, str] = {}
        self._begun = False

    def send(self, command: DeviceCommand) -> None:
        """Put a command on the simulated radio, under the id that a run without links has."""
        own_id = command.command_id.partition(".")[2]
        self._own_ids[own_id] = command.command_id
        self.checkpoint.send(command.model_copy(update={"command_id": own_id}))

    def take(self) -> Sequence[LinkNews]:
        """Return the state at the beginning; then what arrives in the next step."""
        if not self._begun:
            self._begun = True
            return [
                self._report(said, self.checkpoint.tick)
                for said in self.checkpoint.picture().assets.values()
                if said.comms != "lost"
            ]
        return list(self._step())

    def wait(self, seconds: float) -> bool:
        """Return at once: something comes in at each step."""
        return True

    def close(self) -> None:
        """Do nothing."""

    def begin_again(self) -> None:
        """Let the next `take` return the state at the beginning, as after a set-up."""
        self._begun = False

    def _step(self) -> Iterator[LinkNews]:
        replies = self.checkpoint.step()
        world, arrived, now = self.checkpoint.world, self.checkpoint.arrived, self.checkpoint.tick
        works = self.checkpoint.picture().cameras
        for name, spec in world.cameras.items() if arrived.wired is not None else ():
            team = self._team(spec.at, spec.sensor_range_m if works[name].works else -1.0)
            found = self._contacts((arrived.wired or {}).get(name, ()))
            yield SensorReport(name, self._at(now), found, team, works=works[name].works)
        for reply in replies:
            on_wire = self._own_ids.get(reply.command_id, reply.command_id)
            yield DeviceAnswer(on_wire, reply.agent, reply.status, reply.detail)
        for report in arrived.reports:
            yield self._seen(report.agent, report.stamp, report.detections)
            yield self._report(report.telemetry.telemetry(), report.stamp)

    def _seen(self, name: str, stamp: int, found: Sequence[Detection]) -> SensorReport:
        kind, at = self.checkpoint.world.assets[name].kind, self.checkpoint.truth().assets[name]
        sees = self.checkpoint.world.platforms[kind].sensor_range_m / 2 if kind == "uav" else -1.0
        team = self._team(at.position, sees)
        return SensorReport(name, self._at(stamp), self._contacts(found), team)

    def _report(self, said: AssetTelemetry, stamp: int) -> AssetReport:
        on_wire = self._own_ids.get(said.command_id) if said.command_id is not None else None
        return AssetReport(
            agent=said.id,
            sent=self._at(stamp),
            position=said.position,
            heading_deg=said.heading_deg,
            speed_mps=said.speed_mps,
            status=said.status,
            task=said.task,
            battery_pct=said.battery_pct,
            command_id=on_wire,
            route=said.route,
        )

    def _team(self, at: Point, within_m: float) -> Mapping[str, Point]:
        """Return the assets that a sensor at `at` recognises."""
        assets = self.checkpoint.truth().assets.items()
        return {n: a.position for n, a in assets if math.dist(at, a.position) <= within_m}

    def _contacts(self, found: Sequence[Detection]) -> list[ContactReport]:
        return [
            ContactReport(
                signature=detection.contact,
                kind=detection.kind,
                position=detection.position,
                sigma_m=detection.sigma_m,
                identity=detection.identity,
                opinion=detection.opinion,
                noncombatants=detection.noncombatants,
                emergency=detection.emergency,
                warned_s=None
                if detection.warned_tick is None
                else (self.checkpoint.tick - detection.warned_tick) * self.checkpoint.world.dt_s,
            )
            for detection in found
        ]

    def _at(self, tick: int) -> datetime:
        return EPOCH + timedelta(seconds=tick * self.checkpoint.world.dt_s)


class SimulatedLinkFleet(LinkedFleet):
    """A fleet on a link to `checkpoint` in which incidents can be made to happen."""

    def __init__(self, checkpoint: Checkpoint) -> None:
        self.checkpoint, self._over = checkpoint, SimulatedLink(checkpoint)
        self._tick, dt_s = 0, checkpoint.world.dt_s  # the clock is read before a step is simulated
        super().__init__(
            checkpoint.world,
            [self._over],
            now=lambda: EPOCH + timedelta(seconds=self._tick * dt_s),
        )

    @property
    def seed(self) -> int:
        """The seed of the checkpoint's random draws."""
        return self.checkpoint.seed

    def inject(self, incident: Incident) -> None:
        """Make `incident` happen now; raises ValueError for an unknown name."""
        self.checkpoint.inject(incident)
        if self.tick == 0:
            self._reported.begin(0)
            self._over.begin_again()
            self._take_news()
            self._show()
        elif isinstance(incident, PlaceAsset):
            self._reported.carried(incident.asset)
