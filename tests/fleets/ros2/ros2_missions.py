"""`python -m tests.fleets.ros2.ros2_missions`: the paper's missions with robots over ROS 2.

Every asset is a node with Nav2's action whose wheels are those of the simulated asset: a goal that
comes over DDS is the asset's command, and its transforms and odometry are where the asset is.
Cameras, and what assets see, come as in the simulation: ROS 2 has no standard words for them.
"""

import math
import os
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from importlib import import_module
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory
from typing import Any

from pa_console.evaluation.jobs import Job
from pa_console.fleets.link import AssetReport, DeviceAnswer, LinkNews, SensorReport
from pa_console.fleets.linked_fleet import LinkedFleet
from pa_console.fleets.ros2.link import Ros2Link, open_link
from pa_console.schema.command import COMMANDS, FINAL_REPLIES, DeviceCommand, Verb
from pa_console.schema.incident import Incident
from pa_console.schema.telemetry import AssetTelemetry
from pa_console.schema.world import World
from pa_console.settings.schema import Settings
from pa_console.sim.checkpoint import Checkpoint
from tests.fleets.paper_missions import main
from tests.fleets.ros2.counterpart import free_domain
from tests.fleets.scripted_link import EPOCH
from tests.fleets.simulated_link import SimulatedLink

rclpy: Any = import_module("rclpy")
actions: Any = import_module("rclpy.action")
executors: Any = import_module("rclpy.executors")
geometry: Any = import_module("geometry_msgs.msg")
BatteryState: Any = import_module("sensor_msgs.msg").BatteryState
NavigateToPose: Any = import_module("nav2_msgs.action").NavigateToPose
Odometry: Any = import_module("nav_msgs.msg").Odometry
TFMessage: Any = import_module("tf2_msgs.msg").TFMessage

PERIOD_S = 0.4
READY_S = 900.0
SAME_M = 0.1


def driven_verbs(world: World, name: str) -> list[Verb]:
    """Return the orders of an asset that are goals."""
    kind = world.assets[name].kind
    return [v for v, spec in COMMANDS.items() if v not in ("hold", "report") and kind in spec.kinds]


def _accept(_goal: Any) -> Any:
    return actions.CancelResponse.ACCEPT


class Navigator:
    """The action server and the topics of one asset; the behaviour tree of a goal names its verb.

    `orders` gets what it is commanded; what came of that is put into `answers`.
    """

    def __init__(self, node: Any, world: World, name: str, orders: SimpleQueue[Any]) -> None:
        self.world, self.name, self.orders, self._node = world, name, orders, node
        self.said: AssetTelemetry | None = None
        """Its own report, None while it is silent."""
        self.answers: SimpleQueue[DeviceAnswer] = SimpleQueue()
        self._goals: dict[str, tuple[Any, Any]] = {}
        """The goals under way and what ends them, by the ids of their commands."""
        publish = node.create_publisher
        self._tf = publish(TFMessage, f"/{name}/tf", 10)
        self._odom = publish(Odometry, f"/{name}/odom", 10)
        self._battery = publish(BatteryState, f"/{name}/battery_state", 10)
        self._server = actions.ActionServer(
            node,
            NavigateToPose,
            f"/{name}/navigate_to_pose",
            self._execute,
            cancel_callback=_accept,
        )

    async def _execute(self, goal: Any) -> Any:
        at, verb = goal.request.pose.pose.position, goal.request.behavior_tree or "move_to"
        frames, name = self.world.frames, bytes(goal.goal_id.uuid).hex()
        command = {"command_id": name, "agent": self.name, "verb": verb}
        if COMMANDS[verb].takes_frame:
            command["target"] = min(frames, key=lambda n: math.dist(frames[n].at, (at.x, at.y)))
        end = rclpy.task.Future()
        self._goals[name] = goal, end
        self.orders.put(DeviceCommand.model_validate(command))
        status, detail = await end
        if status == "cancelled":
            goal.canceled()
        elif status == "done":
            goal.succeed()
        else:
            goal.abort()
        return NavigateToPose.Result(error_msg=detail)

    def step(self) -> None:
        """End the goals that are over, and publish where the asset is."""
        for name, (goal, end) in list(self._goals.items()):
            if goal.is_cancel_requested:
                del self._goals[name]
                hold = DeviceCommand(command_id=f"{name}.h", agent=self.name, verb="hold")
                self.orders.put(hold)
                end.set_result(("cancelled", ""))
        while not self.answers.empty():
            answer = self.answers.get()
            if answer.status in FINAL_REPLIES and answer.command_id in self._goals:
                self._goals.pop(answer.command_id)[1].set_result((answer.status, answer.detail))
        if self.said is not None:
            self._publish(self.said)

    def _publish(self, said: AssetTelemetry) -> None:
        found, yaw = geometry.TransformStamped(), math.radians(said.heading_deg)
        found.header.frame_id, found.child_frame_id = "map", "base_link"
        found.header.stamp = self._node.get_clock().now().to_msg()
        found.transform.translation.x, found.transform.translation.y = said.position
        found.transform.rotation.z = math.sin(yaw / 2)
        found.transform.rotation.w = math.cos(yaw / 2)
        odometry = Odometry(header=found.header, child_frame_id="base_link")
        odometry.twist.twist.linear.x = said.speed_mps
        self._odom.publish(odometry)
        self._battery.publish(BatteryState(percentage=said.battery_pct / 100.0))
        self._tf.publish(TFMessage(transforms=[found]))


