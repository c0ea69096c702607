"""A mission waits for assets that cannot start yet, but only for those that it needs."""

import pytest

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.schema.events import event as ev
from pa_console.schema.telemetry import Picture
from tests.rig import Rig
from tests.scripted import ScriptedEngine, plan

READY_AFTER_S = 20.0
LATE = dict.fromkeys(("Drone_T04", "Robot_T02"), "it has no position estimate yet")


@pytest.fixture
def late(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a drone and a robot be ready only some time after the beginning."""
    own = SimulatedFleet.picture

    def picture(fleet: SimulatedFleet) -> Picture:
        waiting = LATE if fleet.time_s < READY_AFTER_S else {}
        return own(fleet).model_copy(update={"not_ready": waiting})

    monkeypatch.setattr(SimulatedFleet, "picture", picture)


@pytest.mark.usefixtures("late")
@pytest.mark.parametrize(
    ("text", "waits_for"),
    [
        ("Send Drone_T04 to the east gate.", ("Drone_T04",)),
        ("Send drone 4 to the east gate.", ("Drone_T04",)),
        ("Send all drones home.", ("Drone_T04",)),
        ("Send all assets to the east gate.", ("Drone_T04", "Robot_T02")),
        ("Send a drone to the east gate.", ()),
        ("Send somebody to the east gate.", ()),
        ("Send Ugv_T02 to the east gate.", ()),
    ],
)
async def test_an_order_waits_for_the_assets_that_it_needs(
    rig: Rig, text: str, waits_for: tuple[str, ...]
) -> None:
    await rig.run(ScriptedEngine([plan(("Ugv_T02", "move_to EastGate"))]), text=text)
    notices = [event.data.text for event in rig.events if isinstance(event.data, ev.Noticed)]
    waits = [notice for notice in notices if notice.startswith("waits for")]
    assert [tuple(name for name in LATE if name in notice) for notice in waits] == (
        [waits_for] if waits_for else []
    )
    assert ("goes on" in notices) == bool(waits_for)
