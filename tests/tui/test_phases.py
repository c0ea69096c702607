"""The trace of a mission of several plans: phases, halts, resends, verifications."""

from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.schema.events import event as ev
from pa_console.tui.rows import layout, plain
from pa_console.tui.widgets.alarms import summary
from pa_console.tui.widgets.trace_pane import content, headline, progress, sections
from pa_console.views.trace_layout import standing
from tests.schema.strategies import PAYLOADS, models
from tests.tui import living, story
from tests.tui.story import MISSION


def text(payloads: list[ev.EventPayload]) -> str:
    return plain(sections(story.folded(payloads).missions[MISSION.id], {}))


def keys(payloads: list[ev.EventPayload]) -> list[str]:
    return [part.key for part in sections(story.folded(payloads).missions[MISSION.id], {})]


def test_where_in_the_workflow_the_mission_is_stands_in_its_head() -> None:
    trace = story.folded(living.workflow()).missions[MISSION.id]
    head = " ".join(item.body.plain for item in headline(trace))
    assert "Track_01 ✔ recon ✔ identify ▶ warn · escalate" in head
    assert "WF-01" in text(living.workflow())


def test_skipped_phases_and_the_end_are_told() -> None:
    moves = [living.move(0), living.move(2, skipped=("identify",))]
    assert content(standing(moves)).plain == "Track_01 ✔ recon – identify ▶ warn · escalate"
    over = [*moves, living.move(4, skipped=("identify",), outcome="it left")]
    assert (
        content(standing(over)).plain == "Track_01 ✔ recon – identify ✔ warn – escalate ■ it left"
    )


def test_earlier_phases_are_folded_with_their_outcome_and_the_last_is_spread() -> None:
    names = keys(living.workflow())
    assert names.index("round-0") < names.index("round-1") < names.index("plan-3")
    assert "plan-1" not in names
    written = text(living.workflow())
    for words in ("Phase recon  ✔ pass", "Phase identify  ? unknown", "sent again 2×",
                  "as of 05:02", "the last report of Robot_T01 is 7 s old",
                  "cover unknown: WestGate", "judge: ✔ Success"):  # fmt: skip
        assert words in written


def test_what_the_model_was_shown_is_told_with_reasons_and_what_was_left_out() -> None:
    written = text(living.workflow())
    for words in ("nearest spare", "left out: 3 gates, 1 track, 6 assets", "WestGate: cover"):
        assert words in written


def test_a_halt_is_told_with_its_reason_and_the_safe_state() -> None:
    names = keys(living.halted())
    assert names.index("round-0") < names.index("halt-1") < names.index("plan-2")
    written = text(living.halted())
    for words in ("HALTED", "which covers NorthGate, has failed", "Drone_T04 move_to NorthGate"):
        assert words in written


def test_a_mission_that_gave_way_says_to_whom() -> None:
    gone = ev.MissionPreempted(by="M-009", reason="a threat at EastGate")
    trace = story.folded([*story.told("approval"), gone]).missions[MISSION.id]
    assert "M-009 goes first: a threat at EastGate" in progress(trace).plain


def test_every_section_of_a_trace_has_a_name_of_its_own() -> None:
    for payloads in (living.workflow(), living.halted(), story.told("finished")):
        names = keys(payloads)
        assert len(names) == len(set(names))


@given(st.lists(st.sampled_from(PAYLOADS).flatmap(models), max_size=10), st.integers(20, 200))
@settings(max_examples=60, deadline=None)
def test_whatever_happened_can_be_shown(payloads: list[ev.EventPayload], width: int) -> None:
    state = story.folded([ev.MissionReceived(mission=MISSION, position=0), *payloads])
    for trace in state.missions.values():
        names = [part.key for part in sections(trace, {})]
        assert len(names) == len(set(names))
        assert plain(sections(trace, {}))
        assert progress(trace)
        assert headline(trace)
    assert summary(state, width).cell_length >= 0


def test_where_an_answer_comes_from_is_told_in_full_however_narrow_the_trace_is() -> None:
    second = ev.PlanProposed(
        attempt=2, text="{}", plan=story.PLAN, instead_of=1, given=True, as_judged=True
    )
    trace = story.folded([*story.told("approval")[:-1], second]).missions[MISSION.id]
    (heading,) = (part for part in sections(trace, {}) if part.key == "heading-2")
    assert heading.title.plain == "Attempt 2  instead of 1"
    lines = [line.plain.strip() for line in layout(heading.rows, 30)]
    assert " ".join(lines) == "its commands given by the console, as the judge read it"
