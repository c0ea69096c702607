"""Missions that start themselves: alarm, workflow, halt, queue, emergency (Section IV-C)."""

from collections.abc import Sequence

from pa_console.schema.events import event as ev
from pa_console.schema.incident import (
    FailAsset,
    Incident,
    IncidentCondition,
    Scenario,
    ScriptedEvent,
    SetBattery,
    SetRadio,
    SpawnTrack,
    TrackIs,
)
from pa_console.station.station import ControlStation
from tests.rig import Rig
from tests.scripted import ScriptedEngine, plan

RECON = plan(("Drone_T04", "observe WestGate"))
IDENTIFY = plan(("Robot_T01", "identify WestGate"))
WARN = plan(("Robot_T01", "warn WestGate"))
FILL = plan(("Drone_T04", "move_to EastGate"))


def scenario(
    *events: tuple[float | IncidentCondition, Incident], duration_s: float = 200.0
) -> Scenario:
    """Return a scenario of incidents at times or on conditions."""
    return Scenario(
        name="test",
        title="test",
        about="test",
        duration_s=duration_s,
        events=tuple(
            ScriptedEvent(at_s=when, do=do)
            if isinstance(when, int | float)
            else ScriptedEvent(when=when, do=do)
            for when, do in events
        ),
    )


def vehicle(gate: str = "WestGate", **truth: str) -> SpawnTrack:
    """Return a vehicle that comes into sight at once."""
    return SpawnTrack.model_validate({"gate": gate, "distance_m": 60.0, "name": "V1", **truth})


def of_kind(rig: Rig, kind: str) -> Sequence[ev.Event]:
    """Return the events of one kind."""
    return [event for event in rig.events if event.data.kind == kind]


async def test_a_detection_becomes_a_mission_that_goes_through_the_workflow(rig: Rig) -> None:
    engine = ScriptedEngine([RECON, IDENTIFY, WARN])
    state = await rig.play(engine, scenario((1.0, vehicle(when_warned="leave"))))
    (trace,) = state.missions.values()
    assert trace.mission.source == "alarm"
    moves = [e.data for e in of_kind(rig, "workflow_moved") if isinstance(e.data, ev.WorkflowMoved)]
    assert moves[0].rule_id == "WF-01"
    assert [move.phase for move in moves] == sorted(move.phase for move in moves)
    assert trace.status == "verified", trace.reason
    verbs = [e.data.command.verb for e in rig.events if isinstance(e.data, ev.CommandSent)]
    assert verbs.index("identify") < verbs.index("warn")
    assert len(of_kind(rig, "approval_requested")) == len(of_kind(rig, "mission_verified"))


async def test_an_authorized_vehicle_is_not_warned(rig: Rig) -> None:
    engine = ScriptedEngine([RECON, IDENTIFY, WARN])
    state = await rig.play(engine, scenario((1.0, vehicle(identity="authorized"))))
    (trace,) = state.missions.values()
    assert trace.status == "verified", trace.reason
    assert not any(command.command.verb == "warn" for command in trace.commands.values())


async def test_a_failing_asset_halts_the_plan_and_the_mission_plans_again(rig: Rig) -> None:
    failed = scenario((0.0, FailAsset(asset="Ugv_T01")), duration_s=120.0)
    engine = ScriptedEngine([FILL, plan(("Ugv_T02", "move_to EastGate"))])

    def break_down(event: ev.Event, station: ControlStation) -> None:
        match event.data:
            case ev.CommandReplied(reply=reply) if reply.status == "acknowledged":
                if reply.agent == "Drone_T04" and not of_kind(rig, "plan_halted"):
                    station.inject(FailAsset(asset="Drone_T04"))
            case _:
                pass

    state = await rig.play(engine, failed, on_event=break_down)
    halted = [e.data for e in rig.events if isinstance(e.data, ev.PlanHalted)]
    assert len(halted) == 1
    assert "Drone_T04" in " ".join(halted[0].reasons)
    first = next(iter(state.missions.values()))
    assert first.status == "verified", first.reason
    assert first.metrics is not None
    assert first.metrics.halts == 1
    assert state.picture is not None
    assert state.picture.gates["EastGate"].by == ("Ugv_T02",)


