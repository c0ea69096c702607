"""What a robot takes from the bus: each command once, and nothing old, forged or for others."""

from collections import Counter
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.fleets.vda5050 import commands, messages
from pa_console.fleets.vda5050.vehicle import EXPIRY_S, Vehicle
from pa_console.fleets.vda5050.wire import Identity
from pa_console.schema.command import CommandReply, DeviceCommand, ReplyStatus, Verb

ME, OTHER = Identity("acme", "Drone_T01"), Identity("acme", "Drone_T02")
START = datetime(2026, 3, 1, 12, tzinfo=UTC)
OFFERS: frozenset[Verb] = frozenset(("hold", "move_to", "observe", "return_to_base", "report"))


class Robot:
    """A vehicle with a clock of its own, and a device that notes what it gets."""

    def __init__(self, **options: Any) -> None:
        self.time = START
        self.got: list[DeviceCommand] = []
        self.tokens: list[str | None] = []
        self.vehicle = Vehicle(ME, OFFERS, lambda: self.time, **options)

    def header(self, identity: Identity = ME, sent: datetime | None = None) -> dict[str, Any]:
        """Return a header of now."""
        return {
            "header_id": 1,
            "timestamp": sent or self.time,
            "manufacturer": identity.manufacturer,
            "serial_number": identity.serial_number,
        }

    def order(
        self,
        number: int,
        verb: str = "move_to",
        target: str | None = "EastGate",
        token: str | None = None,
        **header: Any,
    ) -> list[DeviceCommand]:
        """Send an order; return what the device gets."""
        given = ((commands.TARGET, target), (commands.AUTHORIZATION, token))
        action = messages.RobotAction(
            action_id=f"c{number}",
            action_type=verb,
            blocking_type="HARD",
            action_parameters=tuple(
                messages.ActionParameter(key=key, value=value) for key, value in given if value
            ),
        )
        node = messages.Node(
            node_id=target or "Base", sequence_id=0, released=True, actions=(action,)
        )
        got = self.vehicle.take_order(
            messages.Order(
                **self.header(**header),
                order_id=f"c{number}",
                order_update_id=0,
                nodes=(node,),
                edges=(),
            )
        )
        return self.note(list(got))

    def at_once(self, *actions: messages.RobotAction, **header: Any) -> list[DeviceCommand]:
        """Send instant actions; return what the device gets."""
        message = messages.InstantActions(**self.header(**header), actions=actions)
        return self.note(list(self.vehicle.take_actions(message)))

    def hold(self, number: int, **header: Any) -> list[DeviceCommand]:
        """Send a hold."""
        command = DeviceCommand(command_id=f"c{number}", agent=ME.serial_number, verb="hold")
        return self.at_once(*commands.actions_at_once(command, None), **header)

    def resume(self, number: int, **header: Any) -> list[DeviceCommand]:
        """Send the end of a pause."""
        command = DeviceCommand(command_id=f"c{number}", agent=ME.serial_number, verb="report")
        return self.at_once(commands.resume_for(command), **header)

    def note(self, got: list[DeviceCommand]) -> list[DeviceCommand]:
        """Note what the device gets."""
        self.got += got
        return got

    def answer(self, number: int, status: ReplyStatus) -> None:
        """Let the device answer."""
        self.vehicle.hear(
            CommandReply(command_id=f"c{number}", agent=ME.serial_number, status=status, tick=0)
        )

    def states(self) -> dict[str, str]:
        """Return the status of every action that the state names."""
        told = (*self.vehicle.action_states, *self.vehicle.instant_action_states)
        return {state.action_id: state.action_status for state in told}

    def refused(self) -> list[str]:
        """Return why something was refused."""
        return [error.error_description or "" for error in self.vehicle.errors]


def test_an_order_that_comes_again_is_taken_once_whatever_it_says_then() -> None:
    robot = Robot()
    first = DeviceCommand(command_id="c1", agent="Drone_T01", verb="move_to", target="EastGate")
    assert robot.order(1) == [first]
    robot.answer(1, "acknowledged")
    assert robot.order(1) == []
    assert robot.order(1, "observe", "WestGate") == []
    robot.answer(1, "done")
    assert robot.order(1) == []
    assert robot.states() == {"c1": "FINISHED"}
    for number in range(2, 200):
        robot.order(number)
        robot.answer(number, "done")
    assert robot.order(1) == []


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"sent": START - timedelta(seconds=1)}, "before this robot started"),
        ({"identity": OTHER}, "Drone_T02"),
        ({"verb": "block"}, "cannot block"),
        ({"verb": "explode"}, "cannot explode"),
    ],
)
def test_what_is_not_for_it_is_refused_for_good(changed: dict[str, Any], why: str) -> None:
    robot = Robot()
    assert robot.order(1, **changed) == []
    assert why in robot.refused()[-1]
    assert robot.vehicle.errors[-1].refers_to("c1")
    assert robot.order(1) == []


@pytest.mark.parametrize("late_s", [-EXPIRY_S - 1, EXPIRY_S + 1])
def test_an_order_of_another_time_is_refused_for_good(late_s: float) -> None:
    robot = Robot()
    sent = robot.time = START + timedelta(minutes=1)
    robot.time = sent + timedelta(seconds=late_s)
    assert robot.order(1, sent=sent) == []
    assert len(robot.refused()) == 1
    robot.time = sent
    assert robot.order(1) == []


