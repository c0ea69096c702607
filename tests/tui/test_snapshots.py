"""What the screens look like, at the two sizes that must always work."""

from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest
from textual.pilot import Pilot

from pa_console.language.questions import Question
from pa_console.schema.events.event import AnswerLine, EventPayload
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import RehearsedReading
from pa_console.session.recording import Player
from pa_console.station.answers.alternatives import Alternative
from pa_console.tui.app import ConsoleApp
from pa_console.tui.approval.panel import ApprovalPanel
from pa_console.tui.recordings import OpenedLog
from pa_console.tui.screens.compare import CompareScreen
from tests.tui import compound, crowd, living, story
from tests.tui.scripted import FakeClock, ScriptedStation, console, settle, until
from tests.tui.site import RULES, WORLD
from tests.tui.story import stamped

pytestmark = pytest.mark.long

Compare = Callable[..., bool]
SIZES = {"80x24": (80, 24), "120x36": (120, 36), "200x60": (200, 60)}
BOTH = ("80x24", "120x36")
BLOCKED = {
    "broken": ("WF-03",),
    "verdict": "Failure",
    "blocked": ("WF-03: a gate is left without cover",),
}
UNMET = ("Drone_T04 to WestGate: Drone_T04 covers SouthGate alone", "report: Drone_T03 is down")
READINGS = (
    "asked: 2 drones to EastGate",
    "asked: if track at WestGate: Robot_T01, Robot_T02 identify vehicle at NorthGate, else: report "
    "by Drone_T04; now: At WestGate: no track, not so",
)
SCREENS: dict[str, tuple[list[EventPayload], tuple[str, ...]]] = {
    "empty": ([], ()),
    "planning": (story.told("planning"), ("f4",)),
    "approval": (story.told("approval", broken=("CAP-04",)), ()),
    "move": (story.told("approval", confidence=0.83), ()),
    "compound": (compound.told(), ()),
    "rehearsed": (compound.told(), ("space",)),
    "blocked": (story.told("approval", **BLOCKED), ()),
    "partly": (story.told("approval", unmet=UNMET), ()),
    "unclear": (story.told("approval", confidence=0.41, readings=READINGS), ()),
    "executing": (story.told("executing"), ()),
    "finished": (story.told("finished"), ("f4",)),
    "assets": (story.told("executing"), ("f3",)),
    "editor": (story.told("approval"), ("m", "enter")),
    "policies": (story.opening(), ("f6", *"each gate")),
    "help": (story.opening(), ("f1",)),
    "leaving": (story.told("executing"), ("f2", "q", "enter")),
    "alarmed": (living.alarmed(), ()),
    "queue": (living.alarmed(), ("escape", "5")),
    "doubtful": (living.troubled(), ("escape", "f3")),
    "workflow": (living.workflow(), ("escape", "f4")),
    "halted": (living.halted(), ("escape", "f4")),
    "stopped": (living.stopped(), ()),
    "reported": ([*story.opening(), story.TAK_UP, *story.reported()], ()),
}
WHY = (
    AnswerLine(about="order", said="M-001, Watch the north gate and report."),
    AnswerLine(about="read as", said="a drone looks at NorthGate"),
    AnswerLine(about="how sure", said="83%"),
    AnswerLine(about="rules", said="retrieved for these words: WF-03, ROE-06, WF-06"),
    AnswerLine(about="rules", said="always told: ROE-09, ROE-01, ROE-02, ROE-03, ROE-05, ROE-10"),
    AnswerLine(
        about="Drone_T04",
        said="observe NorthGate; only a drone can observe; the nearest free drone, 54 m away; "
        "Drone_T02 is nearer, 12 m, but it alone covers EastGate; there after 4 s in the rehearsal",
    ),
    AnswerLine(about="checks", said="no rule is broken; 13 rules applied"),
    AnswerLine(about="rehearsal", said="over after 8 s; every gate kept its guard"),
    AnswerLine(about="judge", said="does not object"),
    AnswerLine(about="decision", said="it waits for you: Approve"),
)
LOOKED_AT = (
    *((name, size) for name in ("planning", "approval", "executing", "policies") for size in BOTH),
    *((name, size) for name in ("alarmed", "workflow", "halted", "stopped") for size in BOTH),
    *((name, size) for name in ("move", "compound") for size in SIZES),
    *(("rehearsed", size) for size in BOTH),
    *(("reported", size) for size in BOTH),
    *((name, "80x24") for name in ("queue", "doubtful", "partly", "unclear")),
    *((name, "80x24") for name in ("empty", "finished", "assets", "help")),
    *((name, "120x36") for name in ("blocked", "editor", "leaving", "unclear")),
)


def before(
    station: ScriptedStation | None, clock: FakeClock, keys: tuple[str, ...]
) -> Callable[[Pilot[Any]], Awaitable[None]]:
    """Bring the console into the state to be looked at."""

    async def run(pilot: Pilot[Any]) -> None:
        await settle(pilot)
        clock.now += 1.0
        app = pilot.app
        assert isinstance(app, ConsoleApp)
        assert app.session.main is not None
        app.session.main.query_one(ApprovalPanel).refresh_state()
        app.feed.look()
        for key in keys:
            await pilot.press(key)
            await pilot.pause()
        await until(pilot, lambda: all(each.group != "check" for each in app.workers))
        await settle(pilot)

    return run