async def test_a_low_battery_waits_until_the_active_mission_is_over(rig: Rig) -> None:
    low = plan(("Drone_T04", "move_to NorthGate"), ("Drone_T02", "return_to_base"))
    played = scenario(
        (1.0, vehicle(identity="authorized")),
        (TrackIs(track="V1", state="observed"), SetBattery(asset="Drone_T02", percent=18.0)),
    )
    engine = ScriptedEngine([plan(("Drone_T01", "observe WestGate")), IDENTIFY, low])
    state = await rig.play(engine, played)
    first, second = state.missions.values()
    assert "Drone_T02" in second.mission.text
    order = [
        (e.data.kind, e.mission)
        for e in rig.events
        if e.data.kind in ("mission_received", "mission_started", "mission_finished")
    ]
    assert order.index(("mission_received", second.mission.id)) < order.index(
        ("mission_finished", first.mission.id)
    ), "the alert came while the first mission was worked on"
    assert order.index(("mission_finished", first.mission.id)) < order.index(
        ("mission_started", second.mission.id)
    )


async def test_two_alarms_in_one_tick_are_queued_in_a_fixed_order(rig: Rig) -> None:
    both = scenario(
        (1.0, vehicle("NorthGate")), (1.0, SpawnTrack(gate="SouthGate", distance_m=60.0)),
        duration_s=10.0,
    )  # fmt: skip
    engine = ScriptedEngine([plan(("Drone_T04", "report"))])
    orders: list[list[str]] = []
    for _ in range(2):
        run = Rig(rig.site)
        state = await run.play(engine, both)
        orders.append([trace.mission.text for trace in state.missions.values()])
        queues = [e.data for e in run.events if isinstance(e.data, ev.QueueChanged)]
        assert any(len(queue.entries) for queue in queues)
        assert all(entry.reason for queue in queues for entry in queue.entries)
    assert orders[0] == orders[1]
    assert len(orders[0]) == 2


async def test_an_emergency_goes_before_the_active_mission_which_comes_back(rig: Rig) -> None:
    loss = scenario(
        (0.0, FailAsset(asset="Ugv_T01")),
        (1.0, vehicle(intent="hostile", when_warned="go_on")),
    )  # fmt: skip
    engine = ScriptedEngine([plan(("Drone_T04", "report"))])
    await rig.play(engine, loss)
    emergencies = [
        e.data.alarm
        for e in rig.events
        if isinstance(e.data, ev.AlarmRaised) and e.data.alarm.priority == "emergency"
    ]
    assert emergencies, "two sensors see the hostile vehicle"
    for event in of_kind(rig, "mission_preempted"):
        later = rig.events[rig.events.index(event) :]
        assert any(e.data.kind == "mission_finished" and e.mission == event.mission for e in later)


async def test_stop_is_sent_again_until_every_device_has_answered(rig: Rig) -> None:
    lossy = scenario((0.0, SetRadio(loss=0.6)), (1.0, vehicle()), duration_s=60.0)
    engine = ScriptedEngine([RECON])
    stopped: list[int] = []

    def stop(event: ev.Event, station: ControlStation) -> None:
        if isinstance(event.data, ev.CommandSent) and not stopped:
            stopped.append(event.tick)
            station.stop_all()

    await rig.play(engine, lossy, on_event=stop)
    holds = {
        e.data.command.command_id
        for e in rig.events
        if isinstance(e.data, ev.CommandSent) and e.data.command.command_id.startswith("stop")
    }
    answered = {
        e.data.reply.command_id
        for e in rig.events
        if isinstance(e.data, ev.CommandReplied) and e.data.reply.status == "done"
    }
    assert len(holds) == len(rig.site.world.assets)
    assert len(holds & answered) >= len(holds) - 1
