"""A session without a screen lasts as long as something of it matters."""

import pytest

from pa_console.mission.approval import standing_approver
from pa_console.schema.events import event as ev
from pa_console.session.state import SessionState
from pa_console.station.headless import run_missions
from tests.rig import MISSION, Rig
from tests.scripted import ScriptedEngine, plan


@pytest.mark.parametrize("decided", [False, True])
async def test_a_session_is_watched_no_longer_where_nothing_matters_any_more(
    rig: Rig, decided: bool
) -> None:
    """A refused mission ends at once; the rest of the time is for whoever wants to see it."""
    ended: list[int] = []

    def sink(event: ev.Event, _: SessionState) -> None:
        if isinstance(event.data, ev.SessionEnded):
            ended.append(event.tick)

    never = standing_approver("never")
    station = rig.station(ScriptedEngine([plan(("Drone_T04", "report"))]))
    await run_missions(station, [MISSION], never, sink, duration_s=20.0, decided=lambda: decided)
    [tick] = ended
    assert (tick * station.world.dt_s < 20.0) == decided
