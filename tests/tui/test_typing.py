"""Keys that no field takes: prose is text and no command; a command needs more than a letter."""

import random

import pytest
from textual import events
from textual.pilot import Pilot
from textual.widgets import Button, Input

from pa_console.tui.app import ConsoleApp
from pa_console.tui.approval.panel import ARM_DELAY_S, ApprovalPanel
from pa_console.tui.controllers.typing import TEXT_S, KeyLine
from pa_console.tui.screens.main import MainScreen
from pa_console.tui.widgets.alarms import AlarmPane
from pa_console.tui.widgets.mission_prompt import MissionInput
from tests.tui import living, story
from tests.tui.scripted import FakeClock, ScriptedStation, Show, notices, press, settle

NAMES = {" ": "space", ".": "full_stop", ",": "comma", "\n": "enter"}


class Typist:
    """Types texts, each key `gap` seconds after the one before."""

    def __init__(self, pilot: Pilot[None], clock: FakeClock, gap: float = 0.15) -> None:
        self._pilot, self._clock, self.gap = pilot, clock, gap

    async def types(self, text: str) -> None:
        """Press the keys of `text`, a line feed as Enter."""
        for character in text:
            self._clock.now += self.gap
            await self._pilot.press(NAMES.get(character, character))


def given_commands(station: ScriptedStation) -> list[object]:
    """Everything that the station was told to do."""
    counted = [station.cancelled, station.stopped, station.released]
    return [
        *station.submitted, *station.decisions, *station.acknowledged, *station.moved,
        *station.deferred, *station.withdrawn, *filter(None, counted),
    ]  # fmt: skip


def reason(app: ConsoleApp) -> str:
    """What stands in the reason."""
    return app.screen.query_one("#approval-reason", Input).value


@pytest.mark.parametrize("text", ["already at the gate", "Drone is already there", "robot on site"])
@pytest.mark.parametrize("gap", [0.0, 0.15, TEXT_S + 0.3])
async def test_prose_at_the_approval_is_the_reason_and_decides_nothing(
    text: str, gap: float, show: Show
) -> None:
    async with show(story.told("approval", verdict="Failure"), keys_by_clock=True) as (
        app,
        pilot,
        station,
        clock,
    ):
        clock.now += ARM_DELAY_S
        await Typist(pilot, clock, gap).types(text + "\n\n")
        await settle(pilot)
        assert given_commands(station) == []
        assert isinstance(app.screen, MainScreen)
        written = reason(app)
        missing = text.removesuffix(written)
        assert missing != text
        assert missing == "" if gap < TEXT_S else len(missing) < 3


async def test_a_letter_goes_to_its_button_and_enter_presses_it(show: Show) -> None:
    async with show(story.told("approval"), keys_by_clock=True) as (app, pilot, station, clock):
        clock.now += ARM_DELAY_S
        for key, button in (("a", "approve"), ("m", "modify"), ("r", "reject")):
            clock.now += 2.0
            await pilot.press(key)
            assert app.screen.query_one(f"#{button}", Button).has_focus
        assert station.decisions == []
        await press(pilot, "enter")
        assert station.decided == ["reject"]


async def test_typing_goes_on_where_a_plan_comes_up_and_does_nothing(show: Show) -> None:
    async with show(story.told("planning"), keys_by_clock=True) as (app, pilot, station, clock):
        await pilot.press("f4")
        typist = Typist(pilot, clock)
        await typist.types("Drone is ")
        station.emit(*story.judged())
        await settle(pilot)
        await typist.types("already in position, Stop.\n\n")
        await settle(pilot)
        assert given_commands(station) == []
        assert app.screen.query_one(MissionInput).text == ""
        assert app.screen.query_one(ApprovalPanel).display


@pytest.mark.parametrize("text", ["keep an eye on it", "Stop that", "cover the gate", "x marks"])
@pytest.mark.parametrize("gap", [0.1, 1.0])
async def test_prose_elsewhere_gives_no_command(text: str, gap: float, show: Show) -> None:
    async with show(living.alarmed(), keys_by_clock=True) as (app, pilot, station, clock):
        await pilot.press("f2")
        clock.now += 2.0
        first, rest = text[:2], text[2:6]
        await Typist(pilot, clock, gap).types(first)
        await Typist(pilot, clock, 0.1).types(rest + "\n")
        await settle(pilot)
        assert given_commands(station) == []
        assert app.session.main is not None
        assert app.session.main.query_one(MissionInput).text == ""


async def test_a_letter_of_a_command_waits_for_enter_and_says_so(show: Show) -> None:
    async with show(story.told("planning"), keys_by_clock=True) as (app, pilot, station, clock):
        await pilot.press("f2", "c")
        await pilot.pause()
        said = str(app.screen.query_one(KeyLine).render())
        assert said.startswith("c  then Enter: Cancel the active mission")
        await pilot.press("escape", "enter")
        assert station.cancelled == 0
        assert not app.screen.query(KeyLine)
        clock.now += 2.0
        await pilot.press("c")
        clock.now += 20.0
        await pilot.press("enter")
        assert station.cancelled == 0
        await pilot.press("c")
        clock.now += 1.0
        await pilot.press("enter")
        assert station.cancelled == 1


async def test_function_keys_command_at_once_even_in_the_middle_of_a_text(show: Show) -> None:
    async with show(story.told("planning"), keys_by_clock=True) as (_, pilot, station, clock):
        await pilot.press("f2")
        await Typist(pilot, clock).types("al")
        await pilot.press("f9")
        assert station.stopped == 1


