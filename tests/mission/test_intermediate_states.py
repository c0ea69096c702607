"""Every rule holds in every intermediate state of a plan in steps, whatever its steps are."""

import asyncio
from random import Random

import pytest

from pa_console.fleets.fleet import Outlook
from pa_console.fleets.simulated import ForeseenFleet, SimulatedFleet
from pa_console.mission.examine import Examination, examine
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.plan import Action, Plan
from pa_console.station.assembly import Site
from tests.mission.test_steps import some_mission

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
