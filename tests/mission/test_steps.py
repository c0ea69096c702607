"""Plans in steps: nothing is sent before what it comes after is verified, and nothing is lost."""

import asyncio
import json
from datetime import UTC, datetime
from random import Random
from typing import TypeVar

import pytest

from pa_console.fleets.fleet import Outlook
from pa_console.fleets.simulated import ForeseenFleet, SimulatedFleet
from pa_console.mission.examine import Examination, examine
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.events import event as ev
from pa_console.schema.incident import FailAsset, SpawnTrack
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action, Plan
from pa_console.session.state import SessionState
from pa_console.station.assembly import Site
from pa_console.station.station import ControlStation
from tests.rig import Rig
from tests.scripted import FAILURE, SUCCESS, ScriptedEngine

Order = tuple[str, str, tuple[int, ...]]


def plan(*orders: Order, stay_s: float = 0.0) -> str:
    """Return the JSON text of a plan of (agent, command, after)."""
    stay = {"stay_s": stay_s} if stay_s else {}
    actions = [
        {"agent": agent, "command": command, **({"after": after} if after else {}), **stay}
        for agent, command, after in orders
    ]
    return json.dumps({"reason": "scripted", "actions": actions})


TWO = plan(("Robot_T01", "move_to NorthGate", ()), ("Drone_T04", "return_to_base", (1,)))
Kind = TypeVar("Kind")


def some_mission() -> Mission:
    """Return a mission of which nothing but its words is known."""
    return Mission(id="M1", text="Watch the gates.", created=datetime(2026, 3, 1, tzinfo=UTC))


def of_kind(rig: Rig, kind: type[Kind]) -> list[Kind]:
    """Return the payloads of a kind, in order."""
    return [event.data for event in rig.events if isinstance(event.data, kind)]


async def test_the_second_step_is_sent_once_the_first_is_verified(rig: Rig) -> None:
    trace = await rig.run(ScriptedEngine([TWO]))
    assert trace.status == "verified"
    told = [
        event.data.command.agent if isinstance(event.data, ev.CommandSent) else "verified"
        for event in rig.events
        if isinstance(event.data, ev.CommandSent | ev.MissionVerified)
    ]
    assert told == ["Robot_T01", "verified", "Drone_T04", "verified"]
    assert [seen.step for seen in of_kind(rig, ev.MissionVerified)] == [1, 2]
    assert "Step 1 of 2" in trace.report
    assert "Step 2 of 2" in trace.report


async def test_a_step_that_fails_holds_what_comes_after_it_and_says_so(rig: Rig) -> None:
    def fail(event: ev.Event, station: ControlStation) -> None:
        if isinstance(event.data, ev.CommandSent):
            station.inject(FailAsset(kind="fail", asset="Robot_T01"))

    trace = await rig.run(ScriptedEngine([TWO]), on_event=fail)
    assert [c.command.agent for c in trace.commands.values()] == ["Robot_T01"]
    (held,) = of_kind(rig, ev.StepsHeld)
    assert held.orders == ("Drone_T04 return_to_base",)
    assert trace.status == "unverified"
    assert "not sent: Drone_T04 return_to_base" in trace.reason
    assert any(n.level == "alarm" and "not sent" in n.text for n in rig.state.notices)


ORDER = "First Robot_T01 to the north gate, then bring Drone_T04 home."
STEPS = (
    plan(("Robot_T01", "move_to NorthGate", ())),
    plan(("Drone_T04", "return_to_base", ())),
)


async def test_words_of_order_become_one_plan_in_steps_approved_once(rig: Rig) -> None:
    trace = await rig.run(ScriptedEngine(STEPS), text=ORDER)
    (asked,) = of_kind(rig, ev.ApprovalRequested)
    assert [(a.agent, a.after) for a in asked.plan.actions] == [
        ("Robot_T01", ()),
        ("Drone_T04", (1,)),
    ]
    assert [read.text for read in of_kind(rig, ev.OrderStepRead)] == [
        "Robot_T01 to NorthGate.",
        "Bring Drone_T04 home.",
    ]
    assert trace.status == "verified"
    sent = [command.command.agent for command in trace.commands.values()]
    assert sent == ["Robot_T01", "Drone_T04"]


async def test_a_later_step_is_planned_in_the_picture_that_the_first_one_leaves(rig: Rig) -> None:
    steps = (
        plan(("Robot_T01", "move_to NorthGate", ())),
        plan(("Robot_T01", "move_to EastGate", ())),
    )
    text = "Send Robot_T01 to the north gate and then to the east gate."
    trace = await rig.run(ScriptedEngine(steps), text=text)
    second = of_kind(rig, ev.OrderStepRead)[1]
    assert second.text == "Send Robot_T01 to EastGate."
    assert trace.status == "verified"
    rehearsals = of_kind(rig, ev.PlanRehearsed)
    assert rehearsals[1].rehearsal.before.assets["Robot_T01"].at == "NorthGate"


async def test_a_step_that_breaks_a_rule_blocks_the_whole_order(rig: Rig) -> None:
    home = plan(("Drone_T02", "return_to_base", ()))
    text = "First bring Drone_T02 home, then send Drone_T04 to the north gate."
    trace = await rig.run(ScriptedEngine([home]), text=text)
    assert trace.status == "refused"
    assert not trace.commands