def test_without_a_good_token_nothing_moves_but_a_hold_always_comes_through() -> None:
    def verify(token: str | None, command: DeviceCommand) -> str:
        return "" if token == f"signed {command.command_id}" else "nobody has approved it"

    robot = Robot(verify=verify)
    assert robot.order(1) == []
    assert robot.order(2, token="signed c1") == []
    assert robot.refused() == ["nobody has approved it"] * 2
    assert [c.verb for c in robot.order(3, token="signed c3")] == ["move_to"]
    assert [c.verb for c in robot.hold(4)] == ["hold"]


def test_a_hold_is_never_too_old_and_comes_from_before_the_start() -> None:
    robot = Robot()
    robot.time += timedelta(hours=1)
    assert [c.verb for c in robot.hold(1, sent=START - timedelta(hours=1))] == ["hold"]
    assert robot.vehicle.paused


def test_a_stop_under_an_id_that_was_used_before_stops_all_the_same() -> None:
    robot = Robot()
    robot.hold(1)
    robot.answer(1, "done")
    robot.resume(1)
    robot.time += timedelta(seconds=1)
    assert [c.verb for c in robot.order(2)] == ["move_to"]
    robot.time += timedelta(seconds=1)
    assert [c.verb for c in robot.hold(1)] == ["hold"]
    assert robot.vehicle.paused
    assert robot.states()["c1"] == "WAITING", "the answer to the earlier stop is none to this one"


@pytest.mark.parametrize("relays", [False, True])
def test_a_stop_under_the_id_of_an_order_stops_and_the_order_never_comes_back(relays: bool) -> None:
    robot = Robot(relays=relays)
    robot.order(1)
    assert [c.verb for c in robot.hold(1)] == ["hold"]
    assert "move_to" not in {c.verb for c in robot.order(1)}


def test_an_order_that_was_sent_before_a_stop_is_refused_after_it() -> None:
    robot = Robot()
    robot.time += timedelta(seconds=2)
    robot.hold(1)
    robot.resume(1)
    robot.time += timedelta(seconds=1)
    assert robot.order(2, sent=START + timedelta(seconds=1)) == []
    assert robot.refused() == ["it was sent before this robot was stopped"]
    assert [c.verb for c in robot.order(3)] == ["move_to"]


def test_a_stop_that_claims_to_come_from_the_future_keeps_no_later_order_out() -> None:
    robot = Robot()
    robot.hold(1, sent=START + timedelta(days=1))
    robot.resume(1)
    robot.time += timedelta(seconds=1)
    assert [c.verb for c in robot.order(2)] == ["move_to"]


def test_an_order_waits_for_the_end_of_a_pause_and_dies_with_the_next_stop() -> None:
    robot = Robot()
    robot.hold(1)
    robot.answer(1, "done")
    assert robot.states() == {"c1": "FINISHED", "c1.cancel": "FINISHED"}
    assert robot.order(2) == []
    assert [c.command_id for c in robot.resume(2)] == ["c2"]
    robot.hold(3)
    assert robot.order(4) == []
    robot.hold(5)
    assert robot.states()["c4"] == "FAILED"
    assert robot.resume(6) == []


def test_an_order_that_waited_is_checked_when_the_pause_ends() -> None:
    allowed = {"c2"}

    def verify(_: str | None, command: DeviceCommand) -> str:
        return "" if command.command_id in allowed else "the station was relieved"

    robot = Robot(verify=verify)
    robot.hold(1)
    assert robot.order(2) == []
    allowed.clear()
    assert robot.resume(3) == []
    assert robot.states()["c2"] == "FAILED"
    assert robot.refused() == ["the station was relieved"]


def test_who_speaks_for_a_device_says_nothing_before_it_and_hands_on_until_it_ends() -> None:
    robot = Robot(relays=True)
    assert len(robot.order(1)) == 1
    assert robot.states() == {}
    assert robot.order(1, "observe", "WestGate") == robot.got[:1]
    robot.answer(1, "acknowledged")
    assert robot.states() == {"c1": "WAITING"}
    assert robot.order(1) == robot.got[:1]
    robot.answer(1, "done")
    assert robot.order(1) == []


SENT = st.one_of(
    st.just(("hold",)),
    st.just(("resume",)),
    st.tuples(
        st.just("order"),
        st.sampled_from(["move_to", "observe", "block", "hold", "report", "", "explode"]),
        st.sampled_from(["EastGate", "WestGate", "", None]),
        st.sampled_from([None, "good", "forged"]),
        st.sampled_from([ME, OTHER]),
        st.floats(-40.0, 40.0),
    ),
)


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 8), SENT), max_size=40))
def test_whatever_comes_is_carried_out_once_and_only_with_a_good_token(
    sent: list[tuple[int, tuple[Any, ...]]],
) -> None:
    def verify(token: str | None, _: DeviceCommand) -> str:
        return "" if token == "good" else "no"

    robot = Robot(verify=verify)
    for number, what in sent:
        robot.time += timedelta(seconds=1)
        match what:
            case ("hold",):
                assert [command.verb for command in robot.hold(number)] == ["hold"]
                assert robot.vehicle.paused
            case ("resume",):
                robot.resume(number)
            case (_, verb, target, token, identity, age_s):
                before = list(robot.got)
                stamp = robot.time - timedelta(seconds=age_s)
                robot.order(number, verb, target or "", token, identity=identity, sent=stamp)
                for command in robot.got[len(before) :]:
                    assert (token, identity) == ("good", ME)
                    assert abs(age_s) <= EXPIRY_S
                    assert command.verb == verb
                    assert command.verb in OFFERS
            case _:
                raise AssertionError(what)
    ids = Counter(command.command_id for command in robot.got if command.verb != "hold")
    assert not [command_id for command_id, times in ids.items() if times > 1]
