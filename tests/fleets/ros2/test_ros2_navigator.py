"""Random histories of one robot: nothing is done twice, a hold holds, and no answer is lost.

The robot here keeps the rules of an action server in C++: a goal id that it knows ends it, and it
forgets a goal ten seconds after its end. The link keeps the order of what it carries, and loses
requests and answers.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.fleets.link import DeviceAnswer
from pa_console.fleets.ros2 import messages
from pa_console.fleets.ros2.connection import Connection, MapFit, RobotEntry, RobotSite
from pa_console.fleets.ros2.messages import GoalState
from pa_console.fleets.ros2.navigator import Navigator, Seen, Then
from pa_console.schema.command import FINAL_REPLIES, DeviceCommand, Verb
from pa_console.schema.world import World
from tests.fleets.ros2 import wire
from tests.fleets.ros2.wire import Time, Uuid

ACTIVE = (1, 2, 3)
TREES: dict[Verb, str] = {"block": "block.xml"}


@dataclass
class Server:
    """An action server and its wheels, on a clock of the test's."""

    clock: Callable[[], float]
    goals: dict[bytes, int] = field(default_factory=dict[bytes, int])
    ended: dict[bytes, float] = field(default_factory=dict[bytes, float])
    trees: dict[bytes, str] = field(default_factory=dict[bytes, str])
    places: dict[bytes, tuple[float, float]] = field(
        default_factory=dict[bytes, tuple[float, float]]
    )
    began: list[bytes] = field(default_factory=list[bytes])
    crashed: str = ""
    questions: list[tuple[bytes, Then]] = field(default_factory=list[tuple[bytes, Then]])
    at: tuple[float, float] = (0.0, 0.0)

    def forget(self) -> None:
        """Forget goals that ended long ago."""
        for goal_id, ended_s in list(self.ended.items()):
            if self.clock() - ended_s > 10.0:
                del self.ended[goal_id], self.goals[goal_id]

    def running(self) -> bytes | None:
        """Return the goal that it carries out."""
        return next((g for g, status in self.goals.items() if status in (1, 2)), None)

    def take(self, service: str, request: bytes, reply: Then) -> None:
        """Take a request."""
        self.forget()
        match service:
            case "send_goal":
                self._goal(wire.SendGoalRequest.deserialize(request), reply)
            case "cancel_goal":
                wanted = bytes(wire.CancelRequest.deserialize(request).goal_info.goal_id.uuid)
                reply(wire.CancelResponse(0, []).serialize())
                for goal_id, status in list(self.goals.items()):
                    if status in ACTIVE and (goal_id == wanted or not any(wanted)):
                        self.end(goal_id, 5)
            case "get_result":
                goal_id = bytes(wire.ResultRequest.deserialize(request).goal_id.uuid)
                if self.goals.get(goal_id, 0) in ACTIVE:
                    self.questions.append((goal_id, reply))
                else:
                    reply(wire.ResultJazzy(self.goals.get(goal_id, 0), 0).serialize())
            case _:
                pass

    def _goal(self, request: wire.SendGoalRequest, reply: Then) -> None:
        goal_id = bytes(request.goal_id.uuid)
        if goal_id in self.goals:
            self.crashed = "a known goal id came again"
            return
        position = request.pose.pose.position
        self.places[goal_id] = (position.x, position.y)
        self.trees[goal_id] = request.behavior_tree
        running = self.running()
        self.goals[goal_id] = 2
        reply(wire.SendGoalResponse(True, Time()).serialize())
        if running is not None and self.trees[running] != request.behavior_tree:
            self.end(goal_id, 6)
            return
        if running is not None:
            self.end(running, 6)
        self.began.append(goal_id)

    def end(self, goal_id: bytes, status: int, code: int = 0) -> None:
        """End a goal, and answer who asked for its result."""
        self.goals[goal_id], self.ended[goal_id] = status, self.clock()
        for asked, reply in list(self.questions):
            if asked == goal_id:
                self.questions.remove((asked, reply))
                reply(wire.ResultJazzy(status, code).serialize())

    def status(self) -> bytes:
        """Return the status of every goal."""
        return wire.GoalStatusArray(
            [
                wire.GoalStatus(wire.GoalInfo(Uuid(list(goal_id)), Time()), status)
                for goal_id, status in self.goals.items()
            ]
        ).serialize()