async def test_a_judge_that_objects_to_one_step_objects_to_the_order(rig: Rig) -> None:
    engine = ScriptedEngine(STEPS, [SUCCESS, FAILURE])
    trace = await rig.run(engine, text=ORDER)
    (asked,) = of_kind(rig, ev.ApprovalRequested)
    assert asked.needs_override
    assert not trace.commands


async def test_a_session_with_steps_reads_the_same_from_its_log(rig: Rig) -> None:
    live = await rig.run(ScriptedEngine(STEPS), text=ORDER)
    state = SessionState()
    for event in rig.events:
        if not event.data.transient:
            state.apply(ev.Event.model_validate_json(event.model_dump_json()))
    again = state.missions[live.mission.id]
    assert again.commands == live.commands
    assert again.verified == live.verified
    assert (again.status, again.report, again.reason) == (live.status, live.report, live.reason)
    assert [step.plan for step in again.attempts] == [step.plan for step in live.attempts]


async def test_a_step_that_would_break_a_rule_by_its_moment_is_held_with_an_alarm(rig: Rig) -> None:
    def fail(event: ev.Event, station: ControlStation) -> None:
        if isinstance(event.data, ev.MissionVerified):
            station.inject(FailAsset(kind="fail", asset="Robot_T01"))

    relief = (("Robot_T01", "move_to WestGate", ()), ("Drone_T01", "return_to_base", (1,)))
    trace = await rig.run(ScriptedEngine([plan(*relief, stay_s=5.0)]), on_event=fail)
    assert trace.status == "held"
    assert [c.command.agent for c in trace.commands.values()] == ["Robot_T01"]
    (held,) = of_kind(rig, ev.StepsHeld)
    assert "step 2 of 2 would break a rule now: WF-03" in held.reason
    assert any(n.level == "alarm" and "would break a rule" in n.text for n in rig.state.notices)


async def test_what_is_done_before_an_emergency_is_not_done_again(rig: Rig) -> None:
    hostile = SpawnTrack(kind="spawn", gate="EastGate", intent="hostile")
    watch = plan(("Drone_T04", "observe EastGate", ()))
    third = plan(("Robot_T02", "move_to Checkpoint", ()))
    engine = ScriptedEngine([*STEPS, third, watch, third])
    station = rig.station(engine, respond=True)
    verified = list[int]()

    def attack(event: ev.Event, station: ControlStation) -> None:
        if isinstance(event.data, ev.MissionVerified) and event.data.step and not verified:
            verified.append(event.data.step)
            station.inject(hostile)

    text = f"{ORDER} After that send Robot_T02 to the checkpoint."
    await rig.carry_out(station, [text], on_event=attack)
    preempted = of_kind(rig, ev.MissionPreempted)
    sent = [sent.command.agent for sent in of_kind(rig, ev.CommandSent)]
    assert preempted
    assert sent.count("Robot_T01") == 1


STEPS_DRAWN = 24


def drawn(random: Random, names: tuple[str, ...], gates: tuple[str, ...]) -> Plan:
    """Return a plan of two or three steps, each of one or two commands."""
    actions: list[Action] = []
    before: tuple[int, ...] = ()
    for _ in range(random.randint(2, 3)):
        first = len(actions) + 1
        for name in sorted({random.choice(names) for _ in range(random.randint(1, 2))}):
            command = random.choice((f"move_to {random.choice(gates)}", "return_to_base"))
            actions.append(Action(agent=name, command=command, after=before))
        before = tuple(range(first, len(actions) + 1))
    return Plan(reason="drawn", actions=tuple(actions))


def one_by_one(plan: Plan, fleet: Outlook, rules: Rulebook) -> list[Examination]:
    """Examine each step by itself, in the picture that those before it leave."""
    found: list[Examination] = []
    for numbers in plan.steps:
        step = asyncio.run(examine(plan.part(numbers), some_mission(), fleet, rules))
        found.append(step)
        if step.rehearsal is None or step.blocked:
            break
        fleet = ForeseenFleet(fleet.world, step.rehearsal.after)
    return found


@pytest.mark.parametrize("seed", range(2))
def test_a_plan_is_blocked_where_one_of_its_steps_is(seed: int, site: Site) -> None:
    random = Random(seed)
    fleet = SimulatedFleet.start(site.world)
    for _ in range(10):
        fleet.step()
    gates, posted = tuple(site.world.gates), tuple(site.world.assets)
    guards = {name for cover in fleet.picture().gates.values() for name in cover.by}
    free = tuple(name for name in posted if name not in guards)
    names = posted + 4 * free
    verdicts = set[bool]()
    for _ in range(STEPS_DRAWN // 2):
        plan = drawn(random, names, gates)
        whole = asyncio.run(examine(plan, some_mission(), fleet, site.rulebook))
        steps = one_by_one(plan, fleet, site.rulebook)
        if any(step.blocked for step in steps):
            assert whole.blocked, plan.answer
        verdicts.add(whole.blocked)
        lost = [
            gate
            for step in whole.steps
            for gate, line in step.timeline.gates.items()
            if line.covered_before and not line.covered_after
        ]
        assert whole.blocked or not lost, "no gate is left bare by any step of a plan that passes"
    assert verdicts == {True, False}, "the plans that are drawn tell something"
