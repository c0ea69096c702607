"""A mission's trace is laid out once: screen, terminal and document tell the same of it."""

import io
import re
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from markdown_it import MarkdownIt

from pa_console.export.markdown import mission_document
from pa_console.manual_pages import load_manual
from pa_console.schema.command import CommandReply
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision, Metrics
from pa_console.schema.plan import Action
from pa_console.session.mission_trace import MissionTrace
from pa_console.session.state import SessionState
from pa_console.terminal.mission import print_trace
from pa_console.terminal.output import PlainConsole
from pa_console.tui.rows import plain
from pa_console.tui.widgets.trace_pane import sections
from pa_console.views.trace_execution import report_table
from pa_console.views.trace_layout import lay_out, lay_out_proposal, progress
from pa_console.views.trace_parts import Detail, TraceOptions, TraceSection
from tests.schema.strategies import PAYLOADS, models
from tests.tui import living, story
from tests.tui.site import RULES

RULES_BY_ID = {rule.id: rule for rule in RULES}


def traced(payloads: list[ev.EventPayload]) -> MissionTrace:
    state = SessionState()
    for event in story.stamped(payloads):
        state.apply(event)
    return state.missions[story.MISSION.id]


def on_screen(trace: MissionTrace) -> str:
    return plain(sections(trace, RULES_BY_ID))


def on_terminal(trace: MissionTrace) -> str:
    console = PlainConsole(file=io.StringIO(), width=200)
    with console.capture() as captured:
        print_trace(console, trace)
    return captured.get()


def as_document(trace: MissionTrace) -> str:
    return mission_document(trace, story.STARTED, RULES_BY_ID)


def test_a_document_shows_the_picture_that_was_shown_with_the_plan() -> None:
    still = ev.CameraStill(track="Vehicle_01", camera="NorthCamera", taken_s=3.0, sha256="a" * 64)
    trace = traced([*story.told("approval"), still])
    document = mission_document(trace, story.STARTED, RULES_BY_ID, stills="../S 1.jsonl.stills")
    assert f"](<../S%201.jsonl.stills/{'a' * 64}.png>)" in document
    assert f"SHA-256 {'a' * 64}" in as_document(trace)
    assert "](<" not in as_document(trace)


def test_a_mission_goes_through_the_steps_of_the_manual() -> None:
    page = load_manual().find("missions").text
    listed = {
        f"{n}: {name.lower()}" for n, name in re.findall(r"^(\d+)\. \*\*(\w+)\*\*", page, re.M)
    }
    state, shown = SessionState(), list[list[str]]()
    for event in story.stamped(story.told("finished")):
        state.apply(event)
        for trace in state.missions.values():
            shown.append(progress(trace)[0].text.removeprefix("step ").split(" of 10: "))
    steps = [": ".join(parts) for parts in shown if len(parts) == 2]
    assert {*steps} <= listed
    numbers = [int(step.partition(":")[0]) for step in steps]
    assert numbers == sorted(numbers)
    assert {*range(2, 11)} - {*numbers} <= {6}, "only the judge is asked without a prompt"


FRONT_ENDS = (on_screen, on_terminal, as_document)


def told(front_end: Callable[[MissionTrace], str], payloads: list[ev.EventPayload]) -> str:
    """What a front end tells, as words with one blank between them and without Markdown's marks."""
    return " ".join(re.sub(r"[|*\\`#]", " ", front_end(traced(payloads))).split())


def every(level: Detail, payloads: list[ev.EventPayload], *, evidence: bool = False) -> list[str]:
    """The keys of a trace's sections, their parts included."""
    laid_out = lay_out(traced(payloads), RULES_BY_ID, TraceOptions(level, evidence=evidence))

    def keys(given: list[TraceSection]) -> list[str]:
        return [key for one in given for key in (one.key, *keys(list(one.parts)))]

    return keys(laid_out)


@pytest.mark.parametrize("front_end", FRONT_ENDS)
def test_what_stands_against_a_plan_is_told_everywhere(
    front_end: Callable[[MissionTrace], str],
) -> None:
    payloads = story.told(
        "approval",
        broken=("WF-03",),
        verdict="Failure",
        blocked=("WF-03: a gate is left without cover",),
        unmet=("1 drone to WestGate: nobody can be spared",),
        confidence=0.41,
    )
    words = told(front_end, payloads)
    for expected in (
        "1 drone to WestGate: nobody can be spared",
        "read with 41% confidence",
        "✘ 1 broken",
        "WF-03",
        "VIOLATES",
        "a gate is left without cover",
        "✘ FAILURE",
        "Nothing shows that the vehicle has to be identified now.",
    ):
        assert expected in words


