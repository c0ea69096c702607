"""`python -m tests.fleets.ros2.nav2_robot`: robots with Nav2, on a Zenoh router of their own.

They behave as Nav2's navigator does by its public source (rclcpp_action, nav2_util's action server,
bt_navigator): a second goal takes the place of the first unless its behaviour tree differs, a known
goal id ends the server, a result is given when the goal has ended and is kept for ten seconds.
Lines of JSON on standard input change a robot; each is answered by the state of all of them.
"""

import argparse
import json
import math
import struct
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import zenoh
from zenoh.ext import CacheConfig, declare_advanced_publisher

from tests.fleets.ros2 import wire
from tests.fleets.ros2.wire import Header, Pose, PoseStamped, Quaternion, Time, Uuid, Vector3

ACTION = "navigate_to_pose/_action"
ACCEPTED, EXECUTING, CANCELING, SUCCEEDED, CANCELED, ABORTED = 1, 2, 3, 4, 5, 6
KEEP_S = 10.0
BLOCK = zenoh.CongestionControl.BLOCK
Reply = Callable[[bytes], None]
LATCHED = ("tf_static", f"{ACTION}/status", "amcl_pose")


class Body(Protocol):
    """What a robot moves: its own wheels here, an asset of a simulation elsewhere."""

    x: float
    y: float
    yaw: float
    speed: float
    charge: float
    level: int

    def go(self, x: float, y: float, tree: str) -> None:
        """Set out for a place, by a behaviour tree."""

    def stop(self) -> None:
        """Stop."""

    def step(self, dt_s: float) -> None:
        """Move on."""

    def arrived(self) -> bool:
        """Return whether it has done what it set out for."""
        ...

    def reason(self) -> str:
        """Return why it cannot do that, '' while it can."""
        ...


class Wheels:
    """Drives in straight lines."""

    def __init__(self, x: float, y: float, top_mps: float = 4.0) -> None:
        self.x, self.y, self.yaw, self.speed, self.charge, self.level = x, y, 0.0, 0.0, 0.8, 0
        self.goal: tuple[float, float] | None = None
        self.top_mps, self.runs_away = top_mps, False

    def go(self, x: float, y: float, tree: str) -> None:
        """Set out."""
        self.goal = (x, y)

    def stop(self) -> None:
        """Stop, unless it runs away."""
        if not self.runs_away:
            self.goal = None

    def step(self, dt_s: float) -> None:
        """Move on."""
        self.speed = 0.0
        if self.goal is None:
            return
        gap, step = math.dist((self.x, self.y), self.goal), self.top_mps * dt_s
        if gap <= step:
            self.x, self.y = self.goal
            self.goal = None
            return
        self.yaw = math.atan2(self.goal[1] - self.y, self.goal[0] - self.x)
        self.x, self.y = self.x + step * math.cos(self.yaw), self.y + step * math.sin(self.yaw)
        self.speed = self.top_mps

    def arrived(self) -> bool:
        """Return whether it has arrived."""
        return self.goal is None

    def reason(self) -> str:
        """Return '': the way is always free."""
        return ""


@dataclass
class Goal:
    """A goal as the action server keeps it."""

    goal_id: bytes
    at: tuple[float, float]
    tree: str
    status: int = ACCEPTED
    began_s: float = 0.0
    ended_s: float = math.inf
    code: int = 0
    text: str = ""
    waiting: list[zenoh.Query] = field(default_factory=list[zenoh.Query])


