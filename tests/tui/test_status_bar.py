"""The status bar says what the model does, and how the servers are that the session has."""

import pytest

from pa_console.schema.events import event as ev
from pa_console.tui.widgets.bars import StatusBar
from tests.tui import story
from tests.tui.scripted import Show, settle
from tests.tui.site import WORLD, picture
from tests.tui.test_log_alarm import top_line


def server(state: str) -> ev.EventPayload:
    """The state of a server that the planner's model is on."""
    named = {"server": "openai:http://127.0.0.1/v1#m", "serves": ("planner",), "state": state}
    return ev.ServerChanged.model_validate(named)


SAYS = (
    (ev.WorkerChanged(state="slow"), "slow, busy machine"),
    (ev.WorkerChanged(state="unconfined", detail="no Landlock"), "model △ not confined"),
    (ev.WorkerChanged(state="ready"), ""),
    (server("ready"), "server ● ready"),
    (server("unconstrained"), "server △ not constrained"),
    (server("away"), "server ✘ away"),
)


@pytest.mark.parametrize("size", [(80, 24), (120, 36)])
async def test_it_says_what_the_model_and_its_server_do(size: tuple[int, int], show: Show) -> None:
    async with show(story.told("approval"), size=size) as (app, pilot, station, _):
        assert "server" not in top_line(app)[0]
        for payload, words in SAYS:
            station.emit(payload, mission=None)
            await settle(pilot)
            line = top_line(app)[0]
            assert words in line if words else "slow" not in line


@pytest.mark.parametrize("size", [(80, 24), (120, 36)])
async def test_it_says_how_the_tak_server_is_and_how_many_contacts_it_reports(
    size: tuple[int, int], show: Show
) -> None:
    wide = size[0] > 80
    async with show(story.opening(), size=size) as (app, pilot, station, _):
        assert "TAK" not in top_line(app)[0]
        station.emit(story.TAK_UP, mission=None)
        await settle(pilot)
        assert ("TAK ● connected" if wide else "TAK ●") in top_line(app)[0]
        station.emit(*story.reported(), mission=None)
        await settle(pilot)
        assert ("TAK ● 2 contacts" if wide else "TAK ● 2") in top_line(app)[0]
        gone = {"state": "away", "detail": "no connection to tls://tak.example:8089: gone"}
        down = story.TAK_UP.model_copy(update=gone)
        station.emit(down, mission=None)
        await settle(pilot)
        since = "away since 09:30" if wide else "since 09:30"
        assert f"TAK ✘ {since}" in top_line(app)[0]
        lines = app.session.state.notices
        assert [line.text for line in lines if line.subject == "TAK"][-1] == down.detail


async def test_the_title_makes_room_for_what_has_to_be_known(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, station, _):
        assert WORLD.title in top_line(app)[0]
        gone = {"state": "away", "detail": "no connection to tls://tak.example:8089: gone"}
        slow = ev.WorkerChanged(state="slow")
        station.emit(slow, story.TAK_UP.model_copy(update=gone), mission=None)
        await settle(pilot)
        line = top_line(app)[0]
        assert WORLD.title not in line
        assert "slow, busy machine" in line
        assert "TAK ✘ away since 09:30 no mission" in line


@pytest.mark.parametrize("size", [(80, 24), (120, 36)])
async def test_that_it_waits_for_you_and_an_uncovered_gate_are_seen_whatever_else_there_is(
    size: tuple[int, int], show: Show
) -> None:
    asset = "Drone_T04"
    async with show(story.told("approval"), size=size) as (app, pilot, station, _):
        now = picture(610.0, changes={asset: {"manual": True}}, uncovered=("EastGate", "WestGate"))
        station.emit(
            ev.WorkerChanged(state="unconfined", detail="no Landlock"),
            ev.LogTroubled(problem="no space left"),
            ev.TelemetryReceived(picture=now),
            mission=None,
        )
        await settle(pilot)
        bar = str(app.screen.query_one(StatusBar).render())
        assert "WAITS FOR YOU" in bar
        assert "UNCOVERED" in bar
        assert "LOG NOT WRITTEN" in bar
        assert len(bar) <= size[0] - 2