class Rig:
    """A navigator and a server, with a link between them that a history controls."""

    def __init__(self, world: World) -> None:
        self.now_s, self.world = 100.0, world
        self.server = Server(lambda: self.now_s)
        self.requests: deque[tuple[str, bytes, Then]] = deque()
        self.replies: deque[tuple[Then, bytes | None]] = deque()
        entry = RobotEntry(can=("move_to", "block", "return_to_base"), trees=TREES)
        connection = Connection(
            frames={"NorthGate": (0.0, 34.0), "EastGate": (54.0, 0.0)}, robots={"Ugv_T01": entry}
        )
        site = RobotSite(world, connection, MapFit(0.0, (0.0, 0.0), ("NorthGate", 0.0)))
        self.navigator = Navigator("Ugv_T01", site, self.call, clock=lambda: self.now_s)
        self.answers: list[DeviceAnswer] = []
        self.sent: list[DeviceCommand] = []
        self.whole = True

    def call(self, service: str, request: bytes, limit_s: float, then: Then) -> bool:
        """Put a request on the link."""
        if "/" in service:
            return True
        self.requests.append((service, request, then))
        return True

    def deliver(self) -> None:
        """Let the oldest request reach the server, and its answer the link."""
        if not self.requests:
            return
        service, request, then = self.requests.popleft()
        open_ = [True]

        def reply(payload: bytes | None) -> None:
            if open_[0]:
                open_[0] = False
                self.replies.append((then, payload))

        self.server.take(service, request, reply)

    def lose_request(self) -> None:
        """Lose the oldest request."""
        if self.requests:
            self.replies.append((self.requests.popleft()[2], None))

    def lose_reply(self) -> None:
        """Lose the oldest answer."""
        if self.replies:
            then, _ = self.replies.popleft()
            then(None)

    def receive(self) -> None:
        """Let the oldest answer arrive."""
        if self.replies:
            then, payload = self.replies.popleft()
            then(payload)
        self.take()

    def take(self) -> None:
        """Let the navigator work, and take its answers."""
        self.navigator.step()
        self.answers += self.navigator.take()

    def see(self) -> None:
        """Let a report of the robot arrive."""
        moving = self.server.running() is not None
        self.navigator.see_place(Seen(self.server.at, 0.0, 4.0 if moving else 0.0, self.now_s))
        self.take()

    def tell_status(self) -> None:
        """Let its status arrive."""
        self.navigator.see_states(messages.read_goal_states(self.server.status()))
        self.take()

    def send(self, command: DeviceCommand) -> None:
        """Send a command, or send it again."""
        if command not in self.sent:
            self.sent.append(command)
        self.navigator.send(command)
        self.take()

    def settle(self) -> None:
        """Let everything that is on its way arrive."""
        for _ in range(200):
            self.deliver()
            self.receive()

    def said(self, command_id: str) -> list[str]:
        """Return the statuses of the answers to a command."""
        return [a.status for a in self.answers if a.command_id == command_id]


STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("order"), st.sampled_from(("move_to", "block", "return_to_base"))),
        st.tuples(st.just("hold"), st.just("")),
        st.tuples(st.just("again"), st.integers(0, 5)),
        st.tuples(st.sampled_from(("deliver", "deliver", "lose_request")), st.just("")),
        st.tuples(st.sampled_from(("receive", "receive", "lose_reply")), st.just("")),
        st.tuples(st.just("wait"), st.sampled_from((0.1, 1.0, 3.0, 11.0))),
        st.tuples(st.sampled_from(("arrive", "abort", "see", "tell_status")), st.just("")),
    ),
    max_size=60,
)