class Nav2Robot:
    """One robot: topics, the three services, and the modes in which it misbehaves.

    `mode` is one of: "" (well), reject, slow, abort, stuck, lie (succeeds where it stands), silent
    (answers nothing), defiant (rejects every cancel).
    """

    def __init__(
        self,
        session: zenoh.Session,
        namespace: str,
        body: Body,
        *,
        layout: str = "bridge",
        domain: int = 0,
        release: str = "jazzy",
        clock: Callable[[], float] = time.time,
    ) -> None:
        self.namespace, self.body, self.mode, self.release = namespace, body, "", release
        self.pose_source, self.ahead_s = "tf", 0.5
        self.executed: list[str] = []
        """The goals that it began to carry out, in order."""
        self.crashed = ""
        self.foreign = 0
        self._session, self._layout, self._domain, self._clock = session, layout, domain, clock
        self._lock = threading.RLock()
        self._goals: dict[bytes, Goal] = {}
        self._current: Goal | None = None
        self._number = 0
        self._held: list[Any] = []
        self._due: list[tuple[float, Callable[[], None]]] = []
        self._publishers: dict[str, Any] = {}
        self._slow_s = self._told_s = -math.inf
        names = ["tf", "tf_static", "odom", "battery_state", "diagnostics_toplevel_state",
                 "joystick", f"{ACTION}/status", f"{ACTION}/feedback"]  # fmt: skip
        for name in names:
            key = self._key(name)
            if name in LATCHED:
                cache = CacheConfig(max_samples=1)
                publisher = declare_advanced_publisher(
                    session, key, cache=cache, publisher_detection=True, congestion_control=BLOCK
                )
            else:
                publisher = session.declare_publisher(key, congestion_control=BLOCK)
            self._publishers[name] = publisher
            self._token("MP", name)
        for name, answer in (
            ("send_goal", self._send_goal),
            ("cancel_goal", self._cancel_goal),
            ("get_result", self._get_result),
        ):
            full = f"{ACTION}/{name}"
            self._held.append(
                session.declare_queryable(
                    self._key(full),
                    zenoh.handlers.Callback(self._guarded(answer), indirect=False),
                    complete=True,
                )
            )
            self._token("SS", full)
        if layout == "bridge":
            ke = f"{namespace}/navigate_to_pose".replace("/", "§")
            kind = "nav2_msgs§action§NavigateToPose"
            token = f"@/{session.zid()}/@ros2_lv/AS/{ke}/{kind}"
            self._held.append(session.liveliness().declare_token(token))
        self._fixed()
        self._publish_status()

    # Keys

    def _key(self, name: str) -> str:
        if self._layout == "bridge":
            return f"{self.namespace}/{name}"
        return f"{self._domain}/{self.namespace}/{name}/{wire.TYPES[name]}/{wire.type_hash(name)}"

    def _token(self, kind: str, name: str) -> None:
        if self._layout == "bridge":
            return
        self._number += 1
        mangled = f"/{self.namespace}/{name}".replace("/", "%")
        parts = ("@ros2_lv", self._domain, self._session.zid(), 0, self._number, kind, "%",
                 f"%{self.namespace}", "bt_navigator", mangled, wire.TYPES[name],
                 wire.type_hash(name), ":,:,:,:,,")  # fmt: skip
        token = "/".join(str(part) for part in parts).replace("/:,", "/::,", 1)
        self._held.append(self._session.liveliness().declare_token(token))

    def _attachment(self) -> bytes | None:
        if self._layout == "bridge":
            return None
        self._number += 1
        return struct.pack("<qqB", self._number, time.time_ns(), 16) + bytes(16)

    def _put(self, name: str, payload: bytes) -> None:
        self._publishers[name].put(payload, attachment=self._attachment())

    # Services

    def _guarded(
        self, answer: Callable[[bytes, Reply, zenoh.Query], None]
    ) -> Callable[[zenoh.Query], None]:
        def take(query: zenoh.Query) -> None:
            if self.mode == "silent" or self.crashed:
                query.drop()
                return
            given = query.attachment.to_bytes() if query.attachment is not None else b""
            if self._layout == "rmw" and (len(given) != 33 or given[16] != 16):
                query.drop()  # rmw_zenoh takes no request without one
                return

            def reply(payload: bytes) -> None:
                query.reply(query.key_expr, payload, attachment=self._attachment())
                query.drop()

            payload = query.payload.to_bytes() if query.payload is not None else b""
            with self._lock:
                answer(payload, reply, query)

        return take

    def _send_goal(self, payload: bytes, reply: Reply, query: zenoh.Query) -> None:
        request = wire.SendGoalRequest.deserialize(payload)
        goal_id = bytes(request.goal_id.uuid)
        if goal_id in self._goals:
            self.crashed = "Failed to accept new goal"  # rclcpp_action, and with it the container
            query.drop()
            return
        if self.mode == "reject":
            reply(wire.SendGoalResponse(False, Time()).serialize())
            return
        position = request.pose.pose.position
        goal = Goal(goal_id, (position.x, position.y), request.behavior_tree)

        def accept() -> None:
            self._goals[goal_id] = goal
            reply(wire.SendGoalResponse(True, Time.of(self._clock())).serialize())
            self._begin(goal)

        if self.mode == "slow":
            self._due.append((self._clock() + 1.0, accept))
        else:
            accept()

    def _begin(self, goal: Goal) -> None:
        running = self._current
        if running is not None and running.status == EXECUTING:
            if running.tree != goal.tree:
                self._end(goal, ABORTED)  # bt_navigator keeps the goal that it has
                return
            self._end(running, ABORTED)
        self._current, goal.status, goal.began_s = goal, EXECUTING, self._clock()
        self.executed.append(goal.goal_id.hex())
        if self.mode not in ("lie", "stuck"):
            self.body.go(*goal.at, goal.tree)
        self._publish_status()

    def _cancel_goal(self, payload: bytes, reply: Reply, query: zenoh.Query) -> None:
        wanted = bytes(wire.CancelRequest.deserialize(payload).goal_info.goal_id.uuid)
        active = [g for g in self._goals.values() if g.status in (ACCEPTED, EXECUTING)]
        chosen = [g for g in active if g.goal_id == wanted or not any(wanted)]
        if chosen and self.mode == "defiant":
            reply(wire.CancelResponse(1, []).serialize())
            return
        code = 0 if chosen or not any(wanted) else (3 if wanted in self._goals else 2)
        infos = [wire.GoalInfo(Uuid(list(g.goal_id)), Time()) for g in chosen]
        reply(wire.CancelResponse(code, infos).serialize())
        for goal in chosen:
            goal.status = CANCELING
        if chosen:
            self._publish_status()
        elif not any(wanted):
            self.body.stop()
        for goal in chosen:  # the behaviour tree notices at its next tick
            self._due.append((self._clock() + 0.05, lambda goal=goal: self._cancelled(goal)))

    def _cancelled(self, goal: Goal) -> None:
        if goal is self._current:
            self.body.stop()
        self._end(goal, CANCELED)

    def _get_result(self, payload: bytes, reply: Reply, query: zenoh.Query) -> None:
        goal = self._goals.get(bytes(wire.ResultRequest.deserialize(payload).goal_id.uuid))
        if goal is None:
            reply(self._result(0, 0, ""))
        elif goal.ended_s < math.inf:
            reply(self._result(goal.status, goal.code, goal.text))
        else:
            goal.waiting.append(query)

    def _result(self, status: int, code: int, text: str) -> bytes:
        match self.release:
            case "humble":
                return wire.ResultHumble(status).serialize()
            case "jazzy":
                return wire.ResultJazzy(status, code).serialize()
            case _:
                return wire.ResultKilted(status, code, text).serialize()

    def _end(self, goal: Goal, status: int, code: int = 0, text: str = "") -> None:
        goal.status, goal.code, goal.text, goal.ended_s = status, code, text, self._clock()
        if goal is self._current:
            self._current = None
        self._publish_status()
        for query in goal.waiting:
            query.reply(
                query.key_expr, self._result(status, code, text), attachment=self._attachment()
            )
            query.drop()
        goal.waiting.clear()

    # Topics

    def step(self, dt_s: float, *, publishes: bool = True) -> None:
        """Move on, and publish."""
        with self._lock:
            now_s = self._clock()
            due = [each for each in self._due if each[0] <= now_s]
            self._due = [each for each in self._due if each[0] > now_s]
            for _, act in due:
                act()
            self.body.step(dt_s)
            goal = self._current
            if goal is not None and goal.status == EXECUTING:
                self._pursue(goal, now_s)
            for known in list(self._goals.values()):
                if now_s - known.ended_s > KEEP_S:
                    del self._goals[known.goal_id]
            if publishes and not self.crashed:
                self.publish()

    def _pursue(self, goal: Goal, now_s: float) -> None:
        if self.mode == "lie":
            self._end(goal, SUCCEEDED)
        elif self.mode == "abort" and now_s - goal.began_s > 0.3:
            self.body.stop()
            self._end(goal, ABORTED, 208, "the corridor is closed")
        elif why := self.body.reason():
            self.body.stop()
            self._end(goal, ABORTED, 9000, why)
        elif self.mode != "stuck" and self.body.arrived():
            self._end(goal, SUCCEEDED)

    def publish(self) -> None:
        """Publish what changes all the time."""
        now_s = now = self._clock()
        body = self.body
        correction = wire.Transform(Vector3(0.0, 0.0, 0.0), Quaternion.of(0.0))
        ahead = Header(Time.of(now + self.ahead_s), "map")
        moved = wire.Transform(Vector3(body.x, body.y, 0.0), Quaternion.of(body.yaw))
        here = Header(Time.of(now), "odom")
        for each in (
            wire.TransformStamped(ahead, "odom", correction),
            wire.TransformStamped(here, "base_footprint", moved),
        ):
            self._put("tf", wire.TFMessage([each]).serialize())
        pose = Pose(Vector3(body.x, body.y, 0.0), Quaternion.of(body.yaw))
        twist = wire.TwistWithCovariance(wire.Twist(Vector3(body.speed, 0.0, 0.0), Vector3()))
        odometry = wire.Odometry(here, "base_footprint", wire.PoseWithCovariance(pose), twist)
        self._put("odom", odometry.serialize())
        if (goal := self._current) is not None and goal.status == EXECUTING:
            left = math.dist((body.x, body.y), goal.at)
            message = wire.FeedbackMessage(
                Uuid(list(goal.goal_id)),
                PoseStamped(Header(Time.of(now), "map"), pose),
                wire.Duration(int(now_s - goal.began_s)),
                wire.Duration(int(left / 4.0)),
                0,
                left,
            )
            self._put(f"{ACTION}/feedback", message.serialize())
        if now_s - self._told_s >= 0.5:
            self._told_s = now_s
            battery = wire.BatteryState(here, percentage=body.charge)
            self._put("battery_state", battery.serialize())
            health = wire.DiagnosticStatus(body.level, message="a motor is hot")
            self._put("diagnostics_toplevel_state", health.serialize())

    def _fixed(self) -> None:
        same = wire.Transform(Vector3(0.0, 0.0, 0.1), Quaternion.of(0.0))
        begin = Header(Time.of(self._clock() - 100.0), "base_footprint")
        fixed = wire.TFMessage([wire.TransformStamped(begin, "base_link", same)])
        self._put("tf_static", fixed.serialize())

    def _publish_status(self) -> None:
        self._put(
            f"{ACTION}/status",
            wire.GoalStatusArray(
                [
                    wire.GoalStatus(wire.GoalInfo(Uuid(list(g.goal_id)), Time()), g.status)
                    for g in self._goals.values()
                ]
            ).serialize(),
        )


