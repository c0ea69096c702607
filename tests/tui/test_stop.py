"""A stop stays on the screen until the operator releases it, by a key and an answer."""

from pa_console.schema.command import DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.plan import Action
from pa_console.tui.approval.plan_words import approval_rows
from pa_console.tui.screens.dialogs import Confirm
from pa_console.tui.widgets.alarms import AlarmBar
from pa_console.tui.widgets.bars import StatusBar
from tests.tui import living, story
from tests.tui.scripted import Show, notices, press


async def test_a_stop_is_released_by_its_key_and_a_yes_and_by_nothing_less(show: Show) -> None:
    async with show(living.stopped()) as (app, pilot, station, _):
        bar, status = app.screen.query_one(AlarmBar), app.screen.query_one(StatusBar)
        assert "ALL STOPPED" in str(bar.render())
        assert "STOPPED: ^l releases it" in str(status.render())
        for answer in ("n", "escape", "enter"):
            await pilot.press("ctrl+l")
            await pilot.pause()
            assert isinstance(app.screen, Confirm)
            await press(pilot, answer)
            assert not isinstance(app.screen, Confirm)
        assert station.released == 0
        await pilot.press("ctrl+l")
        await pilot.pause()
        question = str(app.screen.query("Static").first().render())
        assert "7 assets confirmed" in question
        assert "Not confirmed: Drone_T01" in question
        await press(pilot, "y")
        assert station.released == 1
        assert "ALL STOPPED" not in str(bar.render())
        assert "STOPPED" not in str(status.render())
        await press(pilot, "ctrl+l")
        assert station.released == 1, "there is nothing to release"


async def test_whoever_stops_everything_is_told_how_to_release_it(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, _, _):
        await press(pilot, "f9")
        assert any("release the stop (^l)" in text for text in notices(app))


def test_the_way_to_safety_is_told_before_anybody_approves() -> None:
    trace = story.folded(story.told("approval")).current
    assert trace is not None
    assert trace.approval is not None
    declared = (
        Action(agent="Drone_T01", command="move_to WestGate"),
        Action(agent="Drone_T04", command="hold"),
    )
    said = "if halted: Drone_T01 back to WestGate"

    def text() -> str:
        return "\n".join(str(row.body) for row in approval_rows(trace))

    assert "if halted" not in text()
    trace.approval = trace.approval.model_copy(update={"if_halted": declared})
    assert said in text()
    assert "Drone_T04 holds" in text()
    trace.approval = trace.approval.model_copy(update={"blocked_by": ("ROE-01: force",)})
    assert "if halted" not in text(), "nothing of it will happen"


def test_what_the_gate_kept_back_is_in_the_list_of_events() -> None:
    order = DeviceCommand(command_id="x", agent="Drone_T01", verb="move_to", target="WestGate")
    state = story.folded(
        [*story.opening(), ev.CommandRefused(command=order, reason="all is stopped")]
    )
    assert "move_to WestGate: all is stopped" in [notice.text for notice in state.notices]
