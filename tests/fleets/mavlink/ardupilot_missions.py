"""`python -m tests.fleets.mavlink.ardupilot_missions`: the paper's missions with real ArduPilots.

Every UAV is a copter and every UGV a rover; robots, cameras and contacts are simulated in the same
session. An asset of the simulation is where its vehicle is, so that it sees and blocks from there.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from tempfile import TemporaryDirectory

from pa_console.evaluation.jobs import Job
from pa_console.fleets.link import DeviceAnswer, LinkNews
from pa_console.fleets.linked_fleet import LinkedFleet
from pa_console.fleets.mavlink.link import MavlinkLink, open_link
from pa_console.fleets.reports import AssetReport
from pa_console.schema.command import DeviceCommand
from pa_console.schema.incident import FailAsset, Incident, PlaceAsset
from pa_console.settings.schema import Settings
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.terrain import Terrain
from tests.fleets.mavlink.drones import Driven, on_the_earth
from tests.fleets.mavlink.scripted import GEOGRAPHY
from tests.fleets.mavlink.sitl import PARAMETERS, Frame, Sitl, vehicles_yaml
from tests.fleets.paper_missions import main
from tests.fleets.scripted_link import EPOCH
from tests.fleets.simulated_link import SimulatedLink

BOOT_SPEEDUP = 6.0
READY_S = 120.0
HEIGHTS = "altitude_m: 8\naltitudes_m: {observe: 10}"
FRAMES: Mapping[str, Frame] = {"uav": "copter", "ugv": "rover"}


class Ground(SimulatedLink):
    """Connects everything of the simulation but the vehicles, in real time."""

    name = "simulated:ground"

    def __init__(self, checkpoint: Checkpoint, vehicles: Sequence[str]) -> None:
        super().__init__(checkpoint)
        self.vehicles = frozenset(vehicles)
        self.agents = frozenset(checkpoint.world.assets) - self.vehicles
        self.seen: list[LinkNews] = []
        self._due = time.monotonic()

    def take(self) -> Sequence[LinkNews]:
        """Step when it is due, and return what is not of the vehicles."""
        if self._begun:
            self._due = max(self._due + self.checkpoint.world.dt_s, time.monotonic() - 0.1)
            time.sleep(max(0.0, self._due - time.monotonic()))
        own: list[LinkNews] = []
        for each in super().take():
            if getattr(each, "sensor", "") in self.vehicles:
                self.seen.append(each)
            elif getattr(each, "agent", "") not in self.vehicles:
                own.append(each)
        return own

    def show(self, report: AssetReport) -> None:
        """Put the asset of the simulation where its vehicle is."""
        asset = self.checkpoint._scene.assets[report.agent]  # pyright: ignore[reportPrivateUsage]
        asset.x, asset.y = asset.station = report.position
        asset.route, asset.heading, asset.speed = (), report.heading_deg, report.speed_mps
        asset.task, asset.last_telemetry = report.task, None
        asset.post = Terrain.of(self.checkpoint.world).frame_at(*report.position)


class Air:
    """The link under test, on the simulation's clock, with what the vehicles see."""

    def __init__(self, link: MavlinkLink, ground: Ground) -> None:
        self.link, self._ground = link, ground
        self.name, self.agents = link.name, link.agents
        self._latest: dict[str, AssetReport] = {}
        self.failed: set[str] = set()
        """The vehicles that have reported a failure: their autopilots are mute."""

    @property
    def problem(self) -> str:
        """The reason why there is no connection."""
        return self.link.problem

    def send(self, command: DeviceCommand) -> None:
        """Send a command over MAVLink."""
        print(f"   {command.agent} {command.verb} {command.target or ''}", flush=True)
        self.link.send(command)

    def take(self) -> Sequence[LinkNews]:
        """Return what came over MAVLink, and what the vehicles see."""
        seen, self._ground.seen = self._ground.seen, []
        checkpoint = self._ground.checkpoint
        now = EPOCH + timedelta(seconds=checkpoint.tick * checkpoint.world.dt_s)
        news: list[LinkNews] = []
        came = self.link.take()
        reports = {each.agent: each for each in came if isinstance(each, AssetReport)}
        self._latest |= reports
        if not checkpoint.tick:  # the simulation waits: what is known holds at its first moment
            reports = self._latest
        for report in reports.values():
            self._ground.show(report)
            age = max(datetime.now(UTC) - report.sent, timedelta())
            sent = now - age if checkpoint.tick else now
            status = "failed" if report.agent in self.failed else report.status
            news.append(replace(report, sent=sent, status=status))
        for each in came:
            if not isinstance(each, AssetReport):
                if isinstance(each, DeviceAnswer) and each.status not in ("progress", "done"):
                    print(f"   {each.agent}: {each.status} {each.detail}", flush=True)
                news.append(each)
        return [*news, *seen]

    def wait(self, seconds: float) -> bool:
        """Wait for news."""
        return self.link.wait(seconds)

    def close(self) -> None:
        """End the connection."""
        self.link.close()


