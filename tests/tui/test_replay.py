"""A recording is looked through from the keyboard, and takes no command."""

import threading
from datetime import timedelta
from pathlib import Path
from typing import IO, Any

import pytest
from textual.pilot import Pilot
from textual.widgets import Input, ProgressBar, Static

from pa_console.schema.events import event as ev
from pa_console.schema.incident import FailAsset
from pa_console.schema.mission import Decision
from pa_console.session.log_index import LogIndex, Progress, build_index
from pa_console.session.recording import Player
from pa_console.tui.app import ConsoleApp
from pa_console.tui.recordings import KnownWorld, OpenedLog, open_compared
from pa_console.tui.screens import dialogs
from pa_console.tui.screens.compare import CompareScreen
from pa_console.tui.screens.dialogs import OpeningLog
from pa_console.tui.screens.recording import FindEvent, HitRows, RecordingScreen, read_position
from pa_console.tui.widgets.bars import Scrubber, StatusBar
from pa_console.tui.widgets.map_view import MapView
from pa_console.tui.widgets.row_views import TextRows
from tests.session.logs import write_log
from tests.tui import story
from tests.tui.scripted import FakeClock, Show, press, settle, until
from tests.tui.site import RULES, WORLD
from tests.tui.story import stamped

pytestmark = pytest.mark.long

SIZE = (80, 24)


def happened() -> list[ev.Event]:
    """A mission with a refusal, a fault and an end, with telemetry in between."""
    told = [event for event in stamped(story.told("finished")) if not event.data.transient]
    refused = ev.DecisionMade(
        attempt=1, decision=Decision(kind="reject", reason="too far"), accepted=True
    )
    broken = ev.IncidentHappened(incident=FailAsset(asset="Drone_T01"))
    last = told[-1]
    for number, data in enumerate((refused, broken), start=1):
        told.append(
            last.model_copy(
                update={"t": last.t + timedelta(seconds=20 * number), "mission": None, "data": data}
            )
        )
    return told


def player() -> Player:
    return Player.of(happened())


def index_of(kind: str) -> int:
    return next(n for n, event in enumerate(happened()) if event.data.kind == kind)


def notices(app: ConsoleApp) -> list[str]:
    return [f"{n.title}: {n.message}" for n in app._notifications]  # pyright: ignore[reportPrivateUsage]


async def test_one_goes_through_a_recording_by_events_seconds_missions_and_findings(
    show: Show,
) -> None:
    tape = player()
    async with show(None, size=SIZE, player=tape) as (app, pilot, _, _):
        await press(pilot, "n")
        assert tape.index == index_of("mission_received") + 1
        await press(pilot, "n")
        assert "no mission after this moment" in notices(app)[-1]
        await press(pilot, "G", *"end", "enter", "W")
        assert tape.index == len(tape.recording) - 1, "the refusal, one event before the fault"
        await press(pilot, "w")
        assert tape.finished
        before = tape.state.tick
        await press(pilot, "h")
        assert tape.state.tick <= before - 10
        await press(pilot, "l")
        assert tape.state.tick == before
        await press(pilot, "N")
        assert tape.index == index_of("mission_received") + 1


async def test_the_two_clocks_of_a_recording_say_what_they_are(show: Show) -> None:
    async with show(None, size=SIZE, player=player()) as (app, pilot, _, _):
        await press(pilot, "n")
        assert "session 05:00 ×1" in str(app.screen.query_one(StatusBar).render())
        assert "log 00:05 of 01:06" in str(app.screen.query_one("#replay", Static).render())


async def test_the_rate_goes_from_a_quarter_to_thirty_two(show: Show) -> None:
    tape = player()
    async with show(None, size=SIZE, player=tape) as (app, pilot, _, _):
        await press(pilot, *["plus"] * 7)
        assert tape.rate == 32.0
        await press(pilot, *["minus"] * 9)
        assert tape.rate == 0.25
        assert "×0.25" in str(app.screen.query_one("#replay", Static).render())


async def test_every_command_is_refused_with_a_notice(show: Show) -> None:
    async with show(None, size=SIZE, player=player()) as (app, pilot, _, _):
        assert "Type one below" not in str(app.screen.query_one("#trace-head", TextRows).render())
        await press(pilot, "n")
        for number, key in enumerate(("S", "f9", "i", "slash", "c", "k", "a", "r", "m", "x")):
            await press(pilot, key)
            assert len(notices(app)) == number + 1
            assert "refused: this is a recording" in notices(app)[-1]


async def test_a_place_on_the_bar_is_gone_to_and_marks_stand_on_it(show: Show) -> None:
    tape = player()
    async with show(None, size=SIZE, player=tape) as (app, pilot, _, _):
        bar = str(app.screen.query_one(Scrubber).render())
        assert [bar.count(sign) for sign in "◆✘‼"] == [1, 1, 1]
        await pilot.click(Scrubber, offset=(40, 0))
        await settle(pilot)
        assert tape.position == pytest.approx(tape.duration / 2, abs=1.0)


