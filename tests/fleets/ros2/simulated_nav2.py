"""A simulated checkpoint whose assets are robots with Nav2, to compare with runs in one process.

Everything between station and robots goes over Zenoh and TCP, in CDR. The robots' clock is the
simulation's: at each step the station waits until what was published has come.
"""

import math
import threading
from collections.abc import Iterator, Sequence
from datetime import timedelta
from pathlib import Path

import zenoh

from pa_console.fleets.link import LinkNews
from pa_console.fleets.linked_fleet import LinkedFleet
from pa_console.fleets.reports import SensorReport
from pa_console.fleets.ros2.connection import Ros2Address, read_site
from pa_console.fleets.ros2.link import Ros2Link, connect
from pa_console.fleets.ros2.messages import Planar
from pa_console.schema.command import COMMANDS, CommandReply, DeviceCommand
from pa_console.schema.incident import Incident, PlaceAsset
from pa_console.schema.telemetry import AssetTelemetry
from pa_console.sim.checkpoint import Checkpoint
from tests.fleets.ros2.counterpart import LIMIT_S, free_port
from tests.fleets.ros2.nav2_robot import Nav2Robot, router
from tests.fleets.scripted_link import EPOCH
from tests.fleets.simulated_link import SimulatedLink

LEVELS = {"ok": 0, "degraded": 1, "failed": 2}
TREES = [verb for verb, spec in COMMANDS.items() if spec.moves and verb != "move_to"]
AGAIN_S = 0.2
"""What has not come by then is sent again, seconds."""
MAP = Planar(5.0, -3.0, 0.3)
"""Where the world's origin is on the robots' map."""


class SimulatedBody:
    """An asset of a simulation, as it reports itself."""

    def __init__(self, checkpoint: Checkpoint, said: AssetTelemetry) -> None:
        self._checkpoint, self._name = checkpoint, said.id
        self.ordered, self._own_id, self._reply = "", "", None
        """`ordered` is the id of the command that the station sent last: the score goes by it."""
        self._reply: CommandReply | None
        self.show(said)

    def show(self, said: AssetTelemetry) -> None:
        """Go by a report of the asset."""
        at = MAP.then(Planar(*said.position, math.radians(said.heading_deg)))
        self.x, self.y, self.yaw, self.speed = at.x, at.y, at.yaw, said.speed_mps
        self.charge, self.level = said.battery_pct / 100.0, LEVELS[said.status]

    def go(self, x: float, y: float, tree: str) -> None:
        """Order the asset to the frame at a place."""
        frames = self._checkpoint.world.frames
        there = {name: MAP.then(Planar(*frame.at, 0.0))[:2] for name, frame in frames.items()}
        name = min(there, key=lambda each: math.dist(there[each], (x, y)))
        verb = tree.removesuffix(".xml") or "move_to"
        takes_frame = any(verb == known and spec.takes_frame for known, spec in COMMANDS.items())
        self._order(verb, name if takes_frame else None)

    def stop(self) -> None:
        """Order the asset to hold."""
        self._order("hold", None)

    def _order(self, verb: str, target: str | None) -> None:
        self._own_id, self._reply = self.ordered, None
        order = {"command_id": self._own_id, "agent": self._name, "verb": verb, "target": target}
        self._checkpoint.send(DeviceCommand.model_validate(order))

    def hear(self, reply: CommandReply) -> None:
        """Take in an answer of the asset."""
        if reply.command_id == self._own_id:
            self._reply = reply

    def step(self, dt_s: float) -> None:
        """Do nothing: the simulation moves the asset."""

    def arrived(self) -> bool:
        """Return whether the asset has done what it was ordered."""
        return self._reply is not None and self._reply.status == "done"

    def reason(self) -> str:
        """Return why the asset cannot do it."""
        reply = self._reply
        return (
            reply.detail or "no reason" if reply and reply.status in ("failed", "refused") else ""
        )