@pytest.mark.parametrize("front_end", FRONT_ENDS)
def test_words_of_the_order_that_were_not_read_are_told_everywhere(
    front_end: Callable[[MissionTrace], str],
) -> None:
    gap = "'by night' is not in the reading"
    checked = ev.PlanChecked(attempt=1, findings=story.findings(), seconds=0.1, gaps=(gap,))
    assert gap in told(front_end, [*story.told("approval"), checked])


@pytest.mark.parametrize("front_end", FRONT_ENDS)
def test_what_the_operator_overrode_and_why_is_told_everywhere(
    front_end: Callable[[MissionTrace], str],
) -> None:
    over = Decision(kind="approve", override_judge=True, reason="seen from the tower")
    early = Decision(kind="approve")
    words = told(
        front_end,
        [
            *story.told("approval", verdict="Failure"),
            ev.DecisionMade(attempt=1, decision=early, accepted=False, detail="give a reason"),
            ev.DecisionMade(attempt=1, decision=over, accepted=True),
        ],
    )
    for expected in (
        "not accepted: give a reason",
        "the judge's Failure was overridden",
        "reason: seen from the tower",
    ):
        assert expected in words


@pytest.mark.parametrize("front_end", FRONT_ENDS)
def test_halts_and_the_way_to_safety_are_told_everywhere(
    front_end: Callable[[MissionTrace], str],
) -> None:
    words = told(front_end, living.halted())
    for expected in (
        "■ HALTED",
        "which covers NorthGate, has failed",
        "safe state: Drone_T04 move_to NorthGate",
    ):
        assert expected in words
    home = (Action(agent="Drone_T04", command="hold"),)
    asked = ev.ApprovalRequested(attempt=1, plan=story.PLAN, if_halted=home)
    assert "if halted: Drone_T04 holds" in told(front_end, [*story.told("approval")[:-1], asked])


@pytest.mark.parametrize("front_end", FRONT_ENDS)
def test_a_command_that_a_device_refuses_is_told_everywhere(
    front_end: Callable[[MissionTrace], str],
) -> None:
    no = CommandReply(command_id="c1", agent="Robot_T01", status="refused", tick=1, detail="stuck")
    words = told(front_end, [*story.told("executing"), ev.CommandReplied(reply=no)])
    assert "✘ REFUSED Robot_T01 identify NorthGate" in words
    assert "stuck" in words


@pytest.mark.parametrize("front_end", FRONT_ENDS)
def test_a_rule_that_the_checks_found_broken_never_complies_in_the_judge_s_list(
    front_end: Callable[[MissionTrace], str],
) -> None:
    judged = {rule.id for rule in RULES[:3]}
    [broken] = [rule.id for rule in RULES[:1]]
    said = told(front_end, story.told("approval", broken=(broken,)))
    assert f"{broken} broken: found by the checks" in said
    assert f"{broken} complies" not in said
    assert all(f"{name} complies" in said for name in judged - {broken})


@pytest.mark.parametrize("front_end", FRONT_ENDS)
def test_a_judge_without_a_verdict_means_hold_everywhere(
    front_end: Callable[[MissionTrace], str],
) -> None:
    silent = ev.PlanJudged(attempt=1, verdict=None, error="no answer in 30 s")
    words = told(front_end, [*story.told("approval")[:-2], silent])
    for expected in ("? no verdict", "means hold", "no answer in 30 s"):
        assert expected in words


def test_a_step_of_a_mission_that_was_cancelled_is_not_under_way() -> None:
    payloads = [
        *story.told("approval")[:-2],
        ev.TextStreamed(role="judge", attempt=1, text='{"feedback": "asked'),
    ]
    assert "▶ under way" in on_screen(traced(payloads))
    finished = ev.MissionFinished(
        status="cancelled", reason="cancelled by the operator", metrics=Metrics()
    )
    words = on_screen(traced([*payloads, finished]))
    assert "– interrupted" in words
    assert "under way" not in words


@pytest.mark.parametrize("front_end", FRONT_ENDS)
def test_who_had_a_part_in_the_only_answer_is_told_everywhere(
    front_end: Callable[[MissionTrace], str],
) -> None:
    given = ev.PlanProposed(attempt=1, text="{}", plan=story.PLAN, given=True)
    words = told(front_end, [*story.told("planning"), given])
    assert "its commands given by the console" in words


