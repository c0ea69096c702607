"""`--scenario` of `mission` and `console`: a situation is played, its alarms start missions."""

from collections.abc import Callable, Mapping
from contextlib import aclosing
from pathlib import Path
from types import SimpleNamespace

import pytest

from pa_console.schema.events.event import SessionStarted
from pa_console.session.log.chain import read_log
from pa_console.session.log.verification import verify
from pa_console.settings.sources import LoadedSettings
from pa_console.station.station import ControlStation
from tests.cli.inside import Call, Done
from tests.scripted import ScriptedEngine

CALM = """\
name: calm
title: Nothing happens
about: for a test
duration_s: 5
"""
LOSS = """\
name: loss
title: The guard of the East Gate fails
about: for a test
duration_s: 20
events:
  - {at_s: 1, do: {kind: fail, asset: Ugv_T01}}
  - {at_s: 2, do: {kind: worker}}
"""
HEEDLESS = ("--set", "standing_confidence=0")
"""The scripted model does not tell how sure it is."""
Play = Callable[..., tuple[Done, Path]]


@pytest.fixture
def play(call: Call, engine: ScriptedEngine, tmp_path: Path) -> Play:
    """Return what runs `mission` on a scenario's text and gives its end and its log."""
    del engine

    def run(text: str, *words: str) -> tuple[Done, Path]:
        path, log = tmp_path / "situation.yaml", tmp_path / "session.jsonl"
        path.write_text(text, encoding="utf-8")
        options = ("--scenario", str(path), "--approve", "auto", "--log", str(log))
        return call(*HEEDLESS, "mission", *words, *options), log

    return run


def test_a_situation_without_alarms_ends_well_after_its_time(play: Play) -> None:
    done, log = play(CALM)
    assert done.code == 0
    assert "no alarm needed a response" in done.said
    assert verify(log).ok
    events = list(read_log(log))
    started = events[0].data
    assert isinstance(started, SessionStarted)
    assert started.scenario == "calm"
    assert events[-1].tick * 0.1 >= 5.0


def test_an_alarm_of_the_situation_becomes_a_mission(play: Play, engine: ScriptedEngine) -> None:
    done, log = play(LOSS, "--json")
    document = done.json
    assert done.code == document["exit_code"] == 0
    [found] = document["missions"]
    assert (found["mission"]["source"], found["status"]) == ("alarm", "verified")
    assert found["mission"]["gate"] == "EastGate"
    assert engine.kills == 1
    assert verify(log).ok


def test_with_no_alarms_only_the_mission_given_is_worked_on(play: Play) -> None:
    done, _ = play(LOSS, "Watch the East Gate.", "--no-alarms", "--json")
    [found] = done.json["missions"]
    assert (found["mission"]["source"], found["mission"]["text"]) == (
        "operator", "Watch the East Gate.",
    )  # fmt: skip
    assert done.code in (0, 4)


def test_a_situation_that_the_world_cannot_play_is_refused_before_a_log_is_begun(
    play: Play,
) -> None:
    done, log = play(LOSS.replace("Ugv_T01", "Ugv_T99"))
    assert (done.code, done.out) == (2, "")
    assert "situation.yaml:6: events.0.do.asset" in done.err
    assert not log.exists()


def test_the_console_opens_on_the_situation(
    call: Call, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, engine: ScriptedEngine
) -> None:
    opened: list[ControlStation] = []
    seen: list[SessionStarted] = []

    def stop(_number: int) -> None:
        raise AssertionError("no signal was sent")

    class App:
        """A screen that is closed at once."""

        def __init__(
            self,
            _world: object,
            station: ControlStation,
            *_: object,
            readonly: bool,
            settings: LoadedSettings,
            rules_file: Path,
            usual: Mapping[str, float],
            **_others: object,
        ) -> None:
            assert readonly
            self.feed = SimpleNamespace(waiting=SimpleNamespace(usual=usual))
            assert rules_file.is_file()
            assert settings.origin("mouse").place == "--mouse"
            opened.append(station)
            leaving = SimpleNamespace(end=stop, ended_by=0)
            self.controllers = SimpleNamespace(leaving=leaving)

        async def run_async(self, *, mouse: bool) -> None:
            assert not mouse
            seen.append(await first_event(opened[0]))

    path = tmp_path / "loss.yaml"
    path.write_text(LOSS, encoding="utf-8")
    monkeypatch.setattr("pa_console.cli.sessions.screen.ConsoleApp", App)
    monkeypatch.setattr("pa_console.cli.sessions.log.default_folder", lambda: tmp_path)
    for stream in ("stdin", "stdout"):
        monkeypatch.setattr(f"sys.{stream}.isatty", lambda: True)
    words = ("--scenario", str(path), "--seed", "7", "--readonly", "--no-mouse")
    done = call("--set", "speed=4", "console", *words)
    assert done.code == 0, done.err
    assert opened[0].rate == 4.0
    (started,) = seen
    assert (tmp_path / "sessions.index").is_file()
    assert (started.scenario, started.seed, started.readonly) == ("loss", 7, True)
    assert len(started.scenario_sha256) == 64
    engine.on_state = None  # that session is over
    missing = call("console", "--scenario", "nowhere")
    assert missing.code == 2
    assert "situation-2" in missing.err


async def first_event(station: ControlStation) -> SessionStarted:
    """Return how the session of `station` starts."""
    async with aclosing(station.run()) as events:
        async for event in events:
            assert isinstance(event.data, SessionStarted)
            return event.data
    raise AssertionError("the session had no event")
