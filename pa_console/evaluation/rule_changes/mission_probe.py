"""The changed decisions of a rule set at the missions of a set, without any model.

A mission set has no recorded plans: each mission's situation is simulated, and single orders that
are possible in it are rehearsed once and checked by both rule sets.
"""

import asyncio
import random
from collections.abc import Callable
from datetime import UTC, datetime

from pa_console.evaluation.rule_changes.changed_decisions import (
    Findings,
    SessionEffect,
    blocking,
    by_rule,
    intake_flips,
    orders_of,
    plan_flips,
)
from pa_console.mission.rehearse import rehearse
from pa_console.policy.monitor import Monitor
from pa_console.policy.rule_checks import check_mission, check_plan
from pa_console.policy.rule_variables import Sightings
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.command import COMMANDS
from pa_console.schema.evaluation import MissionCase
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action, Plan
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from pa_console.station.headless import SETUP_SETTLE_S

EPOCH = datetime(2000, 1, 1, tzinfo=UTC)


def effect_on_mission(  # noqa: PLR0917 - a mission, both sets of rules, and how much is tried
    case: MissionCase,
    world: World,
    new: Rulebook,
    was: Rulebook,
    plans: int,
    seed: int,
    tried: Callable[[], None] = lambda: None,
) -> SessionEffect:
    """Return the changed decisions of one mission: its intake and `plans` single orders.

    `seed` draws the orders; `tried` is called after each plan. Raises ValueError for a set-up that
    cannot be simulated.
    """
    effect = SessionEffect(missions=1)
    mission = Mission(id=case.id, text=case.command, created=EPOCH)
    effect.flips += intake_flips(
        case.id, *(blocking(check_mission(book, mission, world)) for book in (was, new))
    )
    sim = Checkpoint(world, seed)
    sightings = _begin(sim, case)
    for number, plan in enumerate(_plans(world, plans, seed), start=1):
        old, now = asyncio.run(_checked(sim, plan, mission, (was, new), sightings))
        effect.plans += 1
        effect.compared += len({*by_rule(old), *by_rule(now)})
        effect.flips += plan_flips(case.id, number, orders_of(plan), old, now)
        tried()
    return effect


async def _checked(
    sim: Checkpoint, plan: Plan, mission: Mission, books: tuple[Rulebook, ...], seen: Sightings
) -> tuple[Findings, ...]:
    rehearsal = await rehearse(sim, plan)
    return tuple(
        check_plan(
            book,
            plan=plan,
            rehearsal=rehearsal,
            mission=mission,
            world=sim.world,
            monitor=Monitor(book, sim.world, seen),
        )
        for book in books
    )


def _begin(sim: Checkpoint, case: MissionCase) -> Sightings:
    """Simulate the mission's set-up as an evaluation does; return the sightings."""
    seen = Sightings(sim.world)
    seen.look(sim.picture())
    for incident in case.setup:
        sim.inject(incident)
    for _ in range(round(SETUP_SETTLE_S / sim.world.dt_s)):
        sim.step()
        seen.look(sim.picture())
    return seen


def _plans(world: World, most: int, seed: int) -> list[Plan]:
    """Return the plan without orders, and at most `most` others of one order each."""
    orders = [
        Action(agent=agent, command=f"{verb} {frame}" if spec.takes_frame else verb)
        for agent, asset in world.assets.items()
        for verb, spec in COMMANDS.items()
        if asset.kind in spec.kinds
        for frame in (world.frames if spec.takes_frame else ("",))
    ]
    if len(orders) > most:
        chosen = sorted(random.Random(seed).sample(range(len(orders)), most))
        orders = [orders[place] for place in chosen]
    reason = "tried to see what the rules say of it"
    return [Plan(reason=reason, actions=actions) for actions in ((), *((o,) for o in orders))]
