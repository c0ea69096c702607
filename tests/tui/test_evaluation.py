"""The evaluation screen: filter, select, open a trace and come back, what is wrong is said."""

from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from textual.containers import ScrollableContainer
from textual.pilot import Pilot
from textual.widgets import Input, Select, Static

from pa_console.evaluation.reporting import report
from pa_console.evaluation.reporting.statistics import ReportTable
from pa_console.station.assembly import Site, load_site
from pa_console.tui.app import ConsoleApp, evaluation_console
from pa_console.tui.approval.panel import ApprovalPanel
from pa_console.tui.screens.dialogs import AskFolder
from pa_console.tui.screens.evaluation import EvaluationScreen
from pa_console.tui.screens.recording import RecordingScreen
from pa_console.tui.widgets.evaluation_runs import RunRows
from pa_console.tui.widgets.row_views import TextRows
from pa_console.tui.widgets.trace_pane import TracePane
from tests.tui import runs, story
from tests.tui.scripted import Show, notices, press, settle

pytestmark = pytest.mark.long

Compare = Callable[..., bool]
SIZES = {"80x24": (80, 24), "120x36": (120, 36)}


@pytest.fixture(scope="module")
def site() -> Site:
    """The shipped checkpoint."""
    return load_site("checkpoint", "checkpoint")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An evaluation of 48 runs, one of them with its log, in the user's home."""
    monkeypatch.setenv("HOME", str(tmp_path))
    made = runs.write(tmp_path / "evaluations" / "night", runs.records())
    runs.write_log(made)
    return made


def evaluation(folder: Path, site: Site) -> ConsoleApp:
    """The evaluation screen alone, as `pa-console eval show` opens it."""
    app = evaluation_console(folder, site, copies=folder / "copies")
    app.animation_level = "none"
    return app


async def read(pilot: Pilot[Any]) -> EvaluationScreen:
    """Wait until the screen has read and shown what there is."""
    screen = next(s for s in pilot.app.screen_stack if isinstance(s, EvaluationScreen))
    await pilot.pause()
    workers = [w for w in pilot.app.workers if w.group.startswith("evaluation")]
    if workers:
        await pilot.app.workers.wait_for_complete(workers)
    await pilot.pause()
    return screen


@asynccontextmanager
async def opened(
    folder: Path, site: Site, size: tuple[int, int] = SIZES["120x36"]
) -> AsyncGenerator[tuple[ConsoleApp, Pilot[Any], EvaluationScreen], None]:
    """Open the evaluation screen alone, and wait until it shows what there is."""
    app = evaluation(folder, site)
    async with app.run_test(size=size) as pilot:
        yield app, pilot, await read(pilot)


def text(screen: EvaluationScreen, part: str) -> str:
    """What a part of the screen says."""
    return str(screen.query_one(f"#{part}", Static).render())


def detail(screen: EvaluationScreen) -> str:
    """What is said of the run at the pointer."""
    return " ".join(str(screen.query_one(TextRows).render()).split())


async def test_runs_are_filtered_by_failure_and_by_words(folder: Path, site: Site) -> None:
    async with opened(folder, site) as (_, pilot, screen):
        listing = screen.query_one(RunRows)
        assert len(listing.keys) == 48
        every = runs.records()
        good = sum(run.strict for run in every)
        assert f"48 runs   strict {100 * good / 48:.1f} %" in text(screen, "evaluation-totals")
        sorts = {
            "strict": [run.run for run in every if not run.strict],
            "judge": [
                run.run for run in every
                if (run.strict and "Failure" in (run.judge_plan, run.judge_outcome))
                or (not run.strict and "Success" in (run.judge_plan, run.judge_outcome))
            ],
            "rules": [run.run for run in every if run.broken],
            "refuse": [run.run for run in every if run.expect == "refuse"],
            "all": [run.run for run in every],
        }  # fmt: skip
        for kind, expected in sorts.items():
            await pilot.press("f")
            await pilot.pause()
            assert screen.query_one("#evaluation-kind", Select).value == kind
            assert listing.keys == expected
        await pilot.press("slash", *"shot GATE 1.5b")
        await pilot.pause()
        assert listing.keys == [f"qwen2.5-coder-1.5b/full/paper/F32/{seed}" for seed in (0, 1)]
        assert "2 of 48 runs" in text(screen, "evaluation-totals")
        await pilot.press("enter")
        assert screen.focused is listing
        screen.query_one("#evaluation-search", Input).value = "nowhere"
        await pilot.pause()
        assert not listing.keys
        assert "No runs match the filter" in detail(screen)
        assert "strict" not in text(screen, "evaluation-totals")


