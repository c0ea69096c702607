"""The console's ROS 2 node, which has its own thread, and the clients of a robot's servers.

Only this module needs ROS 2; its import raises ImportError if ROS 2 is not installed.
"""

import math
import secrets
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from importlib import import_module
from threading import Thread
from time import monotonic
from typing import Any

from pa_console.fleets.ros2.connection import RobotEntry
from pa_console.fleets.ros2.messages import Planar, UnreadableError, read_result, read_state


def _interface(name: str) -> Any:
    """Return the class of an interface such as `std_msgs/msg/Bool`."""
    module, _, kind = name.replace("/", ".").rpartition(".")
    return getattr(import_module(module), kind)


# Typed as Any, because a type checker finds ROS 2 only if it is installed.
_rclpy: Any = import_module("rclpy")
_actions: Any = import_module("rclpy.action")
_executors: Any = import_module("rclpy.executors")
_qos: Any = import_module("rclpy.qos")
_events: Any = import_module("rclpy.event_handler")
_serialization: Any = import_module("rclpy.serialization")
_GOTO = "nav2_msgs/action/NavigateToPose"
_Impl, _CancelGoal = _interface(_GOTO).Impl, _interface("action_msgs/srv/CancelGoal")
_GetState = _interface("lifecycle_msgs/srv/GetState")

STEP_S = 0.05
"""The interval between calls of `step`, in seconds."""

GRAPH_S = 0.5
"""The interval between counts of the action servers, in seconds."""

CALL_S = 3.0
"""The longest wait for the answer of a service, in seconds."""

CANCEL_S = 1.0
"""The time after which an unanswered request to cancel all goals is repeated, in seconds."""

LATE_S = 10.0
"""The time for which a late answer to a repeated request is still accepted, in seconds."""

RESULT_S = 10.0
"""The time after which a result is requested again, in seconds; the robot may have restarted."""

Then = Callable[[Any], object]