async def test_words_are_searched_and_the_event_found_is_gone_to(show: Show) -> None:
    tape = player()
    async with show(None, size=SIZE, player=tape) as (app, pilot, _, _):
        await press(pilot, "s", *"FAR reject")
        await app.workers.wait_for_complete()
        assert isinstance(app.screen, FindEvent)
        assert "too far" in app.screen.query_one(HitRows).text
        await press(pilot, "enter", "enter")
        assert tape.index == len(happened()) - 1
        await press(pilot, "s", *"nowhere to be found")
        await app.workers.wait_for_complete()
        assert "0 found" in str(app.screen.query_one("#find-note", Static).render())
        await press(pilot, "escape")
        assert isinstance(app.screen, RecordingScreen)


def test_moments_are_read_in_every_way_that_is_offered() -> None:
    tape = player()
    last = tape.recording.timeline
    count, duration = len(last), last.duration
    assert read_position("end", tape) == count
    assert read_position("#3", tape) == 3
    assert read_position("#999999", tape) == count
    assert read_position("0:03", tape) == read_position("3", tape) == 4
    assert read_position("100%", tape) == count
    tape.seek(3.0)
    assert read_position("+2", tape) == 6
    assert read_position("-2", tape) == 2
    assert read_position("-99", tape) == 0
    assert read_position("@09:30:03", tape) == 4
    assert read_position("@09:29", tape) == last.count_until(duration)
    with pytest.raises(ValueError, match="is not a time"):
        read_position("later", tape)
    with pytest.raises(ValueError, match="is not a time"):
        read_position("101%", tape)


async def test_a_moment_that_is_none_is_told_and_can_be_mended(show: Show) -> None:
    tape = player()
    async with show(None, size=SIZE, player=tape) as (app, pilot, _, _):
        await press(pilot, "G", *"soon", "enter")
        assert "is not a time" in str(app.screen.query_one("#ask-note", Static).render())
        app.screen.query_one(Input).value = "#2"
        await press(pilot, "enter")
        assert tape.index == 2


def sides(changed: list[ev.Event]) -> tuple[OpenedLog, OpenedLog]:
    rules = {rule.id: rule for rule in RULES}
    a, b = (Player.of(events).recording for events in (happened(), changed))
    return OpenedLog("a.jsonl", a, WORLD, rules), OpenedLog("b.jsonl", b, WORLD, rules)


def otherwise() -> list[ev.Event]:
    """The same, but that the mission was refused for another reason."""
    told = happened()
    decision = Decision(kind="reject", reason="too late")
    data = ev.DecisionMade(attempt=1, decision=decision, accepted=True)
    return [*told[:-2], told[-2].model_copy(update={"data": data}), told[-1]]


async def test_two_recordings_are_shown_side_by_side_and_each_can_be_opened(show: Show) -> None:
    async with show(None, size=SIZE, player=player()) as (app, pilot, _, _):
        await app.push_screen(CompareScreen(*sides(otherwise()), FakeClock()))
        await pilot.pause()
        await app.workers.wait_for_complete()
        await settle(pilot)
        place = len(happened()) - 1
        assert f"at event {place}" in str(app.screen.query_one("#compare-title", Static).render())
        told = str(app.screen.query_one("#compare-rows", TextRows).render())
        assert "decision.reason" in told
        assert "too far" in told
        assert "too late" in told
        await press(pilot, "b")
        screen = app.screen
        assert isinstance(screen, RecordingScreen)
        assert screen.player.index == place


async def compare_with(pilot: Pilot[Any], log: Path) -> None:
    """Give `log` as the recording to compare the shown one with."""
    await settle(pilot)
    await press(pilot, "C")
    pilot.app.screen.query_one(Input).value = str(log)
    await press(pilot, "enter")


async def test_another_log_is_asked_for_and_one_that_is_none_is_told(
    tmp_path: Path, show: Show
) -> None:
    log = write_log(tmp_path / "other.jsonl", otherwise(), "S2")
    async with show(None, player=player()) as (app, pilot, _, _):
        await press(pilot, "C", *"none", "enter")
        assert "there is no such log" in str(app.screen.query_one("#ask-note", Static).render())
        app.screen.query_one(Input).value = str(log)
        await press(pilot, "enter")
        await app.workers.wait_for_complete()
        await settle(pilot)
        assert "first difference" in str(app.screen.query_one("#compare-title", Static).render())


def elsewhere() -> list[ev.Event]:
    """The same that began in a world of which only the name is known."""
    told = otherwise()
    data = story.STARTED.model_copy(update={"world": "yard", "world_sha256": "9" * 64})
    return [told[0].model_copy(update={"data": data}), *told[1:]]