@pytest.mark.parametrize(("name", "size"), LOOKED_AT)
def test_screen(snap_compare: Compare, tmp_path: Path, name: str, size: str) -> None:
    payloads, keys = SCREENS[name]
    station, clock = ScriptedStation(payloads), FakeClock()
    app = console(station, tmp_path, clock)
    run = before(station, clock, keys)
    assert snap_compare(app, terminal_size=SIZES[size], run_before=run)


@pytest.mark.parametrize(("keys", "size"), [((), "80x24"), (("escape", "f3"), "120x36")])
def test_a_thousand_assets(
    snap_compare: Compare, tmp_path: Path, keys: tuple[str, ...], size: str
) -> None:
    site = crowd.world(1000, 50)
    station, clock = ScriptedStation(crowd.opening(site)), FakeClock()
    app = console(station, tmp_path, clock, world=site)
    run = before(station, clock, keys)
    assert snap_compare(app, terminal_size=SIZES[size], run_before=run)


def test_replay(snap_compare: Compare, tmp_path: Path) -> None:
    clock = FakeClock()
    player = Player.of(stamped(story.told("finished")))
    app = console(None, tmp_path, clock, player=player)
    run = before(None, clock, ("n", *["right"] * 8))
    assert snap_compare(app, terminal_size=(120, 36), run_before=run)


@pytest.mark.parametrize(("keys", "size"), [(("G", *"50%", "enter", "S"), "80x24")])
def test_replay_that_is_told_to_stop(
    snap_compare: Compare, tmp_path: Path, keys: tuple[str, ...], size: str
) -> None:
    clock = FakeClock()
    player = Player.of(stamped(story.told("finished")))
    app = console(None, tmp_path, clock, player=player)
    assert snap_compare(app, terminal_size=SIZES[size], run_before=before(None, clock, keys))


@pytest.mark.parametrize("size", BOTH)
def test_two_replays_compared(snap_compare: Compare, tmp_path: Path, size: str) -> None:
    clock, rules = FakeClock(), {rule.id: rule for rule in RULES}
    a, b = (
        Player.of(stamped(story.told("approval", **options)))
        for options in ({}, {"broken": ("CAP-04",)})
    )
    sides = (OpenedLog("a", a.recording, WORLD, rules), OpenedLog("b", b.recording, WORLD, rules))
    app = console(None, tmp_path, clock, player=a)

    async def run(pilot: Pilot[Any]) -> None:
        await settle(pilot)
        await pilot.app.push_screen(CompareScreen(*sides, clock))
        await pilot.pause()
        await pilot.app.workers.wait_for_complete()
        await settle(pilot)

    assert snap_compare(app, terminal_size=SIZES[size], run_before=run)


def asked(upto: str) -> ScriptedStation:
    """Return a station that answers *Why?* and *What else?* about the story up to a step."""
    station = ScriptedStation(story.told(upto))
    station.questions = {
        "Why?": Question("Why?", "plan"),
        "What else?": Question("What else?", "alternatives"),
    }
    station.answers = {"Why?": WHY, "What else?": ()}
    way = Plan(reason=story.ASKED, actions=(Action(agent="Ugv_T02", command="move_to NorthGate"),))
    found = RehearsedReading(plan=way, rehearsal=story.rehearsal())
    station.alternatives = [Alternative("way", story.ASKED, found)]
    return station


@pytest.mark.parametrize("size", BOTH)
@pytest.mark.parametrize(
    ("question", "upto"), [("Why?", "approval"), ("What else?", "finished")], ids=["why", "else"]
)
def test_answered(
    snap_compare: Compare, tmp_path: Path, question: str, upto: str, size: str
) -> None:
    station, clock = asked(upto), FakeClock()
    app = console(station, tmp_path, clock)

    async def run(pilot: Pilot[Any]) -> None:
        await before(station, clock, ("escape", "slash", *question, "enter"))(pilot)
        await until(pilot, lambda: len(station.told) == 1)
        await settle(pilot)

    assert snap_compare(app, terminal_size=SIZES[size], run_before=run)


def test_readonly(snap_compare: Compare, tmp_path: Path) -> None:
    station, clock = ScriptedStation(story.told("executing")), FakeClock()
    app = console(station, tmp_path, clock, readonly=True)
    assert snap_compare(app, terminal_size=(80, 24), run_before=before(station, clock, ()))


def test_without_colour(
    snap_compare: Compare, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    station, clock = ScriptedStation(story.told("approval", **BLOCKED)), FakeClock()
    app = console(station, tmp_path, clock)
    assert snap_compare(app, terminal_size=(120, 36), run_before=before(station, clock, ()))


def test_light(snap_compare: Compare, tmp_path: Path) -> None:
    station, clock = ScriptedStation(story.told("approval", broken=("CAP-04",))), FakeClock()
    app = console(station, tmp_path, clock)

    async def run(pilot: Pilot[Any]) -> None:
        pilot.app.theme = "pa-console-light"
        await before(station, clock, ())(pilot)

    assert snap_compare(app, terminal_size=(120, 36), run_before=run)