async def test_a_letter_that_only_looks_acts_at_once_and_again_and_again(show: Show) -> None:
    async with show(living.alarmed(), keys_by_clock=True) as (app, pilot, _, clock):
        await pilot.press("escape", "j")
        first = app.screen.query_one(AlarmPane).cursor
        await pilot.press("j")
        assert app.screen.query_one(AlarmPane).cursor != first
        await pilot.press("escape")
        clock.now += 2.0
        await press(pilot, "p")
        assert not isinstance(app.screen, MainScreen)


async def test_no_screen_opens_in_the_middle_of_a_text(show: Show) -> None:
    async with show(story.told("planning"), keys_by_clock=True) as (app, pilot, _, clock):
        await pilot.press("f2")
        await Typist(pilot, clock).types("the epo")
        await settle(pilot)
        assert app.screen is app.session.main
        assert "not a command" in str(app.screen.query_one(KeyLine).render())


@pytest.mark.parametrize("key", ["a", "r", "m", "alt+1"])
async def test_a_key_of_the_approval_says_elsewhere_where_to_go(key: str, show: Show) -> None:
    async with show(story.told("planning"), keys_by_clock=True) as (app, pilot, station, clock):
        await pilot.press("f2", key)
        assert notices(app)[-1] == "no plan is waiting for a decision"
        station.emit(*story.judged())
        await settle(pilot)
        clock.now += ARM_DELAY_S
        await pilot.press("f2", key)
        assert notices(app)[-1] == "F7 goes to the waiting plan, where you can decide"
        assert station.decisions == []


async def test_a_second_enter_after_a_decision_sends_no_half_typed_mission(show: Show) -> None:
    async with show(story.told("planning"), keys_by_clock=True) as (app, pilot, station, clock):
        await Typist(pilot, clock).types("and the")
        station.emit(*story.judged())
        await settle(pilot)
        clock.now += 2.0
        await press(pilot, "f7", "a", "enter")
        await press(pilot, "enter")
        assert station.decided == ["approve"]
        assert station.submitted == []
        assert app.screen.query_one(MissionInput).text == "and the"


async def test_pasted_lines_are_all_kept(show: Show) -> None:
    async with show(story.told("approval"), keys_by_clock=True) as (app, pilot, station, clock):
        clock.now += ARM_DELAY_S
        app.post_message(events.Paste("seen by\nthe patrol\n"))
        await settle(pilot)
        assert reason(app) == "seen by the patrol"
        app.post_message(events.Paste("\nand the\ncamera"))
        await settle(pilot)
        assert reason(app) == "seen by the patrol and the camera"
        await pilot.press("escape", "escape", "slash")
        app.post_message(events.Paste("Watch the road.\rTell me what comes."))
        await settle(pilot)
        assert app.screen.query_one(MissionInput).text == "Watch the road.\nTell me what comes."
        assert station.submitted == []
        await pilot.press("enter")
        assert station.submitted == ["Watch the road.\nTell me what comes."]


PROSE = (
    "already at the gate", "robot is on site", "me too", "maybe later", "Drone is already there",
    "Stop, keep the east covered. 2 guards stay", "cancel that", "x marks the spot", "quite so",
    "all clear, approve", "reject this please", "send them all, now",
)  # fmt: skip
LETTERS = "armcSkxzudqtjop"


@pytest.mark.parametrize("seed", range(30))
async def test_nothing_that_was_not_meant_is_commanded_at_an_approval(
    seed: int, show: Show
) -> None:
    """Letters, prose and pasted lines before, while and after a plan comes up; Enter twice.

    Enter is left out right after a single letter, where it is how a command is given, and on the
    Reject button that the panel opens with, where it rejects.
    """
    drawn = random.Random(seed)
    told = story.told("planning")
    async with show(
        [*living.alarmed()[: len(living.troubled())], *told[3:]], keys_by_clock=True
    ) as (app, pilot, station, clock):
        await pilot.press(drawn.choice(("f2", "f4", "f5")))
        comes, parts = drawn.randrange(5), drawn.randrange(6, 9)
        verdict = drawn.choice(("Success", "Failure"))
        readings = drawn.choice(((), ("asked: 2 drones to EastGate",)))
        for number in range(parts):
            clock.now += drawn.choice((0.0, 0.2, 0.7, 3.0))
            if number == comes:
                station.emit(*story.judged(verdict=verdict, readings=readings))
                await settle(pilot)
                if drawn.random() < 0.5:
                    await pilot.press("enter", "enter")
            gap = drawn.choice((0.0, 0.05, 0.2, 0.4))
            match drawn.randrange(3):
                case 0:
                    clock.now += 1.0
                    await pilot.press(drawn.choice(LETTERS))
                    clock.now += 1.0
                    await pilot.press("escape")
                case 1:
                    typed = drawn.choice(PROSE)
                    await Typist(pilot, clock, gap).types(typed + "\n\n" * drawn.randrange(2))
                case _:
                    app.post_message(events.Paste(f"{drawn.choice(PROSE)}\n{drawn.choice(PROSE)}"))
            await settle(pilot)
        assert given_commands(station) == []
        assert app.is_running
        assert app.session.main is not None
        assert app.session.main.query_one(ApprovalPanel).display


@pytest.mark.parametrize("pause", [0.1, 0.5, 3.0])
async def test_enters_after_a_text_that_was_typed_ahead_press_no_button(
    pause: float, show: Show
) -> None:
    async with show(story.told("approval"), keys_by_clock=True) as (app, pilot, station, clock):
        await Typist(pilot, clock, 0.4).types("me too")
        await Typist(pilot, clock, pause).types("\n\n\n")
        await settle(pilot)
        assert given_commands(station) == []
        assert app.screen.query_one(ApprovalPanel).display
