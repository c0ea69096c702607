"""Patrols: legs in the said order, stays, relief by battery, rules at every leg, an end."""

from pa_console.schema.events import event as ev
from pa_console.schema.incident import SetBattery
from pa_console.station.station import ControlStation
from tests.mission.test_steps import of_kind
from tests.rig import Rig
from tests.scripted import SUCCESS, ScriptedEngine


def engine() -> ScriptedEngine:
    """Return models of which only the judge is asked."""
    return ScriptedEngine([], [SUCCESS])


async def test_a_patrol_goes_leg_by_leg_in_the_said_order(rig: Rig) -> None:
    text = "Patrol west, north and east with Drone_T04, twice, 5 seconds at each."
    trace = await rig.run(engine(), text=text)
    assert trace.status == "verified"
    sent = [f"{c.command.agent} {c.command.target}" for c in trace.commands.values()]
    assert sent == [f"Drone_T04 {gate}Gate" for gate in ("West", "North", "East")] * 2
    seen = [event.tick for event in rig.events if isinstance(event.data, ev.MissionVerified)]
    gone = [event.tick for event in rig.events if isinstance(event.data, ev.CommandSent)]
    stays = [later - earlier for earlier, later in zip(seen, gone[1:], strict=False)]
    assert min(stays) >= 50
    assert "Step 6 of 6" in trace.report


async def test_nobody_is_named_and_the_nearest_free_robot_goes(rig: Rig) -> None:
    trace = await rig.run(engine(), text="Have a robot walk the gates, nearest first.")
    (asked,) = of_kind(rig, ev.ApprovalRequested)
    assert {action.agent for action in asked.plan.actions} == {"Robot_T01"}
    assert sorted(action.target or "" for action in asked.plan.actions) == sorted(
        ("NorthGate", "EastGate", "SouthGate", "WestGate")
    )
    assert asked.state == "approve"
    assert trace.status == "verified"


async def test_another_one_takes_over_before_the_battery_gets_low(rig: Rig) -> None:
    low = [SetBattery(kind="battery", asset="Robot_T01", percent=31.0)]
    text = "Patrol west, north, east and south with Robot_T01, twice."
    await rig.run(engine(), low, text=text)
    (asked,) = of_kind(rig, ev.ApprovalRequested)
    agents = [action.agent for action in asked.plan.actions if action.target]
    assert agents[0] == "Robot_T01"
    assert agents[-1] == "Robot_T02"
    first = agents.index("Robot_T02") + 1
    home = next(a for a in asked.plan.actions if a.command == "return_to_base")
    assert (home.agent, home.after) == ("Robot_T01", (first,)), "once the other is there"


async def test_the_only_guard_of_a_gate_goes_on_no_patrol(rig: Rig) -> None:
    trace = await rig.run(engine(), text="Patrol west and north with Drone_T02.")
    assert trace.status == "refused"
    assert not trace.commands


async def test_a_stop_ends_a_patrol(rig: Rig) -> None:
    def stop(event: ev.Event, station: ControlStation) -> None:
        if isinstance(event.data, ev.MissionVerified):
            station.stop_all()

    trace = await rig.run(engine(), text="Patrol west and north with Drone_T04.", on_event=stop)
    sent = [c.command.target for c in trace.commands.values()]
    assert sent == ["WestGate"]
    assert trace.status == "cancelled"


async def test_the_report_tells_when_each_place_was_seen_and_how_long_nobody_was_there(
    rig: Rig,
) -> None:
    trace = await rig.run(engine(), text="Patrol the checkpoint and the base with Drone_T04 twice.")
    lines = [line for line in trace.report.splitlines() if line.startswith("Patrol: ")]
    assert len(lines) == 2
    assert lines[0].startswith("Patrol: Checkpoint seen at ")
    assert lines[0].count(" s, ") == 1, "seen twice"


async def test_a_patrol_is_paused_resumed_and_stopped_by_words(rig: Rig) -> None:
    said = {1: "Pause the patrol.", 2: "Stop the patrol."}
    gone = list[int]()

    def speak(event: ev.Event, station: ControlStation) -> None:
        match event.data:
            case ev.MissionVerified(step=step) if step in said:
                station.submit(said[step])
            case ev.StepsPaused(paused=True):
                gone.append(len(of_kind(rig, ev.CommandSent)))
                station.submit("Resume the patrol.")
            case _:
                pass

    text = "Patrol west, north and east with Drone_T04."
    trace = await rig.run(engine(), text=text, on_event=speak)
    assert [paused.paused for paused in of_kind(rig, ev.StepsPaused)] == [True, False]
    assert gone == [1]
    assert [c.command.target for c in trace.commands.values()] == ["WestGate", "NorthGate"]
    assert trace.status == "cancelled"
    assert "revoked" in trace.reason


async def test_the_schedule_starts_a_patrol_and_its_interval_is_no_shorter(rig: Rig) -> None:
    trace = await rig.run(engine(), text="Every half hour a robot walks the gates.")
    (read,) = of_kind(rig, ev.StandingOrderRead)
    assert read.order.schedule is not None
    assert read.order.schedule.every_s == 1800.0
    assert read.order.order == "A robot walks the gates."
    assert trace.standing is not None


async def test_an_interval_shorter_than_the_patrol_is_told(rig: Rig) -> None:
    text = "Patrol all four gates with Robot_T02 every 2 minutes, one minute stop at each gate."
    trace = await rig.run(engine(), text=text)
    assert "every 2 minutes is too often: the patrol takes at least" in trace.reason
    assert not of_kind(rig, ev.StandingOrderRead)
