"""Random histories of one robot: nothing is done twice, a hold holds, and no answer is lost.

The robot here keeps the rules of an action server in C++: a goal id that it knows ends it, and it
forgets a goal ten seconds after its end. The link keeps the order of what it carries, and loses
requests and answers.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.fleets.link import DeviceAnswer
from pa_console.fleets.ros2.connection import Connection, MapFit, RobotEntry, RobotSite
from pa_console.fleets.ros2.messages import Planar
from pa_console.fleets.ros2.navigator import Navigator, Seen
from pa_console.schema.command import FINAL_REPLIES, DeviceCommand, Verb
from pa_console.schema.world import World

ACTIVE = (1, 2, 3)
TREES: dict[Verb, str] = {"block": "block.xml"}
Reply = Callable[[Any], object]


@dataclass
class Server:
    """An action server and its wheels, on a clock of the test's."""

    clock: Callable[[], float]
    goals: dict[bytes, int] = field(default_factory=dict[bytes, int])
    ended: dict[bytes, float] = field(default_factory=dict[bytes, float])
    trees: dict[bytes, str] = field(default_factory=dict[bytes, str])
    places: dict[bytes, Planar] = field(default_factory=dict[bytes, Planar])
    began: list[bytes] = field(default_factory=list[bytes])
    crashed: str = ""
    questions: list[tuple[bytes, Reply]] = field(default_factory=list[tuple[bytes, Reply]])
    at: tuple[float, float] = (0.0, 0.0)

    def forget(self) -> None:
        """Forget goals that ended long ago."""
        for goal_id, ended_s in list(self.ended.items()):
            if self.clock() - ended_s > 10.0:
                del self.ended[goal_id], self.goals[goal_id]

    def running(self) -> bytes | None:
        """Return the goal that it carries out."""
        return next((g for g, status in self.goals.items() if status in (1, 2)), None)

    def take(self, service: str, request: tuple[Any, ...], reply: Reply) -> None:
        """Take a request."""
        self.forget()
        goal_id = request[0]
        if service == "go":
            self._goal(request[0], request[1], request[2], reply)
        elif service == "cancel":
            reply(0)
            for known, status in list(self.goals.items()):
                if status in ACTIVE and goal_id in (known, None):
                    self.end(known, 5)
        elif self.goals.get(goal_id, 0) in ACTIVE:
            self.questions.append((goal_id, reply))
        else:
            reply((self.goals.get(goal_id, 0), ""))

    def _goal(self, goal_id: bytes, at: Planar, tree: str, reply: Reply) -> None:
        if goal_id in self.goals:
            self.crashed = "a known goal id came again"
            return
        self.places[goal_id], self.trees[goal_id] = at, tree
        running = self.running()
        self.goals[goal_id] = 2
        reply(True)
        if running is not None and self.trees[running] != tree:
            self.end(goal_id, 6)
            return
        if running is not None:
            self.end(running, 6)
        self.began.append(goal_id)

    def end(self, goal_id: bytes, status: int, why: str = "") -> None:
        """End a goal, and answer who asked for its result."""
        self.goals[goal_id], self.ended[goal_id] = status, self.clock()
        for asked, reply in list(self.questions):
            if asked == goal_id:
                self.questions.remove((asked, reply))
                reply((status, why))


class Rig:
    """A navigator and a server, with a link between them that a history controls."""

    def __init__(self, world: World) -> None:
        self.now_s, self.world, self.servers = 100.0, world, 1
        self.server = Server(lambda: self.now_s)
        self.requests: deque[tuple[str, tuple[Any, ...], Reply]] = deque()
        self.replies: deque[tuple[Reply, Any]] = deque()
        entry = RobotEntry(can=("move_to", "block", "return_to_base"), trees=TREES)
        connection = Connection(
            frames={"NorthGate": (0.0, 34.0), "EastGate": (54.0, 0.0)}, robots={"Ugv_T01": entry}
        )
        site = RobotSite(world, connection, MapFit(0.0, (0.0, 0.0), ("NorthGate", 0.0)))
        self.answers: list[DeviceAnswer] = []
        self.lines: list[str] = []
        self.navigator = Navigator(
            "Ugv_T01",
            entry,
            site,
            self,  # pyright: ignore[reportArgumentType]
            self.answers.append,
            self.lines.append,
            lambda: self.now_s,
        )
        self.sent: list[DeviceCommand] = []

    def go(self, goal_id: bytes, at: Planar, tree: str, then: Reply) -> None:
        """Put a goal on the link."""
        self.requests.append(("go", (goal_id, at, tree), then))

    def cancel(self, goal_id: bytes | None, then: Reply) -> None:
        """Put a request to cancel on the link."""
        self.requests.append(("cancel", (goal_id,), then))

    def ask(self, goal_id: bytes, then: Reply) -> None:
        """Put a question for a result on the link."""
        self.requests.append(("ask", (goal_id,), then))

    def deliver(self) -> None:
        """Let the oldest request reach the server, and its answer the link."""
        if not self.requests:
            return
        service, request, then = self.requests.popleft()
        self.server.take(service, request, lambda said: self.replies.append((then, said)))
        if self.server.crashed:
            self.replies.append((then, None))

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
            then, said = self.replies.popleft()
            then(said)
        self.navigator.step()

    def see(self) -> None:
        """Let a report of the robot arrive."""
        moving = self.server.running() is not None
        self.navigator.seen = Seen(self.server.at, 4.0 if moving else 0.0, self.now_s)
        self.navigator.step()

    def tell_status(self) -> None:
        """Let its status arrive."""
        self.navigator.see_states(dict(self.server.goals))
        self.navigator.step()

    def send(self, command: DeviceCommand) -> None:
        """Send a command, or send it again."""
        if command not in self.sent:
            self.sent.append(command)
        self.navigator.send(command)
        self.navigator.step()

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
                rig.navigator.step()
            case "arrive" | "abort":
                running = rig.server.running()
                if running is not None:
                    if name == "arrive":
                        rig.server.at = rig.server.places[running][:2]
                    rig.server.end(running, 4 if name == "arrive" else 6)
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


