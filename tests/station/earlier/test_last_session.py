"""The last session of a world is named at the start, and its standing orders can be taken up."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.schema.events import event as ev
from pa_console.schema.mission import Alarm, StandingOrder
from pa_console.session.log.writer import LogWriter
from pa_console.session.state import SessionState
from pa_console.station.earlier.last_session import LastSession
from pa_console.station.earlier.unclosed_session import LeftMissions
from tests.schema.strategies import events
from tests.session.logs import folded
from tests.session.story import at, session_started, story

WATCH = StandingOrder(
    id="S1", text="Whenever a drone fails, send another.", each="asset", condition="it.failed",
    words="a drone fails", order="Relieve {it}.",
)  # fmt: skip
POLICY = WATCH.model_copy(update={"id": "S2", "text": "Relieve low drones."})
OVER = WATCH.model_copy(update={"id": "S3", "text": "Whenever it rains, come home."})
OPEN = Alarm(
    id="A1", kind="coverage_lost", priority="high", subject="EastGate", text="x", raised_s=1.0
)


def record(folder: Path, name: str, *told: ev.EventPayload) -> None:
    started = session_started().model_copy(update={"session": name})
    with LogWriter(folder / f"{name}.jsonl", name) as log:
        for count, payload in enumerate((started, *told)):
            log.append(at(count, payload))


def found(folder: Path, world: str) -> tuple[LastSession, list[str]]:
    """Return the last session once it was looked for, and what was told of it."""
    last = LastSession(folder, world, "U", POLICY.text)
    told = [*last.news()]
    last.wait()
    told += last.news()
    return last, [news.text for news in told if isinstance(news, ev.Noticed)]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    orders = [ev.StandingOrderApproved(order=one, by="ann") for one in (WATCH, POLICY, OVER)]
    revoked = ev.StandingOrderRevoked(order_id="S3", by="ann")
    raised = ev.AlarmRaised(alarm=OPEN)
    record(tmp_path, "night", *orders, revoked, raised, ev.SessionEnded(reason="quit"))
    return tmp_path


def test_it_is_named_with_what_was_left_open_and_in_force(folder: Path) -> None:
    last, [text] = found(folder, session_started().world_sha256)
    assert text.startswith("night ended ")
    assert "left open: 1 alarm" in text
    assert f"U submits again the orders that were in force: “{WATCH.text}”" in text
    assert OVER.text not in text, "it was revoked"
    assert POLICY.text not in text, "the world offers it anyway"
    assert last.take_up() == (WATCH.text,)
    assert last.take_up() == (), "they are given once"


def test_a_session_of_another_world_is_none(folder: Path) -> None:
    last, told = found(folder, "f" * 64)
    assert (last.orders, told) == ((), [])


def test_the_newest_one_counts(folder: Path) -> None:
    record(folder, "morning", ev.SessionEnded(reason="quit"))
    last, [text] = found(folder, session_started().world_sha256)
    assert text.startswith("morning ended ")
    assert text.endswith("nothing was left open")
    assert last.orders == ()


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
@settings(max_examples=100, deadline=None)
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