def play(rig: Rig, steps: list[tuple[str, object]]) -> None:
    number = 0
    for name, value in steps:
        match name:
            case "order":
                number += 1
                target = None if value == "return_to_base" else "NorthGate"
                rig.send(_command(f"c{number}", str(value), target))
            case "hold":
                number += 1
                rig.send(_command(f"h{number}", "hold", None))
            case "again":
                if rig.sent:
                    rig.send(rig.sent[-1 - int(str(value)) % len(rig.sent)])
            case "wait":
                rig.now_s += float(str(value))
                rig.server.forget()
                rig.take()
            case "arrive" | "abort":
                running = rig.server.running()
                if running is not None:
                    if name == "arrive":
                        rig.server.at = rig.server.places[running]
                    rig.server.end(running, 4 if name == "arrive" else 6, 208)
            case _:
                getattr(rig, name)()
        check(rig)


def check(rig: Rig) -> None:
    server = rig.server
    assert not server.crashed
    assert len(server.began) == len(set(server.began)), "a goal was carried out twice"
    for command in rig.sent:
        if command.verb == "hold":
            continue
        said = rig.said(command.command_id)
        final = {status for status in said if status in FINAL_REPLIES}
        assert len(final) <= 1, (command, said)


def _command(name: str, verb: str, target: str | None) -> DeviceCommand:
    return DeviceCommand.model_validate(
        {"command_id": name, "agent": "Ugv_T01", "verb": verb, "target": target}
    )


@settings(max_examples=150)
@given(steps=STEPS)
def test_no_history_lets_a_robot_do_a_thing_twice(
    world: World, steps: list[tuple[str, object]]
) -> None:
    rig = Rig(world)
    play(rig, steps)
    rig.settle()
    check(rig)


@settings(max_examples=80)
@given(steps=STEPS)
def test_after_any_history_a_hold_holds(world: World, steps: list[tuple[str, object]]) -> None:
    rig = Rig(world)
    play(rig, steps)
    hold = _command("last", "hold", None)
    rig.send(hold)
    before = len(rig.server.began) + sum(name == "send_goal" for name, _, _ in rig.requests)
    for _ in range(4):
        rig.settle()
        rig.now_s += 1.0
        rig.tell_status()
        rig.see()
    assert "done" in rig.said("last")
    assert rig.server.running() is None
    assert rig.navigator.task == "holding"
    assert len(rig.server.began) <= before, "a goal began after the hold that was not on its way"
    for command in rig.sent:
        if command.verb != "hold":  # not one of them is left without its last answer
            assert FINAL_REPLIES & set(rig.said(command.command_id)), command


@settings(max_examples=40)
@given(steps=STEPS)
def test_a_hold_is_not_done_while_the_robot_moves(
    world: World, steps: list[tuple[str, object]]
) -> None:
    rig = Rig(world)
    play(rig, steps)
    rig.send(_command("last", "hold", None))
    for _ in range(4):
        rig.settle()
        rig.now_s += 1.0
        rig.navigator.see_place(Seen(rig.server.at, 0.0, 1.0, rig.now_s))
        rig.take()
    assert "done" not in rig.said("last")


def test_a_hold_is_not_done_before_the_robot_says_that_its_goal_is_over(world: World) -> None:
    rig = Rig(world)
    rig.send(_command("c", "move_to", "NorthGate"))
    rig.settle()
    rig.send(_command("h", "hold", None))
    rig.deliver()
    rig.receive()
    rig.now_s += 0.1
    rig.see()
    assert rig.said("h") == ["acknowledged"]
    rig.settle()
    rig.see()
    assert rig.said("h") == ["acknowledged", "done"]
    assert rig.answers[-2].detail == "stopped by a hold"


