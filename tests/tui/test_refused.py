"""Read-only and replay refuse every command and say so; small terminals lose nothing."""

from textual.widgets import Static

from pa_console.schema.events.event import TelemetryReceived
from pa_console.session.recording import Player
from pa_console.tui.actions import ACTIONS, ActionContext
from pa_console.tui.approval.panel import ApprovalPanel
from pa_console.tui.widgets.map_view import MapView
from tests.tui import story
from tests.tui.scripted import Show, press, settle
from tests.tui.story import stamped

COMMANDS = ("cancel", "stop", "prompt", "approval")


async def test_readonly_shows_everything_and_refuses_every_command(show: Show) -> None:
    async with show(story.told("approval"), readonly=True) as (app, pilot, station, _):
        await press(pilot, "i", "a", "r", "f7", "f8", "f9", "S", "c", "enter")
        assert (station.submitted, station.decisions) == ([], [])
        assert (station.cancelled, station.stopped) == (0, 0)
        assert app.screen.query_one(ApprovalPanel).has_class("-closed")
        assert not app.screen.query("#mission-input")
        assert "READ-ONLY" in str(app.screen.query_one("#prompt-closed", Static).render())


def test_no_command_is_legal_in_a_replay_or_read_only() -> None:
    full = {"mission": True, "traced": True, "approval": True}
    for action in ACTIONS:
        if action.id in COMMANDS:
            assert action.refusal(ActionContext(replay=True, **full))
            assert action.refusal(ActionContext(readonly=True, decides=False, stops=False, **full))
            assert not action.refusal(ActionContext(**full))


async def test_replay_plays_on_with_the_clock(show: Show) -> None:
    player = Player.of(stamped(story.told("finished")))
    async with show(None, player=player) as (app, pilot, _, clock):
        await pilot.press("space")
        clock.now += 1000.0
        while not player.finished:
            await pilot.pause()
        await settle(pilot)
        assert "ended" in str(app.screen.query_one("#replay", Static).render())


async def test_a_tiny_terminal_gets_a_friendly_word(show: Show) -> None:
    async with show(story.told("approval"), size=(50, 12)) as (app, pilot, _, _):
        note = app.screen.query_one("#too-small", Static)
        assert note.display
        assert "60 x 18" in str(note.render())
        assert not app.screen.query_one("#body").display
        await pilot.resize_terminal(80, 24)
        await settle(pilot)
        assert app.screen.query_one("#body").display


async def test_a_small_terminal_reaches_every_pane(show: Show) -> None:
    async with show(story.told("executing"), size=(60, 18)) as (app, pilot, _, _):
        for key, pane in (("f3", "assets"), ("f4", "trace"), ("f5", "events"), ("f2", "map")):
            await press(pilot, key)
            seen = [name for name in ("map", "assets", "trace", "events")
                    if app.screen.query_one(f"#{name}").region.area]  # fmt: skip
            assert seen == [pane]


async def test_all_parts_of_a_decision_are_on_a_small_terminal(show: Show) -> None:
    async with show(story.told("approval", broken=("CAP-04",)), size=(60, 18)) as (app, _, _, _):
        for name in ("reject", "modify", "approve", "approval-reason", "map"):
            region = app.screen.query_one(f"#{name}").region
            assert region.area
            assert region.bottom <= 18


async def test_a_hidden_map_is_up_to_date_when_it_is_shown_again(show: Show) -> None:
    async with show(story.opening(), size=(80, 24)) as (app, pilot, station, _):
        await pilot.press("f4")
        station.emit(TelemetryReceived(picture=story.moving_picture()), mission=None)
        await settle(pilot)
        await press(pilot, "f2")
        rows = app.screen.query_one(MapView).text().splitlines()[:-1]
        assert "◇" in "".join(rows)