async def test_a_run_without_an_outcome_verdict_counts_in_no_hybrid_rate(
    tmp_path: Path, site: Site
) -> None:
    given = [runs.record().model_copy(update={"hybrid": told}) for told in (True, None, None)]
    given = [run.model_copy(update={"run": f"r{n}"}) for n, run in enumerate(given)]
    async with opened(runs.write(tmp_path, given), site) as (_, pilot, screen):
        assert "hybrid 100.0 % (21–100)" in text(screen, "evaluation-totals")
        await pilot.press("down")
        await pilot.pause()
        assert "hybrid – no verdict" in detail(screen)


async def test_the_pointer_tells_everything_of_its_run(folder: Path, site: Site) -> None:
    async with opened(folder, site) as (_, pilot, screen):
        for key in ("down", "down", "end", "home", "down", "down", "down", "down"):
            await pilot.press(key)
        await pilot.pause()
        run = runs.records()[4]
        assert not run.strict
        assert run.judge_plan == "Failure"
        for words in (
            run.run, "[north] gate", "nothing but hold and report", "✘ FAILURE",
            "run.tracks.exists", "Robot_T01 identify WestGate", "before ✘ FAILURE",
            "after ✔ Success ≠ wrong",
            "2 attempts", "planning 4.5 s", "execution 38.0 s simulated", "✔ pass",
        ):  # fmt: skip
            assert words in detail(screen)
        await pilot.press("f", "f", "f")
        await pilot.pause()
        assert "✘ WF-03 NorthGate was without cover for 31 s" in detail(screen)


async def test_enter_opens_the_trace_of_a_run_and_escape_comes_back(
    folder: Path, site: Site
) -> None:
    async with opened(folder, site) as (app, pilot, screen):
        await press(pilot, "down", "down", "enter")
        recording = app.screen
        assert isinstance(recording, RecordingScreen)
        assert story.MISSION.id in recording.query_one(TracePane).query_one(TextRows).render().plain
        assert recording.player.finished
        await press(pilot, "left", "left", "f2", "i", "c")
        assert recording.player.index == len(story.told("finished")) - 3
        assert app.screen is recording
        await press(pilot, "escape")
        assert app.screen is screen
        assert screen.query_one(RunRows).cursor == runs.LOGGED
        await press(pilot, "enter")
        assert isinstance(app.screen, RecordingScreen)
        await press(pilot, "q")
        assert app.screen is screen


async def test_a_missing_log_and_a_foreign_world_are_said(folder: Path, site: Site) -> None:
    async with opened(folder, site) as (app, pilot, screen):
        await pilot.press("enter")
        await pilot.pause()
        assert app.screen is screen
        assert "the log of this run is missing" in notices(app)[-1]
        (folder / "worlds" / "site" / "world.yaml").unlink()
        path = folder / "logs" / f"{runs.LOGGED.replace('/', '__')}.jsonl"
        path.write_text(path.read_text().replace('"world":"checkpoint"', '"world":"elsewhere"'))
        await pilot.press("down", "down", "enter")
        await pilot.pause()
        assert "“elsewhere” is neither installed nor below" in notices(app)[-1]
        assert app.screen is screen


async def test_runs_that_are_added_appear_and_the_pointer_stays(folder: Path, site: Site) -> None:
    async with opened(folder, site) as (_, pilot, screen):
        listing = screen.query_one(RunRows)
        await pilot.press("end")
        chosen = listing.cursor
        runs.write(folder, [runs.record(seed=9), *runs.records(seeds=3)])
        screen.look()
        await read(pilot)
        assert len(listing.keys) == 73
        assert listing.cursor == chosen
        assert chosen in detail(screen)


async def test_a_line_that_is_no_run_is_named(folder: Path, site: Site) -> None:
    async with opened(folder, site) as (_, pilot, screen):
        with (folder / "runs.jsonl").open("a") as file:
            file.write('{"run": 3}\n')
        screen.look()
        await read(pilot)
        assert f"{folder / 'runs.jsonl'}:49" in text(screen, "evaluation-totals").replace("\n", "")
        assert len(screen.query_one(RunRows).keys) == 48


async def test_an_empty_folder_says_what_to_do(tmp_path: Path, site: Site) -> None:
    async with opened(tmp_path, site, (80, 24)) as (app, pilot, screen):
        assert "pa-console eval makes some" in detail(screen)
        await pilot.press("enter", "t")
        await read(pilot)
        assert "pa-console eval" in text(screen, "evaluation-text")
        other = runs.write(tmp_path / "other", runs.records())
        await pilot.press("o")
        await pilot.pause()
        assert isinstance(app.screen, AskFolder)
        await pilot.press(*"nowhere", "enter")
        assert "there is no such folder" in str(app.screen.query_one("#ask-note", Static).render())
        app.screen.query_one(Input).value = str(other)
        await pilot.press("enter")
        await read(pilot)
        assert len(screen.query_one(RunRows).keys) == 48