class Wheels(SimulatedLink):
    """Moves the simulation on in real time; of it, only cameras and sensors come over this link."""

    name = "simulated:sensors"

    def __init__(
        self, checkpoint: Checkpoint, nodes: Mapping[str, Navigator], orders: SimpleQueue[Any]
    ) -> None:
        super().__init__(checkpoint)
        self.agents, self.nodes, self._orders = frozenset[str](), nodes, orders
        self.seen: list[LinkNews] = []
        self._due = time.monotonic()

    def take(self) -> Sequence[LinkNews]:
        """Step when it is due; return what cameras see, and keep what assets see."""
        if self._begun:
            self._due = max(self._due + self.checkpoint.world.dt_s, time.monotonic() - 0.1)
            time.sleep(max(0.0, self._due - time.monotonic()))
            while not self._orders.empty():
                self.checkpoint.send(self._orders.get())
        cameras: list[LinkNews] = []
        for each in super().take():
            if isinstance(each, DeviceAnswer):
                self.nodes[each.agent].answers.put(each)
            elif isinstance(each, SensorReport) and each.sensor in self.nodes:
                self.seen.append(each)
            elif isinstance(each, SensorReport):
                cameras.append(each)
        self.show()
        return cameras

    def show(self) -> None:
        """Put the nodes where their assets are."""
        known, truth = self.checkpoint.picture().assets, self.checkpoint.truth().assets
        for name, node in self.nodes.items():
            lost = known[name].comms == "lost" or truth[name].status == "failed"
            own = {"position": truth[name].position, "comms": "ok"}
            node.said = None if lost else known[name].model_copy(update=own)


class OverRos2:
    """The link under test, on the simulation's clock, with what the assets see."""

    def __init__(self, link: Ros2Link, wheels: Wheels) -> None:
        self.link, self._wheels = link, wheels
        self.name, self.agents = link.name, link.agents
        self.latest: dict[str, AssetReport] = {}

    @property
    def problem(self) -> str:
        """The reason why there is no connection."""
        return self.link.problem

    def send(self, command: DeviceCommand) -> None:
        """Send a command over ROS 2."""
        print(f"   {command.agent} {command.verb} {command.target or ''}", flush=True)
        self.link.send(command)

    def take(self) -> Sequence[LinkNews]:
        """Return what came over ROS 2, and what the assets see."""
        seen, self._wheels.seen = self._wheels.seen, []
        checkpoint = self._wheels.checkpoint
        now = EPOCH + timedelta(seconds=checkpoint.tick * checkpoint.world.dt_s)
        news: list[LinkNews] = []
        for each in self.link.take():
            if not isinstance(each, AssetReport):
                if isinstance(each, DeviceAnswer) and each.status in ("refused", "failed"):
                    print(f"   {each.agent}: {each.status} {each.detail}", flush=True)
                news.append(each)
                continue
            age = max(datetime.now(UTC) - each.sent, timedelta())
            self.latest[each.agent] = each
            news.append(replace(each, sent=now - age if checkpoint.tick else now))
        if not checkpoint.tick:  # the simulation waits: what is known holds at its first moment
            news += [replace(each, sent=now) for each in self.latest.values()]
        return [*news, *seen]

    def wait(self, seconds: float) -> bool:
        """Wait for news."""
        return self.link.wait(seconds)

    def close(self) -> None:
        """End the connection."""
        self.link.close()