class RealVehicles(LinkedFleet):
    """A fleet whose UAVs and UGVs are real autopilots, put where the mission has them."""

    def __init__(self, checkpoint: Checkpoint, placed: Mapping[str, str]) -> None:
        self.checkpoint, world = checkpoint, checkpoint.world
        self._folder = TemporaryDirectory()
        folder, there, terrain = Path(self._folder.name), on_the_earth(world), Terrain.of(world)
        names = [name for name, spec in world.assets.items() if spec.kind in FRAMES]
        truth = checkpoint.truth().assets
        self.sitls: dict[str, Sitl] = {}
        taken = [truth[name].position for name in names]
        for system, name in enumerate(names, 1):
            kind, at = world.assets[name].kind, truth[name].position
            if name in placed:
                free = terrain.free_place(placed[name], kind, taken)
                assert free is not None, name
                at = free
            more = {"speedup": BOOT_SPEEDUP, "parameters": PARAMETERS}
            self.sitls[name] = Sitl(folder, FRAMES[kind], system, at, **more)  # type: ignore[arg-type]
        file = folder / "vehicles.yaml"
        addresses = [each.address for each in self.sitls.values()]
        file.write_text(vehicles_yaml(world, addresses, names, HEIGHTS), encoding="utf-8")
        driven = Driven(open_link(str(file), there, Settings()))
        home = GEOGRAPHY.degrees(world.frames[world.base].at)
        driven.until(
            lambda: driven.fenced(len(names)) and not any(driven.not_ready.values()), READY_S
        )
        for each in self.sitls.values():
            other = each.other_station()
            other.set_home(home)
            other.set_parameter("SIM_SPEEDUP", 1.0)
            other.close()
        self._ground = Ground(checkpoint, names)
        self._air = Air(driven.link, self._ground)
        super().__init__(
            world,
            [self._ground, self._air],
            now=lambda: EPOCH + timedelta(seconds=checkpoint.tick * world.dt_s),
        )
        self._begin()

    def _begin(self) -> None:
        """Show where everything is at the beginning."""
        self._reported.begin(0)
        self._ground.begin_again()
        time.sleep(1.0)
        self._take_news()
        self._show()

    @property
    def seed(self) -> int:
        """The seed of the checkpoint's random draws."""
        return self.checkpoint.seed

    def inject(self, incident: Incident) -> None:
        """Make `incident` happen now; a vehicle that fails loses its autopilot."""
        real = getattr(incident, "asset", "") in self.sitls
        if isinstance(incident, FailAsset) and real:
            self.sitls[incident.asset].kill()
            self._air.failed.add(incident.asset)
        if not (isinstance(incident, PlaceAsset) and real):  # it stands there already
            self.checkpoint.inject(incident)
        if self.tick == 0:
            self._begin()

    def close(self) -> None:
        """End the links and the autopilots."""
        super().close()
        for each in self.sitls.values():
            each.kill()
        self._folder.cleanup()


def fleet_of(job: Job, checkpoint: Checkpoint) -> RealVehicles:
    """Return the vehicles of a mission, where it has them."""
    placed = {i.asset: i.frame for i in job.case.setup if isinstance(i, PlaceAsset)}
    return RealVehicles(checkpoint, placed)


if __name__ == "__main__":
    main(__doc__, fleet_of)
