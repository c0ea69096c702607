"""The simulation in this process, its drones over MAVLink: missions compare with runs without.

Each drone is a vehicle on `pymavlink` whose motion is that of the simulated asset. What it is
commanded over MAVLink, the asset gets as its command. Cameras and what drones see come over the
links as they do in the simulation, as MAVLink has no words for them.
"""

import math
import queue
import tempfile
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from pa_console.fleets.link import DeviceAnswer, LinkNews
from pa_console.fleets.linked_fleet import LinkedFleet
from pa_console.fleets.mavlink.link import MavlinkLink, open_link
from pa_console.fleets.reports import AssetReport, SensorReport
from pa_console.schema.base import Point
from pa_console.schema.command import DeviceCommand, Verb
from pa_console.schema.incident import Incident
from pa_console.schema.telemetry import AssetTelemetry
from pa_console.settings.schema import Settings
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.terrain import Terrain
from tests.fleets.mavlink.drones import free_port, on_the_earth, vehicles_file
from tests.fleets.mavlink.scripted import GEOGRAPHY
from tests.fleets.mavlink.vehicles import Flock, Vehicle
from tests.fleets.scripted_link import EPOCH
from tests.fleets.simulated_link import SimulatedLink

RATE = 4.0
"""Simulated seconds a second: the radio between is a real one."""

PERIOD_S = 0.02
REMEMBERED = 200
SAME_M = 0.05
"""Degrees on the wire are rounded to a centimetre."""

READY_S = 60.0
FLIES_M = 20.0


class SimulatedDrone(Vehicle):
    """A MAVLink vehicle that is where its asset is; `orders` gets what it is commanded."""

    def __init__(
        self, system: int, name: str, terrain: Terrain, orders: "queue.SimpleQueue[DeviceCommand]"
    ) -> None:
        base = terrain.world.frames[terrain.world.base].at
        super().__init__(system, GEOGRAPHY.degrees(base), armed=True, height=FLIES_M)
        self.name, self.terrain, self.orders, self.number = name, terrain, orders, 0
        self.goal: Point | None = None
        """The place that it was sent to: a simulated asset chooses one at a frame by itself."""

    def show(self, said: AssetTelemetry, *, silent: bool) -> None:
        """Take over the place and the condition of the asset."""
        self.down = silent
        self.at = GEOGRAPHY.degrees(said.position)
        course = math.radians(GEOGRAPHY.course(said.heading_deg))
        self.velocity = (
            said.speed_mps * math.cos(course), said.speed_mps * math.sin(course), 0.0
        )  # fmt: skip
        self.heading = math.degrees(course) % 360.0
        self.battery = math.ceil(said.battery_pct)
        self.state = 6 if said.status == "failed" else 4
        if self.mode == "RTL" and said.task == "charging":
            self.height, self.armed, self.mode = 0.0, False, "HOLD"

    def fly(self, dt: float) -> None:
        """Climb at once; the simulation moves the asset."""
        if self.armed:
            self.height = self.target_height or self.height

    def did(self, number: int, message: Any) -> None:
        """Pass a command that was carried out on to the asset."""
        match number:
            case 192:
                verb: Verb = "observe" if self.region is not None else "move_to"
                self._order(verb, message.x, message.y)
            case 300:
                looks = any(item.command == 195 for item in self.mission)
                self.target_height = self.mission[-1].z
                self._order(
                    "observe" if looks else "move_to", self.mission[-1].x, self.mission[-1].y
                )
            case 20:
                self._give("return_to_base", None)
            case 176 if self.mode == "HOLD":
                self._give("hold", None)
            case _:
                pass

    def _order(self, verb: Verb, x: int, y: int) -> None:
        self.goal = GEOGRAPHY.metres(x / 1e7, y / 1e7)
        self._give(verb, self.terrain.frame_at(*self.goal))

    def _give(self, verb: Verb, target: str | None) -> None:
        self.number += 1
        name = f"{self.name}.{self.number}"
        self.orders.put(DeviceCommand(command_id=name, agent=self.name, verb=verb, target=target))


class GroundLink(SimulatedLink):
    """Connects everything of the simulation but the drones, and moves it on at RATE."""

    name = "simulated:ground"

    def __init__(
        self,
        checkpoint: Checkpoint,
        drones: Sequence[SimulatedDrone],
        orders: "queue.SimpleQueue[DeviceCommand]",
    ) -> None:
        super().__init__(checkpoint)
        self.drones, self._orders = {drone.name: drone for drone in drones}, orders
        self.agents = frozenset(checkpoint.world.assets) - self.drones.keys()
        self.seen: list[SensorReport] = []
        self._was: dict[str, deque[tuple[int, Point]]] = {
            name: deque(maxlen=REMEMBERED) for name in self.drones
        }
        self._due = time.monotonic()
        self.show()

    def take(self) -> Sequence[LinkNews]:
        """Let the assets have what came over MAVLink, step, and return what is not of drones."""
        if self._begun:
            self._due = max(self._due + self.checkpoint.world.dt_s / RATE, time.monotonic() - 0.1)
            time.sleep(max(0.0, self._due - time.monotonic()))
            while not self._orders.empty():
                self.checkpoint.send(self._orders.get())
        news = super().take()
        self.show()
        own: list[LinkNews] = []
        for each in news:
            match each:
                case SensorReport() if each.sensor in self.drones:
                    self.seen.append(each)
                case AssetReport() | DeviceAnswer() if each.agent in self.drones:
                    pass
                case _:
                    own.append(each)
        return own

    def show(self) -> None:
        """Put the drones where their assets are."""
        truth, known = self.checkpoint.truth().assets, self.checkpoint.picture().assets
        for name, drone in self.drones.items():
            asset = self.checkpoint._scene.assets[name]  # pyright: ignore[reportPrivateUsage]
            if drone.goal is not None and asset.route and asset.task == "moving":
                asset.station, asset.route = drone.goal, (*asset.route[:-1], drone.goal)
                drone.goal = None
            drone.show(truth[name], silent=known[name].comms == "lost")
            self._was[name].append((self.checkpoint.tick, truth[name].position))

    def sent(self, report: AssetReport) -> datetime:
        """Return when the drone of a report was there last, on the simulation's clock."""
        was = reversed(self._was[report.agent])
        near = (tick for tick, at in was if math.dist(at, report.position) < SAME_M)
        return self._at(next(near, self.checkpoint.tick))


