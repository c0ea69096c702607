"""What goes wrong beside the plan: the worker dies, the operator stops, an emergency comes."""

from collections.abc import Callable

import pytest

from pa_console.schema.events import event as ev
from pa_console.schema.incident import FailAsset, WorkerFault
from pa_console.station.station import ControlStation
from tests.rig import Rig
from tests.scripted import ScriptedEngine, plan
from tests.station.test_living import of_kind, scenario

REPORT = plan(("Drone_T04", "report"))


async def test_a_scenarios_worker_fault_reaches_the_engine_and_moves_nothing(rig: Rig) -> None:
    engine = ScriptedEngine([REPORT])
    await rig.play(engine, scenario((2.0, WorkerFault()), (4.0, WorkerFault()), duration_s=6.0))
    assert engine.kills == 2
    told = [e.data for e in of_kind(rig, "incident") if isinstance(e.data, ev.IncidentHappened)]
    assert [(data.source, data.incident.kind) for data in told] == [("scenario", "worker")] * 2
    assert not of_kind(rig, "command_sent")


async def test_the_operators_what_if_reaches_the_engine_too(rig: Rig) -> None:
    engine = ScriptedEngine([REPORT])
    await rig.run(engine, setup=[WorkerFault()])
    assert engine.kills == 1


FAR = plan(("Robot_T02", "move_to WestGate"))
FILL = plan(("Drone_T04", "move_to EastGate"))
LOSS = scenario((5.0, FailAsset(asset="Ugv_T01")), duration_s=30.0)


def ask_first(event: ev.Event, station: ControlStation) -> None:
    """Submit the operator's mission as the session begins."""
    if isinstance(event.data, ev.SessionStarted):
        station.submit("Send the robot at the base to the West Gate.")


async def test_a_gate_without_guard_goes_before_the_operators_mission_which_goes_on_after(
    rig: Rig,
) -> None:
    engine = ScriptedEngine([FAR, FILL, FAR])
    state = await rig.play(engine, LOSS, on_event=ask_first)
    own, loss = state.missions
    [preempted] = of_kind(rig, "mission_preempted")
    assert preempted.mission == own
    order = [
        (event.data.kind, event.mission)
        for event in rig.events
        if event.data.kind in ("mission_started", "mission_preempted", "mission_finished")
    ]
    assert order == [
        ("mission_started", own), ("mission_preempted", own),
        ("mission_started", loss), ("mission_finished", loss),
        ("mission_started", own), ("mission_finished", own),
    ]  # fmt: skip
    assert [state.missions[name].status for name in (own, loss)] == ["verified", "verified"]
    sent = [e.data.command for e in rig.events if isinstance(e.data, ev.CommandSent)]
    assert [(c.agent, c.verb) for c in sent] == [
        ("Robot_T02", "move_to"), ("Robot_T02", "hold"),
        ("Drone_T04", "move_to"), ("Robot_T02", "move_to"),
    ]  # fmt: skip
    assert len({command.command_id for command in sent}) == len(sent)


@pytest.mark.parametrize("act", [ControlStation.stop_all, ControlStation.cancel])
async def test_stopping_while_a_mission_gives_way_ends_it_once_and_for_all(
    rig: Rig, act: Callable[[ControlStation], None]
) -> None:
    stopped: list[str] = []

    def on_event(event: ev.Event, station: ControlStation) -> None:
        ask_first(event, station)
        if isinstance(event.data, ev.MissionPreempted):
            stopped.append(str(event.mission))
            act(station)

    state = await rig.play(ScriptedEngine([FAR, FILL, FAR]), LOSS, on_event=on_event)
    [own] = stopped
    finished = [event.mission for event in of_kind(rig, "mission_finished")]
    assert sorted(set(finished), key=str) == sorted(finished, key=str)
    assert set(finished) == set(state.missions)
    assert state.missions[own].status == "cancelled"
