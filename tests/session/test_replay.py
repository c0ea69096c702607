"""Replay shows what live showed, from whichever side a moment is reached."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.schema.events import event as ev
from pa_console.session.log.chain import LogError
from pa_console.session.recording import Player, Recording
from pa_console.session.timeline import MARK_KINDS, MarkKind
from tests.schema.strategies import events
from tests.session.logs import folded, kept, write_log
from tests.session.story import START, at, story, telemetry
from tests.tui import living

ALL = frozenset(MARK_KINDS)
MOVES = ["step", "back", "second", "second_back", "next", "last"]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_log(tmp_path_factory.mktemp("log") / "s.jsonl", story())


def test_a_replayed_log_ends_as_the_live_session_did(log: Path) -> None:
    player = Player.open(log)
    player.play()
    assert player.advance(1000.0) == {event.data.kind for event in kept()}
    assert player.state == folded(story())
    assert player.finished
    assert not player.playing


@given(st.lists(events(), max_size=8))
@settings(max_examples=60, deadline=None)
def test_live_and_replayed_fold_agree_for_any_events(
    tmp_path_factory: pytest.TempPathFactory, happened: list[ev.Event]
) -> None:
    path = write_log(tmp_path_factory.mktemp("log") / "any.jsonl", happened)
    if not (logged := kept(happened)):
        return
    player = Player.open(path)
    player.play()
    player.advance(1e12)
    assert player.state == folded(logged)
    seeker = Player.open(path)
    seeker.seek(seeker.duration)
    assert seeker.state == player.state


@given(st.lists(st.floats(-2.0, 11.0), min_size=1, max_size=5))
@settings(max_examples=80, deadline=None)
def test_seeking_to_a_moment_equals_playing_to_it(log: Path, targets: list[float]) -> None:
    seeker = Player.open(log)
    for target in targets:
        seeker.seek(target)
        played = Player.of(story())
        played.play()
        played.advance(max(target, 0.0))
        assert seeker.position == played.position
        assert seeker.index == played.index
        assert seeker.state == played.state


@given(st.lists(st.sampled_from(MOVES), max_size=30))
@settings(max_examples=60, deadline=None)
def test_however_it_was_reached_the_state_is_that_of_the_events_so_far(
    log: Path, moves: list[str]
) -> None:
    player = Player.open(log)
    steps = {
        "step": player.step,
        "back": player.step_back,
        "second": lambda: player.step_seconds(1.0),
        "second_back": lambda: player.step_seconds(-1.0),
        "next": lambda: player.next_mark(ALL),
        "last": lambda: player.mark_back(ALL),
    }
    for move in moves:
        steps[move]()
        assert player.state == folded(kept()[: player.index])
        assert 0.0 <= player.position <= player.duration


def test_time_passes_at_the_chosen_rate_only_while_playing(log: Path) -> None:
    player = Player.open(log)
    assert player.advance(1.0) == frozenset()
    assert player.position == 0.0
    player.play()
    player.rate = 4.0
    player.advance(0.5)
    assert player.position == 2.0
    player.pause()
    player.advance(1.0)
    assert player.position == 2.0
    player.rate = 1000.0
    assert player.rate == 32.0
    player.rate = 0.0
    assert player.rate == 0.25


def test_play_at_the_end_starts_over(log: Path) -> None:
    player = Player.open(log)
    player.seek(player.duration)
    assert player.state.ended == "quit"
    player.play()
    assert player.position == 0.0
    assert not player.state.ended
    assert player.playing


def test_steps_go_by_event_and_by_simulated_seconds(log: Path) -> None:
    player = Player.open(log)
    player.play()
    player.step()
    assert (player.index, player.playing) == (1, False)
    player.step_seconds(1.0)
    assert player.state.tick == 10
    player.step_seconds(3.0)
    assert (player.position, player.state.tick) == (2.0, 20)
    player.step_seconds(1.0)
    assert player.state.tick == 50, "where a second has no event, the next one is gone to"
    player.step_seconds(-3.0)
    assert player.state.tick == 20
    player.step_seconds(-100.0)
    assert (player.index, player.position) == (0, 0.0)


def test_jumps_go_to_marks_on_both_sides_and_say_when_there_is_none(log: Path) -> None:
    player = Player.open(log)
    mission = frozenset[MarkKind](("mission",))
    assert player.next_mark(mission)
    assert isinstance(kept()[player.index - 1].data, ev.MissionReceived)
    here = player.index
    assert not player.next_mark(mission)
    assert not player.mark_back(mission)
    assert player.index == here
    player.step()
    assert player.mark_back(mission)
    assert player.index == here


def test_a_clock_that_was_set_back_does_not_stop_the_replay() -> None:
    happened = [telemetry(5.0), telemetry(1.0), telemetry(7.0)]
    player = Player.of(happened)
    assert player.duration == 2.0
    player.play()
    player.advance(2.0)
    assert player.finished
    assert player.state.picture is not None
    assert player.state.picture.time_s == 7.0


def test_seeking_past_telemetry_that_came_out_of_order_keeps_the_latest_tick() -> None:
    happened = [telemetry(5.0), telemetry(1.0)]
    player = Player.of(happened)
    player.seek(player.duration)
    assert player.state == folded(happened)
    assert player.state.tick == 50


def test_a_recording_with_one_event_or_none_is_over_at_once() -> None:
    for happened in ([], [at(0, ev.SessionEnded(reason="quit"))]):
        player = Player.of(happened)
        player.play()
        player.advance(0.1)
        assert (player.finished, player.playing, player.duration) == (True, False, 0.0)
        player.step_back()
        player.step_seconds(-1.0)
        player.step_seconds(1.0)
        player.step_back()
        player.step_back()
        assert player.index == 0


def test_a_damaged_log_plays_up_to_the_damage(log: Path, tmp_path: Path) -> None:
    lines = log.read_bytes().splitlines(keepends=True)
    path = tmp_path / "damaged.jsonl"
    path.write_bytes(b"".join([*lines[:5], b"rubbish\n", *lines[5:]]))
    player = Player.open(path)
    assert player.recording.problem is not None
    assert player.recording.problem.line == 6
    player.seek(player.duration)
    assert player.state == folded(kept()[:5])
    path.write_bytes(b"rubbish\n")
    with pytest.raises(LogError):
        Player.open(path)


def test_an_hour_of_telemetry_is_stepped_back_through_without_reading_it_all(
    tmp_path: Path,
) -> None:
    path = write_log(tmp_path / "long.jsonl", (telemetry(n * 0.5) for n in range(300)))
    player = Player.open(path)
    player.seek(player.duration)
    player.step_back()
    assert player.state.picture is not None
    assert player.state.picture.time_s == 149.0
    assert player.state.tick == 1490
    assert player.recording[0].t == START


def test_an_alarm_that_turns_into_another_kind_is_marked_again() -> None:
    unknown = living.UNKNOWN
    other = unknown.model_copy(update={"kind": "unauthorized_track"})
    told = [ev.AlarmRaised(alarm=alarm) for alarm in (unknown, unknown, other)]
    happened = [ev.Event(t=START, tick=1, data=data) for data in told]
    assert list(Recording(happened).timeline.marks) == [0, 2]