class DroneLink:
    """The link under test, on the simulation's clock, with what the drones see."""

    def __init__(self, link: MavlinkLink, ground: GroundLink) -> None:
        self.link, self._ground = link, ground
        self.name, self.agents = link.name, link.agents

    @property
    def problem(self) -> str:
        """The reason why there is no connection."""
        return self.link.problem

    def send(self, command: DeviceCommand) -> None:
        """Send a command over MAVLink."""
        self.link.send(command)

    def take(self) -> Sequence[LinkNews]:
        """Return what came over MAVLink, and what the drones see."""
        seen, self._ground.seen = self._ground.seen, []
        return [*(self._timed(news) for news in self.link.take()), *seen]

    def wait(self, seconds: float) -> bool:
        """Wait for news."""
        return self.link.wait(seconds)

    def close(self) -> None:
        """End the connection."""
        self.link.close()

    def _timed(self, news: LinkNews) -> LinkNews:
        """Return a report with its time on the simulation's clock."""
        if not isinstance(news, AssetReport):
            return news
        return replace(news, sent=self._ground.sent(news))


class DronesOverMavlink(LinkedFleet):
    """A fleet of which the drones are on MAVLink; incidents can be made to happen."""

    def __init__(self, checkpoint: Checkpoint) -> None:
        self.checkpoint, world = checkpoint, checkpoint.world
        names = [name for name, spec in world.assets.items() if spec.kind == "uav"]
        terrain, port = Terrain.of(world), free_port()
        orders: queue.SimpleQueue[DeviceCommand] = queue.SimpleQueue()
        drones = [SimulatedDrone(n, name, terrain, orders) for n, name in enumerate(names, 1)]
        self.ground = GroundLink(checkpoint, drones, orders)
        self.flock = Flock(f"127.0.0.1:{port}", [*drones], period_s=PERIOD_S)
        self._flying = threading.Thread(target=self.flock.run, daemon=True)
        self._flying.start()
        with tempfile.TemporaryDirectory() as folder:
            file = vehicles_file(Path(folder), world, names)
            self.mavlink = open_link(
                f"udpin://127.0.0.1:{port}#{file}", on_the_earth(world), Settings()
            )
        self._await_fences(names)
        super().__init__(
            world,
            [self.ground, DroneLink(self.mavlink, self.ground)],
            now=lambda: EPOCH + timedelta(seconds=checkpoint.tick * world.dt_s),
        )
        self._begin()

    def _await_fences(self, names: Sequence[str]) -> None:
        """Wait until every drone has its fence and reports; raises TimeoutError."""
        until, news = time.monotonic() + READY_S, list[LinkNews]()
        while time.monotonic() < until:
            self.mavlink.wait(0.1)
            news += self.mavlink.take()
            fenced = sum("read back" in getattr(each, "text", "") for each in news)
            shown = {each.agent for each in news if isinstance(each, AssetReport)}
            if fenced >= len(names) and len(shown) == len(names):
                return
        raise TimeoutError(str([n for n in news if not isinstance(n, AssetReport)]))

    def _begin(self) -> None:
        """Show where everything is at the beginning."""
        self._reported.begin(0)
        self.ground.begin_again()
        self.ground.show()
        time.sleep(0.2)
        self.mavlink.take()
        shown: set[str] = set()
        silent = {name for name, drone in self.ground.drones.items() if drone.down}
        until = time.monotonic() + READY_S
        while shown | silent < self.ground.drones.keys() and time.monotonic() < until:
            self.mavlink.wait(0.1)
            news = self.mavlink.take()
            shown |= {each.agent for each in news if isinstance(each, AssetReport)}
            self.mavlink._news.extend(news)  # pyright: ignore[reportPrivateUsage]
            if shown | silent < self.ground.drones.keys():
                time.sleep(0.05)
        self._take_news()
        self._show()

    @property
    def seed(self) -> int:
        """The seed of the checkpoint's random draws."""
        return self.checkpoint.seed

    def inject(self, incident: Incident) -> None:
        """Make `incident` happen now; raises ValueError for an unknown name."""
        self.checkpoint.inject(incident)
        if self.tick == 0:
            self._begin()

    def close(self) -> None:
        """End the links and the vehicles."""
        super().close()
        self.flock.stopped.set()
        self._flying.join()
