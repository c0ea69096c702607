"""Two recordings are the same when they tell the same, whenever and wherever they were made."""

from datetime import timedelta
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.schema.events import event as ev
from pa_console.schema.finding import Usage
from pa_console.schema.mission import Decision, Mission
from pa_console.session.recording import Recording
from pa_console.views.comparison import ENDED, TICK, SessionComparison, compare_sessions
from pa_console.views.event_words import event_in_words, search
from tests.schema.strategies import events
from tests.session.logs import kept, write_log
from tests.session.story import PLAN, START, session_started


def elsewhere(event: ev.Event) -> ev.Event:
    """The same event on another day, in another session, on another machine."""
    data = event.data
    match data:
        case ev.SessionStarted():
            update = {"session": "S2", "version": "9", "grammar_sha256": "f" * 64}
            data = data.model_copy(update=update)
        case ev.MissionReceived(mission=mission):
            later = mission.model_copy(update={"created": START + timedelta(days=9)})
            data = data.model_copy(update={"mission": later})
        case ev.PlanProposed():
            data = data.model_copy(update={"usage": Usage(seconds=7.0, cached_tokens=3)})
        case ev.MissionFinished(metrics=metrics):
            slower = metrics.model_copy(update={"planning_s": 99.0})
            data = data.model_copy(update={"metrics": slower})
        case _:
            pass
    return event.model_copy(update={"t": event.t + timedelta(days=9), "data": data})


def compared(a: list[ev.Event], b: list[ev.Event]) -> SessionComparison:
    return compare_sessions(Recording(a), Recording(b))


def test_the_same_session_on_another_day_is_the_same(tmp_path: Path) -> None:
    other = [elsewhere(event) for event in kept()]
    assert other != kept()
    assert compared(kept(), other).same
    logs: list[Recording] = []
    for name, told in (("a", kept()), ("b", other)):
        logs.append(Recording.read(write_log(tmp_path / f"{name}.jsonl", told, name)))
    assert compare_sessions(logs[0], logs[1]).same


@given(st.lists(events(), max_size=4))
@settings(max_examples=20, deadline=None)
def test_whatever_was_told_is_the_same_as_itself(happened: list[ev.Event]) -> None:
    assert compared(happened, happened).same


def test_the_first_event_that_differs_is_named_with_its_values() -> None:
    other, place = kept(), next(n for n, e in enumerate(kept()) if e.data.kind == "plan_proposed")
    plan = PLAN.model_copy(update={"reason": "because"})
    data = other[place].data.model_copy(update={"plan": plan})
    other[place] = other[place].model_copy(update={"data": data})
    found = compared(kept(), other)
    assert found.first is not None
    assert (found.first.a, found.first.b, found.beyond) == (place, place, None)
    [change] = found.first.changes
    assert (change.path, change.a, change.b) == ("plan.reason", "look at the gate", "because")


def test_a_difference_in_telemetry_does_not_hide_one_in_what_was_done() -> None:
    less = [event for n, event in enumerate(kept()) if n != 1]
    found = compared(kept(), less)
    assert found.first is not None
    assert kept()[found.first.a].data.kind == "telemetry"
    assert found.beyond is None, "nothing else differs"
    assert not found.same
    later = [event.model_copy(update={"tick": event.tick + (event.tick > 30)}) for event in kept()]
    found = compared(kept(), later)
    assert found.first is not None
    assert [change.path for change in found.first.changes] == [TICK]
    assert found.beyond is None
    found = compared(kept(), [*less[:-2], less[-1]])
    assert found.first is not None


def test_one_that_goes_on_longer_differs_where_the_other_ends() -> None:
    found = compared(kept(), kept()[:-1])
    assert found.first is not None
    assert found.first.b == len(kept()) - 1
    assert found.first.changes[0].b == ENDED
    assert found.beyond is not None


def test_how_the_sessions_were_started_is_told_apart_from_what_happened() -> None:
    started = session_started().model_copy(update={"seed": 7})
    other = [kept()[0].model_copy(update={"data": started}), *kept()[1:]]
    found = compared(kept(), other)
    assert not found.same
    assert found.first is None
    assert [(c.path, c.a, c.b) for c in found.started] == [("seed", "0", "7")]


def test_another_world_under_the_same_name_is_told() -> None:
    started = session_started().model_copy(update={"world_sha256": "f" * 64})
    other = [kept()[0].model_copy(update={"data": started}), *kept()[1:]]
    assert [change.path for change in compared(kept(), other).started] == ["world_sha256"]


def test_words_that_only_lists_have_are_found() -> None:
    decision = Decision(kind="approve", by="operator", reason="seen", override_judge=True)
    made = ev.DecisionMade(attempt=1, decision=decision, accepted=True)
    told = [*kept(), kept()[2].model_copy(update={"data": made})]
    assert "overridden" in event_in_words(made)
    hits = search(Recording(told), "JUDGE overridden", 0, len(told))
    assert [hit.index for hit in hits] == [len(told) - 1]


@given(events())
@settings(max_examples=60, deadline=None)
def test_every_event_has_words_of_one_line(event: ev.Event) -> None:
    assert isinstance(event_in_words(event.data), str)


def test_words_are_found_in_any_case_and_order_and_not_in_names_of_fields(
    tmp_path: Path,
) -> None:
    mission = Mission(id="M2", text='say "HALT" to the\nvan – now', created=START)
    told = [*kept(), kept()[2].model_copy(
        update={"data": ev.MissionReceived(mission=mission, position=0), "mission": "M2"}
    )]  # fmt: skip
    path = write_log(tmp_path / "s.jsonl", told)
    for recording in (Recording(told), Recording.read(path)):

        def found(text: str, recording: Recording = recording) -> list[int]:
            return [hit.index for hit in search(recording, text, 0, len(recording))]

        assert found('"halt"') == found("– VAN m2") == found("van say") == [len(told) - 1]
        assert len(found("mission_received")) == 2
        assert found("position") == []
        assert found("") == []
        [hit] = search(recording, "halt", 0, len(recording))
        assert hit.excerpt.startswith('say "HALT" to the van')
