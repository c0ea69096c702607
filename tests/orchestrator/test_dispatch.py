"""Every dispatched command ends: by its device's word or by a time-out that says why."""

from hypothesis import given
from hypothesis import strategies as st

from pa_console.orchestrator.dispatch import ACKNOWLEDGE_S, Dispatch
from pa_console.schema.command import CommandReply, DeviceCommand

DT_S, LIMIT_S = 0.1, 10.0
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


@given(st.dictionaries(st.integers(1, 200), st.lists(replies, max_size=3), max_size=20))
def test_every_command_ends_once(schedule: dict[int, list[CommandReply]]) -> None:
    dispatch = Dispatch(COMMANDS, tick=0, dt_s=DT_S, limit_s=LIMIT_S)
    ended: list[str] = []
    for tick in range(1, round(LIMIT_S / DT_S) + 3):
        ended += [
            reply.command_id
            for reply in dispatch.advance(tick, schedule.get(tick, []))
            if reply.status in ("done", "failed", "refused")
        ]
    assert dispatch.finished
    assert sorted(ended) == [command.command_id for command in COMMANDS]


def test_silence_is_a_failure_that_names_the_time_out() -> None:
    dispatch = Dispatch(COMMANDS[:1], tick=0, dt_s=DT_S, limit_s=LIMIT_S)
    late = round(ACKNOWLEDGE_S / DT_S) + 1
    [reply] = list(dispatch.advance(late, []))
    assert reply.status == "failed"
    assert "no acknowledgement within 3 s" in reply.detail


def test_an_acknowledged_command_gets_its_full_time() -> None:
    dispatch = Dispatch(COMMANDS[:1], tick=0, dt_s=DT_S, limit_s=LIMIT_S)
    first = CommandReply(command_id="M1.1", agent="Drone_T01", status="acknowledged", tick=1)
    assert list(dispatch.advance(1, [first])) == [first]
    assert list(dispatch.advance(99, [])) == []
    [reply] = list(dispatch.advance(101, []))
    assert "not done within 10 s" in reply.detail
