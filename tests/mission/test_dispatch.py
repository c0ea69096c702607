"""Every dispatched command ends: by its device's word or by a time-out that says why."""

import random
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.mission.execution.dispatch import ACKNOWLEDGE_S, ASK_AGAIN_S, TIMED_OUT, Dispatch
from pa_console.schema.command import CommandReply, DeviceCommand, ReplyStatus

pytestmark = pytest.mark.invariant

DT_S, LIMIT_S = 0.1, 20.0
COMMANDS = tuple(
    DeviceCommand(command_id=f"M1.{number}", agent=f"Drone_T0{number}", verb="hold")
    for number in (1, 2, 3)
)
replies = st.builds(
    CommandReply,
    command_id=st.sampled_from([c.command_id for c in COMMANDS] + ["other"]),
    agent=st.sampled_from([c.agent for c in COMMANDS]),
    status=st.sampled_from(["acknowledged", "progress", "done", "failed", "refused"]),
    tick=st.integers(1, 200),
)


def reply(status: ReplyStatus, tick: int, detail: str = "") -> CommandReply:
    return CommandReply(
        command_id="M1.1", agent="Drone_T01", status=status, tick=tick, detail=detail
    )


def one() -> Dispatch:
    return Dispatch(COMMANDS[:1], tick=0, dt_s=DT_S, limit_s=LIMIT_S)


@given(st.dictionaries(st.integers(1, 200), st.lists(replies, max_size=3), max_size=20))
def test_every_command_ends_once_and_equal_replies_give_equal_resends(
    schedule: dict[int, list[CommandReply]],
) -> None:
    dispatch, twin = (Dispatch(COMMANDS, tick=0, dt_s=DT_S, limit_s=LIMIT_S) for _ in range(2))
    ended: list[str] = []
    for tick in range(1, round(LIMIT_S / DT_S) + 3):
        told = list(dispatch.advance(tick, schedule.get(tick, [])))
        assert list(twin.advance(tick, schedule.get(tick, []))) == told
        assert dispatch.resends(tick) == twin.resends(tick)
        assert dispatch.resends(tick) == []
        ended += [r.command_id for r in told if r.status in ("done", "failed", "refused")]
    assert dispatch.finished
    assert sorted(ended) == [command.command_id for command in COMMANDS]


def test_an_unanswered_command_is_sent_again_ever_later_and_then_given_up() -> None:
    dispatch, sent, gone = one(), list[tuple[int, int]](), list[CommandReply]()
    for tick in range(1, 100):
        gone += dispatch.advance(tick, [])
        sent += [(tick, times) for _, times in dispatch.resends(tick)]
    ticks = [tick for tick, _ in sent]
    assert [times for _, times in sent] == [1, 2, 3, 4, 5]
    assert ticks[0] == 10
    waits = [later - earlier for earlier, later in pairwise(ticks)]
    assert waits == sorted(waits)
    [end] = gone
    assert end.tick == round(ACKNOWLEDGE_S / DT_S) + 1
    assert end.detail == f"{TIMED_OUT}: no acknowledgement within 8 s, sent 6 times"


def test_a_device_that_falls_silent_is_asked_again_and_its_repeated_answer_is_no_news() -> None:
    dispatch = one()
    assert list(dispatch.advance(1, [reply("acknowledged", 1)])) == [reply("acknowledged", 1)]
    due = 1 + round(ASK_AGAIN_S / DT_S)
    asked = [tick for tick in range(2, due + 5) if dispatch.resends(tick)]
    assert asked == [due]
    assert list(dispatch.advance(due + 5, [reply("acknowledged", 1)])) == []
    assert dispatch.resends(due + 6) == []
    done = reply("done", 30, "at WestGate")
    assert list(dispatch.advance(due + 7, [done])) == [done]
    assert dispatch.finished
    assert dispatch.final == {"Drone_T01": done}


def test_an_answer_that_was_overtaken_is_no_news() -> None:
    dispatch = one()
    late = [reply("progress", 50, "3 m to go"), reply("acknowledged", 1)]
    assert list(dispatch.advance(52, late)) == late[:1]


def test_an_acknowledged_command_gets_its_full_time() -> None:
    dispatch = one()
    first = reply("acknowledged", 1)
    assert list(dispatch.advance(1, [first])) == [first]
    assert list(dispatch.advance(199, [])) == []
    [end] = list(dispatch.advance(201, []))
    assert end.detail == f"{TIMED_OUT}: not done within 20 s"


def test_half_the_messages_lost_still_end_most_commands_by_their_devices_word() -> None:
    rng, done = random.Random(5), 0
    for _ in range(200):
        dispatch, inbox = one(), list[CommandReply]()
        reached, sent = False, True
        for tick in range(1, 220):
            reached = reached or (sent and rng.random() > 0.5)
            answer = reply("done", 5) if reached else None
            inbox = [answer] if answer and sent and rng.random() > 0.5 else []
            list(dispatch.advance(tick, inbox))
            sent = bool(dispatch.resends(tick))
        done += dispatch.final["Drone_T01"].status == "done"
    assert done > 150
