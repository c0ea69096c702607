"""The console as lines: the same session, on a terminal of any kind and over pipes."""

import asyncio
import os
import pty
import re
import signal
import time

import pytest

from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision
from pa_console.terminal.typed_lines import InputLines, read_answer
from tests.cli.inside import Call
from tests.cli.outside import WITHIN_S, Outside, Start
from tests.tui import story

pytestmark = pytest.mark.long

ORDER = "Fill the gap at EastGate."
QUICK = ("--set", "approval_delay_s=0.2")
PLAIN = (*QUICK, "console", "--plain", "--no-alarms")
MOVES = re.compile(r"\x1b\[[0-9;?]*[A-HJKSTfhlsu]|\x1b[78]")
"""What moves the cursor or clears, in a terminal."""


def answered(console: Outside, line: str, kind: str) -> None:
    """Type an answer until the log tells of `kind`: one that comes too early is not taken."""
    typed = 0.0

    def again() -> None:
        nonlocal typed
        if time.monotonic() - typed > 1.0:
            console.type(f"{line}\n")
            typed = time.monotonic()

    console.until(kind, again)


def test_a_mission_goes_through_all_steps_in_lines(start: Start, call: Call) -> None:
    console = start(*PLAIN, terminal=True)
    console.until_shown("Type a mission")
    console.type(f"{ORDER}\n")
    console.until_shown("Your answer: approve")
    for told in (f"mission: {ORDER}", "rules found", "plan: Drone_T04 move_to EastGate", "judge"):
        assert told in console.shown
    console.type("move the other drone too\n")
    console.until_shown("A plan is waiting: approve")
    answered(console, "approve", "command_sent")
    console.type("status\n")
    console.until_shown("missions waiting")
    console.until_shown("finished: verified")
    assert console.kinds.count("mission_received") == 1
    console.type("quit\n")
    assert console.process.wait(WITHIN_S) == 0
    assert not MOVES.search(console.shown)
    assert call("replay", str(console.log), "--verify").code == 0


def test_stop_is_heeded_while_a_plan_runs_and_released_after_a_yes(start: Start) -> None:
    console = start(*PLAIN, terminal=True)
    console.type(f"{ORDER}\n")
    console.until_shown("Your answer: approve")
    answered(console, "approve", "command_sent")
    console.type("stop\n")
    console.until_shown("finished: cancelled")
    console.type("status\n")
    console.until_shown("STOPPED")
    console.type("release\n")
    console.until_shown("Type yes")
    console.type("no\n")
    console.until_shown("nothing was changed")
    assert "stop_released" not in console.kinds
    console.type("release\nyes\n")
    console.until("stop_released")
    console.type("quit\n")
    assert console.process.wait(WITHIN_S) == 0


def test_ctrl_c_stops_nothing_and_says_what_would(start: Start) -> None:
    console = start(*PLAIN, terminal=True)
    console.type(f"{ORDER}\n")
    console.until_shown("Your answer: approve")
    console.type("\x03")
    console.until_shown("Ctrl-C does not stop anything")
    assert "all_stopped" not in console.kinds
    answered(console, "approve", "command_sent")
    console.type("\x03")
    console.type("stop\n")
    console.until_shown("finished: cancelled")
    console.type("\x04")
    assert console.process.wait(WITHIN_S) == 0
    assert console.kinds[-2] == "session_ended"


def test_over_pipes_a_plan_is_rejected_once_nobody_can_answer(start: Start) -> None:
    console = start(*PLAIN, piped=True)
    assert console.process.stdin is not None
    printed, told = console.process.communicate(f"{ORDER}\n".encode(), timeout=WITHIN_S)
    assert console.process.returncode == 0, told
    assert "A plan waits for you" in printed.decode() or "held" in printed.decode()
    assert b"\x1b" not in printed
    assert "command_sent" not in console.kinds
    assert "session_ended" in console.kinds