class Nav2Site(SimulatedLink):
    """The robots of a checkpoint and the console's link to them; each `take` moves them a step."""

    def __init__(self, checkpoint: Checkpoint, folder: Path, layout: str = "bridge") -> None:
        super().__init__(checkpoint)
        self._port, self._again = free_port(), 0
        self._server = router(self._port)
        said = checkpoint.picture().assets
        self.bodies = {name: SimulatedBody(checkpoint, each) for name, each in said.items()}
        self.robots = {
            name: Nav2Robot(
                self._server, name, body, layout=layout, release="kilted", clock=self._utc_s
            )
            for name, body in self.bodies.items()
        }
        self._session, self.link = self._connect(folder)
        self.name = self.link.name
        self._settled, self._up = threading.Event(), 0
        self._server.declare_subscriber("up", zenoh.handlers.Callback(self._come, indirect=False))
        self._session.declare_subscriber(
            "down", zenoh.handlers.Callback(self._come, indirect=False)
        )

        # A subscription takes effect a little after it is declared, and the last one last.
        self._settle(self._server, "down")

    def _connect(self, folder: Path) -> tuple[zenoh.Session, Ros2Link]:
        world = self.checkpoint.world
        frames = {n: list(MAP.then(Planar(*f.at, 0.0))[:2]) for n, f in world.frames.items()}
        lines = [f"frames: {frames}", "robots:"]
        for name, spec in world.assets.items():
            can = [v for v, c in COMMANDS.items() if spec.kind in c.kinds and c.moves]
            trees = {verb: f"{verb}.xml" for verb in TREES if verb in can}
            lines.append(f"  {name}: {{can: {can}, trees: {trees}}}".replace("'", ""))
        path = folder / "robots.yaml"
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        where = Ros2Address(f"tcp/127.0.0.1:{self._port}", path)
        site = read_site(path, world)
        session, keys = connect(where, site)
        link = Ros2Link(
            session, where, site, keys, clock=lambda: self.checkpoint.time_s, now=self._utc_s
        )
        return session, link

    def _utc_s(self) -> float:
        return EPOCH.timestamp() + self.checkpoint.time_s + 0.01 * self._again

    def _come(self, sample: zenoh.Sample) -> None:
        if int(sample.payload.to_string()) == self._up:
            self._settled.set()

    def _settle(self, session: zenoh.Session, way: str) -> None:
        """Wait until everything that `session` has sent is there."""
        self._up += 1
        self._settled.clear()
        for _ in range(round(LIMIT_S / AGAIN_S)):
            session.put(way, str(self._up), congestion_control=zenoh.CongestionControl.BLOCK)
            if self._settled.wait(AGAIN_S):
                return
        raise TimeoutError(f"nothing comes {way}")

    def send(self, command: DeviceCommand) -> None:
        """Send a command over the link."""
        self.bodies[command.agent].ordered = command.command_id.partition(".")[2]
        self.link.send(command)

    def begin_again(self) -> None:
        """Let the next `take` return the state at the beginning, as after a set-up."""
        super().begin_again()
        self._again += 1
        for robot in self.link._robots.values():  # pyright: ignore[reportPrivateUsage]
            robot.reported_stamp = (
                self._utc_s() - 0.9 * self.checkpoint.world.telemetry_period_s - 0.005
            )

    def take(self) -> Sequence[LinkNews]:
        """Return the state at the beginning; then what arrives in the next step."""
        self._settle(self._session, "up")
        sensed: list[SensorReport] = []
        if not self._begun:
            self._begun = True
            for said in self.checkpoint.picture().assets.values():
                if said.comms != "lost":
                    self.bodies[said.id].show(said)
                    self.robots[said.id].publish()
        else:
            sensed = list(self._move())
        self._settle(self._server, "down")
        return [*self.link.take(), *sensed]

    def _move(self) -> Iterator[SensorReport]:
        """Move the checkpoint on by a step; yield what its sensors report."""
        for reply in self.checkpoint.step():
            self.bodies[reply.agent].hear(reply)
        world, arrived, now = self.checkpoint.world, self.checkpoint.arrived, self.checkpoint.tick
        picture = self.checkpoint.picture()
        for name, spec in world.cameras.items() if arrived.wired is not None else ():
            works = picture.cameras[name].works
            team = self._team(spec.at, spec.sensor_range_m if works else -1.0)
            found = self._contacts((arrived.wired or {}).get(name, ()))
            yield SensorReport(name, self._at(now), found, team, works=works)
        heard = {report.agent for report in arrived.reports}
        for report in arrived.reports:
            self.bodies[report.agent].show(report.telemetry.telemetry())
            yield self._seen(report.agent, report.stamp, report.detections)
        for name, robot in self.robots.items():
            robot.mode = "silent" if picture.assets[name].comms == "lost" else ""
            robot.step(world.dt_s, publishes=name in heard)

    def close(self) -> None:
        """End both sessions."""
        self.link.close()
        self._server.close()


class Nav2Fleet(LinkedFleet):
    """A fleet of robots with Nav2 in which incidents can be made to happen."""

    def __init__(self, checkpoint: Checkpoint, folder: Path, layout: str = "bridge") -> None:
        self.checkpoint, self.site = checkpoint, Nav2Site(checkpoint, folder, layout)
        super().__init__(
            checkpoint.world,
            [self.site],
            now=lambda: EPOCH + timedelta(seconds=checkpoint.time_s),
        )

    @property
    def seed(self) -> int:
        """The seed of the checkpoint's random draws."""
        return self.checkpoint.seed

    def inject(self, incident: Incident) -> None:
        """Make `incident` happen now; raises ValueError for an unknown name."""
        self.checkpoint.inject(incident)
        if self.tick == 0:
            self._known.begin(0)
            self.site.begin_again()
            self._take_news()
            self._show()
        elif isinstance(incident, PlaceAsset):
            self._known.carried(incident.asset)