@pytest.mark.parametrize("front_end", [on_terminal, as_document])
def test_what_a_terminal_would_obey_is_told_as_its_escape(
    front_end: Callable[[MissionTrace], str],
) -> None:
    plan = story.PLAN.model_copy(update={"reason": "do not\r\x07\x1b[2J hold \u202e"})
    proposed = ev.PlanProposed(attempt=1, text="{}", plan=plan)
    written = front_end(traced([*story.told("planning"), proposed]))
    assert not set("\x07\x1b\u202e") & set(written)
    for shown in (r"\x07", "x1b", "u202e"):
        assert shown in written


def test_a_level_of_detail_has_all_that_the_one_before_it_has() -> None:
    for payloads in (living.workflow(), living.halted(), story.told("finished")):
        brief, full, record = (set(every(level, payloads)) for level in Detail)
        assert brief <= full <= record
        assert "digest" in full - brief


def test_the_telemetry_that_decided_is_told_where_it_is_asked_for() -> None:
    payloads = story.told("approval")
    assert "evidence-1" in every(Detail.BRIEF, payloads, evidence=True)
    assert "evidence-1" not in every(Detail.RECORD, payloads)


def test_a_proposal_holds_the_rules_and_the_attempt_and_nothing_after_it() -> None:
    trace = traced(story.told("finished"))
    told_of = [
        part.key for part in lay_out_proposal(trace, 1, RULES_BY_ID, TraceOptions(Detail.BRIEF))
    ]
    assert told_of == ["rules", "plan-1", "rehearsal-1", "checks-1", "verdict-1"]


def test_names_are_never_cut_and_stay_in_line() -> None:
    long = Action(agent="Drone_of_the_northern_reserve_07", command="observe NorthGate")
    plan = story.PLAN.model_copy(update={"actions": (*story.PLAN.actions, long)})
    proposed = ev.PlanProposed(attempt=1, text="{}", plan=plan)
    text = on_terminal(traced([*story.told("planning"), proposed]))
    lines = [line for line in text.splitlines() if line.rstrip().endswith("NorthGate")]
    assert len(lines) == len(plan.actions)
    verbs = zip(lines, ("observe", "identify", "observe"), strict=True)
    assert len({line.index(verb) for line, verb in verbs}) == 1
    assert long.agent in text


@given(st.lists(st.sampled_from(PAYLOADS).flatmap(models), max_size=10), st.sampled_from(Detail))
@settings(max_examples=60, deadline=None)
def test_whatever_happened_can_be_laid_out(payloads: list[ev.EventPayload], level: Detail) -> None:
    trace = traced([ev.MissionReceived(mission=story.MISSION, position=0), *payloads])
    names = [part.key for part in lay_out(trace, {}, TraceOptions(level, evidence=True))]
    assert len(names) == len(set(names))
    assert on_terminal(trace)
    tokens = MarkdownIt("gfm-like").parse(as_document(trace))
    heads = [tokens[n + 1].content for n, t in enumerate(tokens) if t.type == "heading_open"]
    assert heads[0] == f"Mission {story.MISSION.id}"


REPORT = """\
M001-ab verified: Look at the vehicle.
Raised by A001 (high) at 300 s: an unknown vehicle approaches NorthGate
Rules: ROE-02, WF-03
Plan 1 for 'Look there.'. Rationale: It was not seen: look first.
- Drone_T04 observe NorthGate: pass, seen there
By telemetry as of 312.5 s: pass, all actions seen
All gates covered.
"""


def test_every_line_of_a_report_is_a_row_with_what_it_is_about_first() -> None:
    rows = [tuple(span.text for span in row) for row in report_table(REPORT).rows]
    assert rows == [
        ("M001-ab verified", "Look at the vehicle."),
        ("Raised by A001 (high) at 300 s", "an unknown vehicle approaches NorthGate"),
        ("Rules", "ROE-02, WF-03"),
        ("Plan 1 for 'Look there.'", "Rationale: It was not seen: look first."),
        ("Drone_T04 observe NorthGate", "pass, seen there"),
        ("By telemetry as of 312.5 s", "pass, all actions seen"),
        ("Gates", "all covered"),
    ]


def test_an_empty_report_has_no_row_and_a_strange_line_stays_whole() -> None:
    assert report_table("").rows == ()
    (row,) = report_table("nothing to say").rows
    assert [span.text for span in row] == ["", "nothing to say"]