def test_an_order_that_got_lost_is_sent_once_more_and_only_then(world: World) -> None:
    rig = Rig(world)
    order = _command("c", "move_to", "NorthGate")
    rig.send(order)
    rig.lose_request()
    rig.receive()
    rig.send(order)
    assert [name for name, _, _ in rig.requests] == ["get_result"]
    rig.settle()
    assert rig.said("c") == ["acknowledged"]
    assert len(rig.server.began) == 1


def test_an_order_whose_answer_got_lost_is_not_sent_again(world: World) -> None:
    rig = Rig(world)
    order = _command("c", "move_to", "NorthGate")
    rig.send(order)
    rig.deliver()
    rig.lose_reply()
    rig.send(order)
    rig.settle()
    rig.tell_status()
    assert rig.said("c") == ["acknowledged"]
    rig.server.at = (0.0, 34.0)
    rig.see()
    rig.server.end(rig.server.began[0], 4)
    rig.settle()
    assert rig.said("c") == ["acknowledged", "done"]
    assert len(rig.server.began) == 1


def test_a_robot_that_may_have_forgotten_an_order_does_not_get_it_again(world: World) -> None:
    rig = Rig(world)
    order = _command("c", "move_to", "NorthGate")
    rig.send(order)
    rig.deliver()
    rig.lose_reply()
    rig.server.end(rig.server.began[0], 4)
    rig.now_s += 11.0
    rig.send(order)
    rig.settle()
    assert rig.said("c") == ["failed"]
    assert "may have carried it out" in rig.answers[-1].detail
    assert len(rig.server.began) == 1


def test_another_behavior_tree_waits_until_the_running_goal_is_cancelled(world: World) -> None:
    rig = Rig(world)
    rig.send(_command("c1", "move_to", "NorthGate"))
    rig.settle()
    rig.send(_command("c2", "block", "NorthGate"))
    assert [name for name, _, _ in rig.requests] == ["cancel_goal"]
    rig.settle()
    rig.tell_status()
    rig.settle()
    assert rig.said("c1") == ["acknowledged", "failed"]
    assert rig.answers[1].detail == "a newer order took its place"
    assert rig.said("c2") == ["acknowledged"]
    assert len(rig.server.began) == 2


def test_a_robot_that_is_not_where_it_says_has_not_arrived(world: World) -> None:
    rig = Rig(world)
    rig.send(_command("c", "move_to", "NorthGate"))
    rig.settle()
    rig.server.end(rig.server.began[0], 4)
    rig.settle()
    rig.see()
    assert rig.said("c") == ["acknowledged"]
    rig.now_s += 2.1
    rig.see()
    assert rig.said("c") == ["acknowledged", "failed"]
    assert rig.answers[-1].detail == "it says that it is at NorthGate, but reports itself 34 m away"


def test_a_goal_that_overtakes_a_hold_is_cancelled(world: World) -> None:
    rig = Rig(world)
    rig.send(_command("c", "move_to", "NorthGate"))
    rig.send(_command("h", "hold", None))
    rig.requests.rotate(1)
    rig.settle()
    assert rig.server.running() is None
    assert "failed" in rig.said("c")


@pytest.mark.parametrize("verb", ["observe", "identify", "warn"])
def test_what_a_robot_cannot_do_is_refused(world: World, verb: str) -> None:
    rig = Rig(world)
    rig.send(_command("c", verb, "NorthGate"))
    assert rig.said("c") == ["refused"]
    assert rig.answers[-1].detail.startswith(f"it is not able to {verb}")
    assert not rig.requests


def test_a_goal_from_elsewhere_is_told_and_shown(world: World) -> None:
    rig = Rig(world)
    rig.navigator.see_states({bytes(range(16)): GoalState.EXECUTING})
    assert rig.navigator.problems == ["drives to a goal that was not given from here"]
    assert rig.navigator.task == "moving"
    assert math.isfinite(rig.now_s)