@pytest.mark.parametrize("size", [(120, 36), (80, 24)])
async def test_no_map_is_drawn_for_a_recording_whose_world_is_not_here(
    tmp_path: Path, show: Show, size: tuple[int, int]
) -> None:
    log = write_log(tmp_path / "other.jsonl", elsewhere(), "S2")
    async with show(None, size=size, player=player()) as (app, pilot, _, _):
        await compare_with(pilot, log)
        await app.workers.wait_for_complete()
        await settle(pilot)
        assert "first difference" in str(app.screen.query_one("#compare-title", Static).render())
        name = str(app.screen.query_one("#compare-name-1", Static).render())
        assert "its world “yard” is not here" in name
        assert [view.id for view in app.screen.query(MapView)] == ["compare-map-0"]
        said = app.screen.query_one(".compare-no-map", Static)
        assert "pa-console replay other.jsonl --world FILE" in str(said.render())
        assert said.display is (size[1] >= 30)
        await press(pilot, "b")
        assert isinstance(app.screen, CompareScreen)
        assert "--world FILE" in notices(app)[-1]
        await press(pilot, "a")
        assert isinstance(app.screen, RecordingScreen)


def test_the_world_of_a_compared_log_is_taken_by_its_hash_and_a_changed_one_is_told(
    tmp_path: Path,
) -> None:
    known = KnownWorld.of(WORLD, player().recording)
    same = write_log(tmp_path / "same.jsonl", otherwise(), "S2")
    assert open_compared(same, known).world is WORLD
    installed = open_compared(same, KnownWorld(WORLD, "another"))
    assert installed.world is not None
    assert installed.world is not WORLD
    assert "its world “checkpoint” has changed since" in installed.note
    gone = open_compared(write_log(tmp_path / "gone.jsonl", elsewhere(), "S3"), known)
    assert gone.world is None


@pytest.mark.parametrize("waits", [True, False])
async def test_a_large_log_is_read_beside_the_screen_with_a_bar(
    tmp_path: Path, show: Show, monkeypatch: pytest.MonkeyPatch, waits: bool
) -> None:
    log, free = write_log(tmp_path / "large.jsonl", otherwise(), "S2"), threading.Event()

    def build(path: Path, file: IO[bytes], size: int, progress: Progress) -> LogIndex:
        progress(size // 4, size)
        assert free.wait(100), "the screen waits for the log"
        return build_index(path, file, size, progress)

    monkeypatch.setattr("pa_console.session.recording.build_index", build)
    monkeypatch.setattr(dialogs, "LARGE", 1)
    async with show(None, size=SIZE, player=player()) as (app, pilot, _, _):
        await compare_with(pilot, log)
        reading = app.screen
        assert isinstance(reading, OpeningLog)
        await until(pilot, lambda: reading.query_one(ProgressBar).percentage)
        assert reading.query_one(ProgressBar).percentage == pytest.approx(0.25, abs=0.01)
        if not waits:
            await press(pilot, "escape")
            assert app.screen is app.session.main
        free.set()
        if waits:
            await until(pilot, lambda: isinstance(app.screen, CompareScreen))
        await app.workers.wait_for_complete()
        assert app.screen is app.session.main or waits


async def test_a_large_log_that_is_none_is_told(
    tmp_path: Path, show: Show, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = tmp_path / "none.jsonl"
    log.write_bytes(b"rubbish\n")
    monkeypatch.setattr(dialogs, "LARGE", 1)
    async with show(None, size=SIZE, player=player()) as (app, pilot, _, _):
        await compare_with(pilot, log)
        await app.workers.wait_for_complete()
        await until(pilot, lambda: notices(app))
        assert "none.jsonl:1" in notices(app)[-1]
        assert app.screen is app.session.main


async def test_a_log_that_changes_under_a_replay_is_told_and_nothing_breaks(
    tmp_path: Path, show: Show
) -> None:
    log = write_log(tmp_path / "log.jsonl", happened())
    async with show(None, size=SIZE, player=Player.open(log)) as (app, pilot, _, _):
        log.write_bytes(b"x" * log.stat().st_size)
        await press(pilot, "right")
        assert "has changed since the log was opened" in notices(app)[-1]


async def test_the_screen_follows_the_terminal_as_it_grows_and_shrinks(show: Show) -> None:
    async with show(None, player=player()) as (app, pilot, _, _):
        for width, height in ((80, 24), (120, 36), (80, 24)):
            await pilot.resize_terminal(width, height)
            await settle(pilot)
            bottom = app.screen.query_one("Footer").region
            assert (bottom.right, bottom.bottom) == (width, height)
            banner = app.screen.query_one("#replay", Static).region
            assert banner.width == width
            assert app.screen.has_class("-compact") == (width == 80)
