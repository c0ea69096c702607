"""The benchmark `start`: what it reads off a console's screen, and what it prints of the goals."""

import re
import sys

import pytest

from pa_console.llm.models.catalogue import LocalModel
from tests.benchmarks.conftest import Measure
from tests.benchmarks.harness import Tell
from tests.benchmarks.start import console_start, start
from tests.benchmarks.start.console_start import ConsoleStart, StartError
from tests.benchmarks.start.start import Screen, StartTime
from tests.scripted import ScriptedEngine

TIMES = [
    StartTime(name=name, goal_s=goal, cold=cold, median_s=1.0, most_s=3.0, runs_s=(0.5, 1.0, 3.0))
    for name, goal, cold in (("help", None, False), ("paint", 0.5, False), ("ready", 2.0, True))
]


def program(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    """Put a program that runs `text` in the place of the console."""
    monkeypatch.setattr(console_start, "COMMAND", (sys.executable, "-c", text))


def test_a_text_is_found_between_colours_and_when_it_comes_in_pieces(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    program(
        monkeypatch,
        "import sys\n"
        "for piece in ('\\x1b[2J\\x1b[1;1Hpain', 'ted \\x1b[2mmodel \\x1b[0;3', '2m* ready'):\n"
        "    sys.stdout.write(piece); sys.stdout.flush()\n"
        "sys.stdin.read()",
    )
    with ConsoleStart([], {}) as console:
        painted = console.wait_for(re.compile("painted"))
        ready = console.wait_for(re.compile(r"model \S ready"))
    assert 0.0 < painted <= ready


def test_a_console_that_does_not_come_up_is_told_with_its_last_words(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    program(monkeypatch, "print('error: no such world')")
    with (
        ConsoleStart([], {}) as console,
        pytest.raises(StartError, match="error: no such world"),
    ):
        console.wait_for(re.compile("painted"))


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let all have been measured, but for the cold starts."""

    def measure_start(
        _model: LocalModel, _screen: Screen, _runs: int, tell: Tell
    ) -> tuple[list[StartTime], str]:
        tell("help", 0.0)
        return TIMES, "it was kept in memory"

    def find_model(_: str | None) -> LocalModel:
        return ScriptedEngine([]).model

    monkeypatch.setattr(start, "measure_start", measure_start)
    monkeypatch.setattr(start, "find_model", find_model)


@pytest.mark.usefixtures("measured")
def test_times_stand_beside_their_goals_and_cold_ones_are_said_apart(bench: Measure) -> None:
    done = bench("start")
    assert done.code == 0, done.err
    rows = {
        line.split()[0].strip(","): line.split() for line in done.out.splitlines() if "1.00" in line
    }
    assert rows["help"][-2:] == ["1.00", "3.00"]
    assert rows["paint"][-4:] == ["1.00", "3.00", "0.5", "NO"]
    assert rows["ready"][-4:] == ["1.00", "3.00", "2", "yes"]
    assert "cold" in rows["ready"]
    assert "cold" not in rows["paint"]
    assert "not measured cold: it was kept in memory" in done.said


@pytest.mark.usefixtures("measured")
def test_the_report_has_every_run(bench: Measure) -> None:
    report = bench("start").figures
    assert [time["runs_s"] for time in report["times"]] == [[0.5, 1.0, 3.0]] * len(TIMES)
    assert [time["cold"] for time in report["times"]] == [False, False, True]
    assert (report["model"], report["cold_problem"]) == ("scripted", "it was kept in memory")