def router(port: int) -> zenoh.Session:
    """Return a session that is a router on this machine alone."""
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", f'["tcp/127.0.0.1:{port}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("timestamping/enabled", "true")
    return zenoh.open(config)


def main() -> None:
    """Run the robots of a JSON object, name -> [x, y], until standard input ends."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--layout", default="bridge")
    parser.add_argument("--release", default="jazzy")
    parser.add_argument("--domain", type=int, default=0)
    parser.add_argument("--rate-hz", type=float, default=20.0)
    parser.add_argument("robots", type=json.loads)
    given = parser.parse_args()
    session = router(given.port)
    robots = {
        name: Nav2Robot(
            session, name, Wheels(*at), layout=given.layout, domain=given.domain,
            release=given.release,
        )
        for name, at in given.robots.items()
    }  # fmt: skip
    ended = threading.Event()
    period_s = 1.0 / given.rate_hz

    def drive() -> None:
        last = time.monotonic()
        while not ended.wait(period_s):
            now = time.monotonic()
            for robot in robots.values():
                robot.step(now - last)
            last = now

    thread = threading.Thread(target=drive)
    thread.start()
    print("ready", flush=True)
    for line in sys.stdin:
        changes: dict[str, dict[str, Any]] = json.loads(line)
        for name, change in changes.items():
            robot = robots[name]
            for key, value in change.items():
                owner = robot if hasattr(robot, key) else robot.body
                setattr(owner, key, value)
        state = {
            name: {"executed": r.executed, "crashed": r.crashed, "at": [r.body.x, r.body.y],
                   "speed": r.body.speed}
            for name, r in robots.items()
        }  # fmt: skip
        print(json.dumps(state), flush=True)
    ended.set()
    thread.join()
    session.close()


if __name__ == "__main__":
    main()