@settings(max_examples=100)
@given(steps=STEPS)
def test_no_history_lets_a_robot_do_a_thing_twice(
    world: World, steps: list[tuple[str, object]]
) -> None:
    rig = Rig(world)
    play(rig, steps)
    rig.settle()
    check(rig)


@settings(max_examples=150)
@given(steps=STEPS)
def test_after_any_history_a_hold_holds_and_nothing_is_sent(
    world: World, steps: list[tuple[str, object]]
) -> None:
    rig = Rig(world)
    play(rig, steps)
    before = sum(name == "go" for name, _, _ in rig.requests)
    hold = _command("last", "hold", None)
    rig.send(hold)
    assert sum(name == "go" for name, _, _ in rig.requests) == before
    before += len(rig.server.began)
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
        rig.navigator.seen = Seen(rig.server.at, 1.0, rig.now_s)
        rig.navigator.step()
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


def test_a_late_answer_to_a_hold_that_was_repeated_counts_once(world: World) -> None:
    rig = Rig(world)
    rig.send(_command("h", "hold", None))
    (_, _, answered) = rig.requests[0]
    answered(None)
    assert [name for name, _, _ in rig.requests] == ["cancel", "cancel"]
    answered(0)
    assert rig.said("h") == ["acknowledged"]
    rig.settle()
    assert rig.said("h") == ["acknowledged"]


def test_an_order_that_got_lost_is_not_sent_again(world: World) -> None:
    rig = Rig(world)
    order = _command("c", "move_to", "NorthGate")
    rig.send(order)
    rig.lose_request()
    rig.receive()
    rig.send(order)
    assert [name for name, _, _ in rig.requests] == ["ask"]
    rig.settle()
    assert rig.said("c") == ["failed"]
    assert "the goal was lost" in rig.answers[-1].detail
    assert not rig.server.began


def test_an_order_whose_answer_got_lost_is_carried_out_once(world: World) -> None:
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


def test_a_robot_that_forgot_its_goal_has_failed(world: World) -> None:
    rig = Rig(world)
    rig.send(_command("c", "move_to", "NorthGate"))
    rig.settle()
    rig.server.goals.clear()
    rig.server.questions.pop()[1](None)  # no answer in time
    rig.settle()
    assert rig.said("c") == ["acknowledged", "failed"]
    assert "was it restarted?" in rig.answers[-1].detail


def test_another_behavior_tree_waits_until_the_running_goal_is_cancelled(world: World) -> None:
    rig = Rig(world)
    rig.send(_command("c1", "move_to", "NorthGate"))
    rig.settle()
    rig.send(_command("c2", "block", "NorthGate"))
    assert [name for name, _, _ in rig.requests] == ["cancel"]
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
    why = "it reports its arrival at NorthGate, but its place is 34 m away"
    assert rig.answers[-1].detail == why


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


@pytest.mark.parametrize(
    ("servers", "why"),
    [(0, "there is no action server /Ugv_T01/navigate_to_pose"), (2, "2 action servers are")],
)
def test_without_one_action_server_only_a_hold_is_sent(
    world: World, servers: int, why: str
) -> None:
    rig = Rig(world)
    rig.servers = servers
    rig.send(_command("c", "move_to", "NorthGate"))
    rig.send(_command("h", "hold", None))
    assert rig.said("c") == ["refused"]
    assert rig.answers[0].detail.startswith(why)
    assert [name for name, _, _ in rig.requests] == ["cancel"]


def test_a_goal_from_elsewhere_is_told_and_shown(world: World) -> None:
    rig = Rig(world)
    for _ in range(2):
        rig.navigator.see_states({bytes(range(16)): 2})
    assert rig.lines == ["drives to a goal that was not given from here"]
    assert rig.navigator.task == "moving"
