"""The operator is called when something waits, by the means that the settings leave on."""

from pathlib import Path
from typing import Any

import pytest
from textual.widgets import TextArea

from pa_console.settings.sources import load_settings
from pa_console.tui.widgets.mission_prompt import MissionPrompt
from tests.tui import living, story
from tests.tui.scripted import ScriptedStation, Show, console, settle

pytestmark = pytest.mark.long


async def sent(tmp_path: Path, payloads: list[Any], **chosen: str) -> str:
    """Return what the terminal is sent while `payloads` are told; a bell alone is a line BELL."""
    codes: list[str] = []
    station = ScriptedStation(payloads)
    app = console(station, tmp_path, settings=load_settings(chosen), to_terminal=codes.append)
    async with app.run_test(size=(80, 24)) as pilot:
        await settle(pilot)
    return "".join("BELL\n" if code == "\a" else code for code in codes)


async def test_a_plan_that_waits_rings_and_stands_in_the_window_s_title(tmp_path: Path) -> None:
    told = await sent(tmp_path, story.told("approval"))
    waits = f"plan of {story.MISSION.id} waits"
    assert told.count("BELL\n\x1b]9;PA Console: ") == 1
    assert f"]777;notify;PA Console;{waits}\x07" in told
    assert f"\x1b]2;▲ {waits} - PA Console\x07" in told
    assert told.endswith("\x1b[23;2t"), "the window has its own title again"


async def test_an_urgent_alarm_calls_and_a_low_one_does_not(tmp_path: Path) -> None:
    told = await sent(tmp_path, living.troubled())
    assert "emergency alarm: Track_04" in told
    assert "Drone_T04" not in told


async def test_nothing_is_sent_while_nothing_waits_but_the_title(tmp_path: Path) -> None:
    told = await sent(tmp_path, story.told("planning"))
    assert told == "\x1b[22;2t\x1b]2;PA Console\x07\x1b[23;2t"


@pytest.mark.parametrize(
    ("name", "code"),
    [("bell", "BELL"), ("desktop_notices", "\x1b]777"), ("window_title", "\x1b]2;")],
)
async def test_each_means_can_be_switched_off(tmp_path: Path, name: str, code: str) -> None:
    told = await sent(tmp_path, story.told("approval"), **{name: "off"})
    assert code not in told
    assert told


@pytest.mark.parametrize("size", [(80, 24), (120, 36)])
async def test_what_is_waited_for_is_said_at_the_prompt_until_it_is_over(
    size: tuple[int, int], show: Show
) -> None:
    async with show(story.told("planning"), size=size, usual={"plan": 4.0}) as (
        app,
        pilot,
        station,
        clock,
    ):
        clock.now += 6.0
        station.emit(*story.told("planning")[-1:])
        await settle(pilot)
        prompt = app.screen.query_one(MissionPrompt)

        def said() -> str:
            field = prompt.query_one(TextArea)
            return f"{prompt.border_title or ''}{field.placeholder}"

        assert ": 6 s, usually" in said()
        station.emit(*story.told("approval")[len(story.told("planning")) :])
        await settle(pilot)
        assert "usually" not in said()
        assert "Say in plain words" in said()
