"""What an order reads as while it is typed, and what a trace tells of answers that came before."""

import pytest

from pa_console.schema.events import event as ev
from pa_console.schema.finding import Usage
from pa_console.schema.plan import Action, Plan
from pa_console.session.mission_trace import MissionTrace, apply_to_mission
from pa_console.tui.rows import plain
from pa_console.tui.widgets.trace_pane import sections
from pa_console.views.waiting import plan_in_words, reading_line
from tests.tui import story
from tests.tui.site import RULES


def drafted(**changes: object) -> MissionTrace:
    """Return the trace of a story up to its request for approval, which has `changes`."""
    trace = MissionTrace(story.MISSION)
    for payload in story.told("approval"):
        changed = changes if isinstance(payload, ev.ApprovalRequested) else {}
        apply_to_mission(trace, payload.model_copy(update=changed))
    return trace


@pytest.mark.parametrize(
    ("orders", "words"),
    [
        ([("Drone_T04", "move_to EastGate")], "Drone_T04 to East Gate"),
        ([("Drone_T04", "observe EastGate")], "Drone_T04 to East Gate, observes"),
        (
            [("Drone_T01", "return_to_base"), ("Drone_T02", "return_to_base")],
            "Drone_T01 and Drone_T02 to Base",
        ),
        (
            [("Drone_T01", "hold"), ("Robot_T01", "report"), ("Ugv_T01", "block NorthGate")],
            "Drone_T01 stays, Robot_T01 reports, Ugv_T01 to North Gate, blocks",
        ),
        ([], "nobody moves"),
    ],
)
def test_a_plan_is_told_by_who_goes_where(orders: list[tuple[str, str]], words: str) -> None:
    actions = tuple(Action(agent=agent, command=command) for agent, command in orders)
    assert plan_in_words(Plan(reason="", actions=actions), "Base") == words


def test_the_line_is_a_reading_and_never_an_approval() -> None:
    line = reading_line(drafted(), "Base")
    assert line.startswith("reads as: ")
    assert "approve" not in line.lower()


def test_a_blocked_plan_tells_what_blocks_it_and_nothing_of_gates() -> None:
    trace = drafted(state="blocked", blocked_by=("WF-03: a gate is left without cover",))
    line = reading_line(trace, "Base")
    assert line.endswith("blocked: WF-03: a gate is left without cover")


def test_what_is_missing_is_told_in_place_of_a_reading() -> None:
    trace = drafted(state="not_understood", blocked_by=("not understood: which gate?",))
    assert reading_line(trace, "Base") == "not clear yet: which gate?"


def test_a_draft_that_came_to_nothing_says_nothing() -> None:
    assert reading_line(MissionTrace(story.MISSION), "Base") == ""


def test_a_trace_tells_how_much_came_before_enter() -> None:
    trace = drafted()
    trace.attempts[-1].judge_usage = Usage(completion_tokens=9, seconds=2.0, ahead_s=1.5)
    assert "2.0 s (1.5 s before Enter)" in plain(sections(trace, {rule.id: rule for rule in RULES}))