class Ros2Robots(LinkedFleet):
    """A fleet whose assets are all on ROS 2; incidents can be made to happen."""

    def __init__(self, checkpoint: Checkpoint) -> None:
        self.checkpoint, world, domain = checkpoint, checkpoint.world, free_domain()
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        self._context, orders = rclpy.Context(), SimpleQueue[Any]()
        rclpy.init(context=self._context, domain_id=domain)
        self._executor = executors.SingleThreadedExecutor(context=self._context)
        node = rclpy.create_node("navigators", context=self._context)
        nodes = {name: Navigator(node, world, name, orders) for name in world.assets}
        node.create_timer(PERIOD_S, lambda: [each.step() for each in nodes.values()])
        self._executor.add_node(node)
        self._spinning = threading.Thread(target=self._executor.spin, daemon=True)
        self._spinning.start()
        self._wheels = Wheels(checkpoint, nodes, orders)
        self._wheels.show()
        with TemporaryDirectory() as folder:
            file = Path(folder) / "robots.yaml"
            file.write_text(self._connection(world, domain), encoding="utf-8")
            self._over = OverRos2(open_link(str(file), world, Settings()), self._wheels)
        super().__init__(
            world,
            [self._wheels, self._over],
            now=lambda: EPOCH + timedelta(seconds=checkpoint.tick * world.dt_s),
        )
        self._begin()

    @staticmethod
    def _connection(world: World, domain: int) -> str:
        lines = [f"domain: {domain}", "map: null", "frames:"]
        lines += [f"  {name}: {list(frame.at)}" for name, frame in world.frames.items()]
        lines.append("robots:")
        for name in world.assets:
            verbs = driven_verbs(world, name)
            trees = ", ".join(f"{verb}: {verb}" for verb in verbs if verb != "move_to")
            lines.append(f"  {name}: {{can: [{', '.join(verbs)}], trees: {{{trees}}}}}")
        return "\n".join(lines) + "\n"

    def _begin(self) -> None:
        """Show where everything is at the beginning; raises TimeoutError for a mute robot."""
        self._reported.begin(0)
        self._wheels.begin_again()
        self._wheels.show()
        until = time.monotonic() + READY_S
        while away := [n for n, node in self._wheels.nodes.items() if not self._is_shown(n, node)]:
            if time.monotonic() > until:
                raise TimeoutError(f"{away} are not where they are: {self._over.latest}")
            self._over.wait(0.1)
            self._over.take()
        self._take_news()
        self._show()

    def _is_shown(self, name: str, node: Navigator) -> bool:
        said, latest = node.said, self._over.latest.get(name)
        if said is None:
            self._over.latest.pop(name, None)
            return True
        ready = latest is not None and latest.battery_pct is not None
        ready = ready and self._over.link._robots[name].server.servers == 1  # pyright: ignore[reportPrivateUsage]
        return ready and latest is not None and math.dist(latest.position, said.position) < SAME_M

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
        """End the link and the nodes."""
        super().close()
        self._executor.shutdown()
        self._spinning.join()
        self._context.try_shutdown()


def fleet_of(_job: Job, checkpoint: Checkpoint) -> Ros2Robots:
    """Return the robots of a mission."""
    return Ros2Robots(checkpoint)


if __name__ == "__main__":
    main(__doc__, fleet_of)