def test_it_ends_in_order_when_told_to(start: Start) -> None:
    console = start(*PLAIN, piped=True)
    console.until("telemetry")
    console.process.send_signal(signal.SIGTERM)
    assert console.process.wait(WITHIN_S) == 143
    assert "session_ended" in console.kinds


def request(**options: object) -> ev.ApprovalRequested:
    told = story.told("approval", **options)  # type: ignore[arg-type]
    return next(data for data in told if isinstance(data, ev.ApprovalRequested))


def taken(line: str, **options: object) -> tuple[Decision, str]:
    """Return the decision that a line comes to, and what it asks a yes for."""
    answer = read_answer(line, request(**options))
    assert answer is not None
    assert answer.decision is not None, answer.problem
    return answer.decision, answer.confirm


def test_answers_are_whole_words_and_say_what_is_missing() -> None:
    approved, confirm = taken("Approve")
    assert (approved.kind, confirm) == ("approve", "")
    for line in ("a", "y", "yes", "approved", "app", "go on", "Show me the west gate"):
        assert read_answer(line, request()) is None
    assert taken("reject because the drone is needed")[0].reason == "the drone is needed"


@pytest.mark.parametrize(
    ("line", "options", "problem"),
    [
        ("approve", {"broken": ("WF-03",), "blocked": ("WF-03: no",)},
         "the plan cannot be approved: WF-03: no"),
        ("approve", {"verdict": "Failure"}, "approve because REASON"),
        ("modify Drone_T04 hold; Drone_T01 fly away", {}, "action 2"),
    ],
)  # fmt: skip
def test_what_cannot_be_taken_is_said(line: str, options: dict[str, object], problem: str) -> None:
    answer = read_answer(line, request(**options))
    assert answer is not None
    assert (answer.decision, problem in answer.problem) == (None, True)


def test_what_is_broken_or_objected_to_needs_a_reason_or_a_yes() -> None:
    given, confirm = taken("approve because I see it", verdict="Failure")
    assert (given.override_judge, given.reason, bool(confirm)) == (True, "I see it", True)
    assert "CAP-04" in taken("approve", broken=("CAP-04",))[1]


def test_a_plan_is_typed_anew() -> None:
    changed, _ = taken("modify Drone_T04 observe EastGate; Ugv_T02 hold")
    assert changed.plan is not None
    assert [a.command for a in changed.plan.actions] == ["observe EastGate", "hold"]


def test_a_session_in_lines_ends_with_its_terminal_while_a_plan_waits(start: Start) -> None:
    console = start(*PLAIN, terminal=True)
    console.until_shown("Type a mission")
    console.type(f"{ORDER}\n")
    console.until_shown("Your answer: approve")
    console.hang_up()
    assert console.process.wait(WITHIN_S) == 129
    assert "session_ended" in console.kinds
    assert "command_sent" not in console.kinds


async def test_the_lines_end_with_the_terminal_that_they_came_from(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ours, its = pty.openpty()
    with os.fdopen(its) as terminal, open(os.devnull) as nowhere:
        monkeypatch.setattr("sys.stdin", terminal)
        lines = InputLines(asyncio.get_running_loop())
        lines.start()
        os.dup2(nowhere.fileno(), its)
        os.close(ours)
        assert await lines.queue.get() is None
        lines.close()


def test_a_question_is_answered_in_lines_while_a_plan_waits(start: Start) -> None:
    console = start(*PLAIN, terminal=True)
    console.type(f"{ORDER}\n")
    console.until_shown("Your answer: approve")
    console.type("Why not Drone_T02?\n")
    console.until_shown("Drone_T02: it alone covers NorthGate")
    console.until_shown("The plan is still waiting")
    assert "command_sent" not in console.kinds
    assert console.kinds.count("mission_received") == 1
    answered(console, "reject not now", "mission_finished")
    console.type("Why?\n")
    console.until_shown("outcome: rejected: not now")
