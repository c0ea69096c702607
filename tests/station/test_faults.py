"""What goes wrong beside the plan: the worker dies, the operator stops, an emergency comes."""

import asyncio
from collections.abc import Callable

import pytest

from pa_console.schema.events import event as ev
from pa_console.schema.incident import FailAsset, WorkerFault
from pa_console.station.station import ControlStation
from pa_console.station.worker import Background
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


async def test_the_error_of_a_task_is_told_and_those_that_end_well_are_not() -> None:
    told: list[BaseException] = []
    background = Background(told.append)

    async def fine() -> None:
        return

    async def broken() -> None:
        raise ValueError("a defect")

    await asyncio.wait([background.start(fine()), background.start(broken())])
    assert [str(error) for error in told] == ["a defect"]
    await background.stop()


async def test_stopping_waits_until_every_task_has_tidied_up() -> None:
    told: list[BaseException] = []
    background, tidied = Background(told.append), list[str]()

    async def work(name: str, fails: bool) -> None:
        try:
            await asyncio.Event().wait()
        finally:
            tidied.append(name)
            if fails:
                raise RuntimeError("while tidying up")

    tasks = [background.start(work("a", False)), background.start(work("b", True))]
    await asyncio.wait(tasks, timeout=0)
    await background.stop()
    assert sorted(tidied) == ["a", "b"]
    assert all(task.done() for task in tasks)
    assert [str(error) for error in told] == ["while tidying up"]
    await background.stop()


async def test_a_task_that_was_cancelled_is_no_failure() -> None:
    background = Background(lambda error: pytest.fail(str(error)))
    task = background.start(asyncio.sleep(3600))
    task.cancel()
    await asyncio.wait([task])
    await background.stop()


async def test_who_is_cancelled_while_stopping_stays_cancelled() -> None:
    background = Background(lambda _: None)
    tidying = asyncio.Event()

    async def slow() -> None:
        try:
            await asyncio.Event().wait()
        finally:
            tidying.set()
            await asyncio.Event().wait()

    tasks = [background.start(slow())]
    await asyncio.wait(tasks, timeout=0)
    stopping = asyncio.create_task(background.stop())
    await tidying.wait()
    stopping.cancel()
    await asyncio.wait([stopping, *tasks])
    assert stopping.cancelled()