class RosNode:
    """A node that only its own thread uses after `start`; `post` gives work to that thread."""

    def __init__(self, domain: int | None, guarded: Callable[[Callable[[], object]], None]) -> None:
        """Make the node; `guarded` calls a function and handles its errors."""
        self._guarded, self._closed = guarded, False
        self._work: deque[Callable[[], object]] = deque()
        self._calls: dict[Any, tuple[float, float, Any, Then]] = {}
        """The futures of services that have not answered.

        Each has its time limit, the time at which it is dropped, its client, and its callback.
        """
        self._context = _rclpy.Context()
        # No log goes to the terminal, which is the console's screen.
        arguments = ["--ros-args", "--disable-stdout-logs", "--disable-rosout-logs"]
        signals = _rclpy.SignalHandlerOptions.NO
        _rclpy.init(
            args=arguments, context=self._context, domain_id=domain, signal_handler_options=signals
        )
        self.domain: int = self._context.get_domain_id()
        self.node = _rclpy.create_node(
            f"pa_console_{secrets.token_hex(4)}",
            context=self._context,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._executor = _executors.SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._wake = self.node.create_guard_condition(lambda: None)
        self.servers: dict[str, int] = {}
        """The number of servers of each action of the type `NavigateToPose` in the domain."""
        self.services: frozenset[str] = frozenset()
        """The names of all services in the domain."""

    def start(self, step: Callable[[], object]) -> None:
        """Start the thread, which calls `step` every STEP_S."""
        self._thread = Thread(target=self._run, args=(step,), name="ros2", daemon=True)
        self._thread.start()

    def post(self, work: Callable[[], object]) -> None:
        """Let the thread call `work` as soon as possible; returns at once."""
        self._work.append(work)
        self._wake.trigger()

    def listen(
        self,
        topic: str,
        kind: str,
        take: Then,
        *,
        kept: bool = False,
        depth: int = 50,
        raw: bool = False,
    ) -> Any:
        """Return a subscription to a topic; if the topic is `kept`, its last message comes at once.

        If messages arrive too fast, only the last `depth` messages are processed. A `raw` message
        is passed to `take` as it was received, in bytes.
        """
        reliable = _qos.ReliabilityPolicy.RELIABLE if kept else _qos.ReliabilityPolicy.BEST_EFFORT
        durable = _qos.DurabilityPolicy.TRANSIENT_LOCAL if kept else _qos.DurabilityPolicy.VOLATILE
        profile = _qos.QoSProfile(depth=depth, reliability=reliable, durability=durable)
        # Each default event handler would make every wait of the executor longer.
        events = _events.SubscriptionEventCallbacks(use_default_callbacks=False)
        return self.node.create_subscription(
            _interface(kind), topic, take, profile, event_callbacks=events, raw=raw
        )

    def next_message(self, topic: str, kind: str, most_bytes: int, limit_s: float) -> Any:
        """Return the next message on a topic; waits in the caller's thread.

        The topic is subscribed to only during the wait. Raises TimeoutError after `limit_s`, and
        UnreadableError for a message of more than `most_bytes`.
        """
        arrived: Future[bytes] = Future()
        subscriptions: deque[Any] = deque()

        def take(message: bytes) -> None:
            if not arrived.done():
                arrived.set_result(message)

        self.post(lambda: subscriptions.append(self.listen(topic, kind, take, depth=1, raw=True)))
        try:
            content = arrived.result(limit_s)
        finally:
            self.post(lambda: self.node.destroy_subscription(subscriptions.pop()))
        if len(content) > most_bytes:
            raise UnreadableError(f"it has {len(content)} bytes")
        return _serialization.deserialize_message(content, _interface(kind))

    def call(
        self, client: Any, request: Any, limit_s: float, then: Then, late_s: float = 0.0
    ) -> None:
        """Call a service; `then` gets the answer, or None if no answer arrives within `limit_s`.

        After None, `then` still gets an answer that is at most `late_s` late.
        """
        future, until_s = client.call_async(request), monotonic() + limit_s
        self._calls[future] = (until_s, until_s + late_s, client, then)
        future.add_done_callback(self._answered)

    def close(self) -> None:
        """End the thread and the node."""
        self._closed = True
        self._wake.trigger()
        self._thread.join()
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()

    def _run(self, step: Callable[[], object]) -> None:
        step_s = graph_s = monotonic()
        while not self._closed:
            while self._work:
                self._guarded(self._work.popleft())
            if (now_s := monotonic()) >= graph_s:
                graph_s = now_s + GRAPH_S
                self._guarded(self._count)
            if now_s >= step_s:
                step_s = now_s + STEP_S
                self._guarded(self._expire)
                self._guarded(step)
            left_s = max(0.0, step_s - monotonic())
            self._guarded(partial(self._executor.spin_once, left_s))

    def _count(self) -> None:
        actions = _actions.get_action_names_and_types(self.node)
        names = [name for name, types in actions if _GOTO in types]
        self.servers = {n: self.node.count_publishers(f"{n}/_action/status") for n in names}
        self.services = frozenset(name for name, _ in self.node.get_service_names_and_types())

    def _answered(self, future: Any) -> None:
        if (call := self._calls.pop(future, None)) is not None:
            call[3](future.result())

    def _expire(self) -> None:
        now_s = monotonic()
        for future, (until_s, given_up_s, client, then) in list(self._calls.items()):
            if given_up_s <= now_s:
                del self._calls[future]
                client.remove_pending_request(future)
            elif until_s <= now_s:
                self._calls[future] = (math.inf, given_up_s, client, then)
            if until_s <= now_s:
                then(None)


class ManagedNode:
    """A managed node of a robot, such as `bt_navigator`, if the robot has it."""

    def __init__(self, node: RosNode, name: str) -> None:
        self._node, self._service, self._client = node, f"{name}/get_state", None

    def ask(self, then: Callable[[str | None], None]) -> None:
        """Request the state; `then` gets None if there is no such node or no answer in time."""
        if self._service not in self._node.services:
            then(None)
            return
        client = self._client = self._client or self._node.node.create_client(
            _GetState, self._service
        )
        request = _GetState.Request()
        self._node.call(client, request, CALL_S, lambda answer: then(answer and read_state(answer)))


class Nav2Server:
    """The client of a robot's action server; `then` gets an answer, or None if there is none."""

    def __init__(self, node: RosNode, asset: str, entry: RobotEntry) -> None:
        self._node, self._frame = node, entry.map_frame
        self.action, create = entry.named(asset, entry.action), node.node.create_client
        self._goals = create(_Impl.SendGoalService, f"{self.action}/_action/send_goal")
        self._results = create(_Impl.GetResultService, f"{self.action}/_action/get_result")
        actions = (self.action, *(entry.named(asset, action) for action in entry.stops))
        self._cancels = [create(_CancelGoal, f"{action}/_action/cancel_goal") for action in actions]

    @property
    def servers(self) -> int:
        """The number of action servers with this name; more than one is a mistake."""
        return self._node.servers.get(self.action, 0) if self._goals.service_is_ready() else 0

    def go(
        self, goal_id: bytes, at: Planar, tree: str, then: Callable[[bool | None], None]
    ) -> None:
        """Send a goal, a place on the robot's map; `then` gets True if it is accepted."""
        request = _Impl.SendGoalService.Request()
        request.goal_id.uuid = list(goal_id)
        request.goal.behavior_tree, stamped = tree, request.goal.pose
        stamped.header.frame_id = self._frame
        stamped.pose.position.x, stamped.pose.position.y = at.x, at.y
        turned = stamped.pose.orientation
        turned.z, turned.w = math.sin(at.yaw / 2), math.cos(at.yaw / 2)
        self._node.call(
            self._goals, request, CALL_S, lambda answer: then(answer and answer.accepted)
        )

    def cancel(self, goal_id: bytes | None, then: Callable[[int | None], None]) -> None:
        """Cancel a goal, or all goals of all clients; `then` gets a `CancelGoal` return code."""
        request = _CancelGoal.Request()
        request.goal_info.goal_id.uuid = list(goal_id or bytes(16))
        own, *others = self._cancels
        self._node.call(
            own, request, CANCEL_S, lambda answer: then(answer and answer.return_code), LATE_S
        )
        for other in others if goal_id is None else ():
            self._node.call(other, request, CALL_S, lambda _: None)

    def ask(self, goal_id: bytes, then: Callable[[tuple[int, str] | None], None]) -> None:
        """Request the state and the error of a goal.

        The server answers when the goal ends, or at once if the goal is unknown.
        """
        request = _Impl.GetResultService.Request()
        request.goal_id.uuid = list(goal_id)
        self._node.call(
            self._results, request, RESULT_S, lambda answer: then(answer and read_result(answer))
        )
