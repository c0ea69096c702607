"""What a relieved station leaves is told, and what it had sent is never begun again elsewhere."""

from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.schema.events import event as ev
from pa_console.session.state import SessionState
from pa_console.station.earlier_session import LeftMissions
from tests.schema.strategies import events
from tests.session.logs import folded
from tests.session.story import at, story


def test_a_mission_that_waits_for_its_approval_is_taken_over() -> None:
    asked = next(n for n, e in enumerate(story()) if isinstance(e.data, ev.ApprovalRequested))
    state = folded(story()[: asked + 1])
    left = LeftMissions.of(state)
    assert state.current is not None
    assert left.again == (state.current.mission,)
    assert list(left.notices("north")) == []


def test_a_mission_that_has_moved_somebody_is_only_told_of() -> None:
    sent = next(n for n, e in enumerate(story()) if isinstance(e.data, ev.CommandSent))
    state = folded(story()[: sent + 1])
    left = LeftMissions.of(state)
    assert left.again == ()
    (text,) = left.notices("north")
    assert state.current is not None
    (command,) = (trace.command for trace in state.current.commands.values())
    assert f"{state.current.mission.id} “" in text
    assert f"({command.agent} {command.verb} {command.target})" in text
    assert text.startswith("north had ")


def test_of_a_session_that_was_closed_nothing_is_left() -> None:
    asked = next(n for n, e in enumerate(story()) if isinstance(e.data, ev.ApprovalRequested))
    happened = [*story()[: asked + 1], at(99.0, ev.SessionEnded(reason="closed"))]
    assert LeftMissions.of(folded(happened)) == LeftMissions()


@given(st.lists(st.one_of(st.sampled_from(story()), events()), max_size=30))
@settings(max_examples=150, deadline=None)
def test_whatever_happened_no_mission_is_both_or_over(happened: list[ev.Event]) -> None:
    state = SessionState()
    for event in happened:
        state.apply(event)
    left = LeftMissions.of(state)
    again, under_way = {m.id for m in left.again}, {t.mission.id for t in left.under_way}
    assert not again & under_way
    moved = {name for name, trace in state.missions.items() if trace.commands}
    over = {name for name, trace in state.missions.items() if trace.status is not None}
    assert not again & (moved | over)
    assert under_way <= moved - over
