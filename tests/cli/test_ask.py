"""What an operator sees on the terminal before deciding, and what an answer comes to."""

import io
from pathlib import Path

import pytest

from pa_console.language.questions import Question
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision
from pa_console.session.state import SessionState
from pa_console.terminal.mission import ask_decision, show_request
from tests.cli.inside import Call, Done
from tests.cli.outside import WITHIN_S, Start
from tests.tui import story

ORDER = "Send a drone to the east gate."


def decided(monkeypatch: pytest.MonkeyPatch, typed: str, **options: object) -> Decision:
    state = SessionState()
    events = [*story.stamped(story.told("approval", **options))]
    for event in events:
        state.apply(event)
    monkeypatch.setattr("sys.stdin", io.StringIO(typed))
    request = next(e.data for e in events if isinstance(e.data, ev.ApprovalRequested))
    show_request(request, state.current)
    decision = ask_decision(request, state.current, lambda text: Question(text, "plan"))
    assert isinstance(decision, Decision), "without a terminal nothing is a question"
    return decision


def test_rules_plan_and_verdict_are_shown_before_the_question(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert decided(monkeypatch, "y\n").kind == "approve"
    told, _, _ = capsys.readouterr().err.partition("Approve?")
    for words in ("WF-03", "identify NorthGate", "Judge  ✔ Success"):
        assert words in told


def test_what_of_the_order_is_left_out_is_shown_before_the_question(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    unmet = ("1 drone to WestGate: nobody can be spared",)
    decided(monkeypatch, "n\n", unmet=unmet)
    told, _, _ = capsys.readouterr().err.partition("Approve?")
    assert f"not met {unmet[0]}" in " ".join(told.split())


def test_an_order_that_may_be_misread_is_told_before_the_question(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    decided(monkeypatch, "n\n", confidence=0.41)
    assert "read with 41% confidence" in capsys.readouterr().err.partition("Approve?")[0]


@pytest.mark.parametrize(
    ("typed", "kind"), [("n\n", "reject"), ("", "reject"), ("x\ny\n", "approve")]
)
def test_only_a_clear_yes_approves(monkeypatch: pytest.MonkeyPatch, typed: str, kind: str) -> None:
    assert decided(monkeypatch, typed).kind == kind


def test_overruling_the_judge_takes_a_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    decision = decided(monkeypatch, "y\n\nseen it myself\n", verdict="Failure")
    assert decision.override_judge
    assert decision.reason == "seen it myself"
    assert decided(monkeypatch, "y\n", verdict="Failure").kind == "reject"


def test_a_blocked_plan_is_rejected_without_a_question(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    blocked = ("WF-03: a gate is left without cover",)
    decision = decided(monkeypatch, "y\n", verdict="Failure", blocked=blocked)
    assert (decision.kind, decision.reason) == ("reject", blocked[0])
    assert "Approve?" not in capsys.readouterr().err


READINGS = ("asked: 2 drones to EastGate", "asked: hold")


@pytest.mark.parametrize(
    ("typed", "kind", "asked"),
    [
        ("2\n", "choose", READINGS[1]),
        ("7\n1\n", "choose", READINGS[0]),
        ("0\ny\n", "approve", ""),
        ("\nn\n", "reject", ""),
        ("", "reject", ""),
    ],
)
def test_what_was_meant_can_be_said_before_the_plan_is_decided_on(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    typed: str,
    kind: str,
    asked: str,
) -> None:
    decision = decided(monkeypatch, typed, confidence=0.3, readings=READINGS)
    assert (decision.kind, decision.asked) == (kind, asked)
    said = " ".join(capsys.readouterr().err.split())
    assert "read as: see to the unknown vehicle at NorthGate; the order could also mean:" in said
    assert "1 send 2 drones to EastGate" in said


def test_a_blocked_plan_can_give_way_to_what_was_meant(monkeypatch: pytest.MonkeyPatch) -> None:
    blocked = ("WF-03: a gate is left without cover",)
    options: dict[str, object] = {"blocked": blocked, "readings": READINGS}
    assert decided(monkeypatch, "1\n", **options).asked == READINGS[0]
    assert decided(monkeypatch, "0\ny\n", **options).kind == "reject"


def test_a_question_at_the_terminal_is_answered_and_the_plan_is_asked_about_again(
    start: Start,
) -> None:
    mission = start("mission", ORDER, terminal=True)
    mission.until_shown("Approve?")
    for asked, answer in (
        ("Why not Drone_T02?", "it alone covers NorthGate"),
        ("why?", "it waits for the operator"),
        ("What would you do instead?", "You asked: What would you do instead?"),
    ):
        times = mission.shown.count("Approve?")
        mission.type(f"{asked}\n")
        mission.until_shown(answer)
        mission.until_shown_times("Approve?", times + 1)
    mission.type("n\n")
    assert mission.process.wait(WITHIN_S) == 3
    kinds = mission.kinds
    assert [kinds.count(kind) for kind in ("mission_received", "question_answered")] == [1, 3]
    assert kinds.index("question_answered") < kinds.index("decision_made")
    assert "command_sent" not in kinds


def test_a_question_is_answered_where_the_order_is_asked_back_about(
    start: Start,
) -> None:
    mission = start("mission", "Send a drone to the gate with two guards.", terminal=True)
    mission.until_shown("Type a number or your words")
    mission.type("Why?\n")
    mission.until_shown("You asked: Why?")
    mission.until_shown_times("Type a number or your words", 2)
    mission.type("\n")
    assert mission.process.wait(WITHIN_S) == 3
    assert "command_sent" not in mission.kinds


TWO_GATES = (
    "mission", "Ugv_T02 to the uncovered gate.", "--approve", "auto",
    "--event", "{kind: fail, asset: Drone_T01}", "--event", "{kind: fail, asset: Ugv_T01}",
)  # fmt: skip


@pytest.mark.long
def test_an_order_that_is_asked_back_ends_with_its_choices_and_one_can_be_chosen(
    call: Call, tmp_path: Path
) -> None:
    def given(*words: str) -> Done:
        log = tmp_path / f"{len(list(tmp_path.iterdir()))}.jsonl"
        return call(*TWO_GATES, "--log", str(log), *words)

    asked = given()
    assert asked.code == 5
    assert "--choose 1  EastGate" in asked.out
    assert "--choose 2  WestGate" in asked.out
    beyond = given("--choose", "3")
    assert beyond.code == 5
    assert "the console offered only 2 choices" in beyond.out
    chosen = given("--choose", "2", "--json").json
    assert chosen["mission"]["decisions"][0]["decision"]["asked"] == "WestGate"