async def test_the_reports_tables_are_shown_and_scroll(folder: Path, site: Site) -> None:
    async with opened(folder, site, (80, 24)) as (_, pilot, screen):
        await pilot.press("t")
        await read(pilot)
        shown = text(screen, "evaluation-text")
        assert "smollm2-135m" in shown
        assert "Wilson interval" in shown
        pane = screen.query_one("#evaluation-tables", ScrollableContainer)
        await pilot.press("end")
        await pilot.pause()
        assert pane.scroll_offset.y == pane.max_scroll_y > 0
        await pilot.press("t")
        assert screen.focused is screen.query_one(RunRows)


async def test_resizing_keeps_pointer_and_filter(folder: Path, site: Site) -> None:
    async with opened(folder, site) as (_, pilot, screen):
        assert "variant" in text(screen, "list-heading")
        await pilot.press("f", "end")
        listing = screen.query_one(RunRows)
        before, keys = listing.cursor, list(listing.keys)
        await pilot.resize_terminal(80, 24)
        await read(pilot)
        assert (listing.cursor, listing.keys) == (before, keys)
        assert "variant" not in text(screen, "list-heading")
        assert listing.scroll_offset.y <= keys.index(before) < listing.scroll_offset.y + 24
        await pilot.resize_terminal(50, 14)
        await read(pilot)
        assert before in detail(screen)


async def test_thousands_of_runs_lay_out_only_what_is_in_view(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with opened(runs.write(tmp_path, runs.records(seeds=250)), site) as (_, pilot, screen):
        listing = screen.query_one(RunRows)
        assert len(listing.keys) == 6000
        asked: set[int] = set()
        real = listing.row

        def row(index: int, width: int) -> object:
            asked.add(index)
            return real(index, width)

        monkeypatch.setattr(listing, "row", row)
        await pilot.press("end", "pageup", "up")
        await pilot.pause()
        assert listing.item is not None
        assert listing.keys.index(listing.cursor) == 6000 - 1 - (listing.size.height - 1) - 1
        assert len(asked) < 100


async def test_the_console_opens_the_newest_evaluation_over_a_live_session(
    folder: Path, show: Show
) -> None:
    async with show(story.told("executing"), evaluations=folder.parent) as (app, pilot, station, _):
        await pilot.press("f2", "e")
        screen = await read(pilot)
        await press(pilot, "e", "down", "down", "enter")
        assert isinstance(app.screen, RecordingScreen)
        await press(pilot, "c", "f8", "left")
        assert (station.cancelled, station.stopped) == (0, 0)
        await pilot.press("f9")
        assert station.stopped == 1
        await press(pilot, "escape")
        assert app.screen is screen
        await press(pilot, "escape")
        assert app.screen is app.session.main
        await pilot.press("c", "enter")
        assert station.cancelled == 1


async def test_a_plan_that_waits_meanwhile_is_told(folder: Path, show: Show) -> None:
    async with show(story.told("planning"), evaluations=folder.parent) as (app, pilot, station, _):
        await pilot.press("f2", "e")
        await read(pilot)
        station.emit(*story.judged())
        await settle(pilot)
        assert "A plan waits" in notices(app)[-1]
        await press(pilot, "f7")
        assert app.screen is app.session.main
        assert app.screen.query_one(ApprovalPanel).has_focus_within


async def test_without_an_evaluation_the_console_asks_for_a_folder(
    tmp_path: Path, show: Show
) -> None:
    async with show(story.opening(), evaluations=tmp_path / "none") as (app, pilot, _, _):
        await pilot.press("f2", "e")
        await pilot.pause()
        assert isinstance(app.screen, AskFolder)
        await pilot.press("escape")
        await pilot.pause()
        assert app.screen is app.session.main


def looked_at(*keys: str) -> Callable[[Pilot[Any]], Any]:
    """Bring the screen into the state to be looked at."""

    async def run(pilot: Pilot[Any]) -> None:
        await read(pilot)
        for key in keys:
            await pilot.press(key)
        await read(pilot)
        await settle(pilot)

    return run


LOOKS = {"runs": ("down", "down", "down"), "tables": ("t",), "trace": ("down", "down", "enter")}


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", LOOKS)
def test_looks(
    *,
    snap_compare: Compare,
    folder: Path,
    site: Site,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    size: str,
) -> None:
    def built(_: object) -> tuple[ReportTable, ...]:
        return runs.TABLES

    monkeypatch.setattr(report, "build_tables", built)
    run = looked_at(*LOOKS[name])
    assert snap_compare(evaluation(folder, site), terminal_size=SIZES[size], run_before=run)


@pytest.mark.parametrize("name", ["empty", "bad"])
def test_looks_without_runs(
    snap_compare: Compare, tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.chdir(tmp_path)
    if name == "bad":
        Path("runs.jsonl").write_text('{"run": 3}\n')
    app = evaluation(Path(), site)
    assert snap_compare(app, terminal_size=(80, 24), run_before=looked_at())
