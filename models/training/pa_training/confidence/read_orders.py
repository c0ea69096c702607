"""Lets the models read orders of which it is known what they ask for; nothing is carried out.

`python -m pa_training.confidence.read_orders --out FILE` puts every fourth order of the writers who
are kept aside through the steps of a mission up to the judge's verdict. For each the file gets a
line: the readings of all readers with their evidence, and which of them are right.
"""

import argparse
import asyncio
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from pa_console.evaluation.memo_engine import MemoEngine
from pa_console.fleets.simulated import SimulatedFleet
from pa_console.language.canonical.clauses import ASKED
from pa_console.language.canonical.reading import agree
from pa_console.llm.local.engine import Engine, SessionEngine
from pa_console.llm.models.catalogue import find_model
from pa_console.mission.approval import CheckedPlan, OrderAsRead, request_approval
from pa_console.mission.context import MissionContext, Services
from pa_console.mission.judge import judge
from pa_console.mission.plan import PlanForDecision, PlanningFailure, plan
from pa_console.mission.readings import foreseen
from pa_console.mission.retrieve import retrieve
from pa_console.policy.monitor import Monitor
from pa_console.policy.rulebook import Rulebook, load_rules
from pa_console.resources import find_data
from pa_console.schema.base import StrictModel
from pa_console.schema.mission import ApprovalState
from pa_console.schema.plan import Plan
from pa_console.session.confidence import Evidence
from pa_training.orders.meaning import (
    NOTHING_ASKED,
    asked_as_seen,
    corrected,
    meaning_now,
    order_of,
)
from pa_training.orders.near_duplicates import shipped_duplicates
from pa_training.proof.playing import mission_from
from pa_training.samples.groups import Recipe, recipes, situation_of
from pa_training.situations.situations import Situation
from pa_training.situations.worlds import generated_numbers, shipped_missions
from pa_training.teacher.teacher import Target, teach

EVERY = 4
"""Of the orders, every so many is read."""


class KnownReading(StrictModel):
    """One reading of an order, its evidence, and whether it is right."""

    asked: str
    evidence: Evidence
    chance: float
    right: bool


class ReadOrder(StrictModel):
    """How one order was read, and what the console would put to the operator."""

    group: str
    kind: str
    text: str
    meant: str
    readings: tuple[KnownReading, ...]
    served: str
    """The reading that the plan on show is for."""
    right: bool
    """Whether that is what was meant, or its plan gives the orders that are right for it."""
    state: ApprovalState | None
    confidence: float | None
    gaps: tuple[str, ...] = ()
    """The evidence in the order's words against the reading."""
    read_apart: bool = False


class KnownOrder(NamedTuple):
    """An order in words, and what it asks for."""

    text: str
    kind: str
    meant: str
    target: Target | None
    """What is right to do; None where the teacher has no plan."""


class OrderReader:
    """Reads orders in their situations with the models of `engine`."""

    def __init__(self, engine: SessionEngine, rulebook: Rulebook) -> None:
        self._engine, self.rulebook = engine, rulebook

    def services(self, situation: Situation) -> Services:
        """Return what the steps of a mission need in `situation`."""
        return Services.open(SimulatedFleet(situation.fork()), self.rulebook, self._engine)

    async def read(self, group: str, services: Services, order: KnownOrder) -> ReadOrder | None:
        """Return how one order is read; None where no model gave a plan, or it is blocked."""
        world, base = services.fleet.world, services.fleet.world.base
        mission = mission_from(order.text)
        monitor = Monitor(services.rulebook, world, services.sightings)
        context = MissionContext(services, mission, lambda _event: None, monitor)
        first = await plan(context, retrieve(context, mission))
        if isinstance(first, PlanningFailure):
            return None
        shown = await judge(context, first)

        def right(asked: str, made: Plan) -> bool:
            return asked == order.meant or agree(asked, order.meant, base) or _due(made, order)

        plans = {first.best.asked: first.best.examination.plan}
        plans[shown.best.asked] = shown.best.examination.plan
        for each in shown.readings:
            if each.asked not in plans:
                plans[each.asked] = await foreseen(context, first.answered, each.asked)
        return ReadOrder(
            group=group,
            kind=order.kind,
            text=order.text,
            meant=order.meant,
            readings=tuple(
                KnownReading(
                    asked=each.asked,
                    evidence=each.evidence,
                    chance=each.chance,
                    right=right(each.asked, plans[each.asked]),
                )
                for each in shown.readings
            ),
            served=shown.best.asked,
            right=right(shown.best.asked, plans[shown.best.asked]),
            state=_state(shown),
            confidence=shown.confidence,
            gaps=shown.best.all_gaps,
            read_apart=shown.read_apart,
        )


def _due(made: Plan, order: KnownOrder) -> bool:
    """Return whether a plan gives the orders that are right for what is meant.

    For words that ask for nothing that is to leave every asset as it is.
    """
    if order.target is None:
        still = all(action.verb == "hold" for action in made.actions)
        return still and order.meant == f"{ASKED}{NOTHING_ASKED}"
    known = (order.target.plan, *order.target.alternatives)
    return any(_orders(made) == _orders(one) for one in known)


def _orders(plan: Plan) -> frozenset[tuple[str, str]]:
    return frozenset((action.agent, action.command) for action in plan.actions)


def _state(shown: PlanForDecision) -> ApprovalState | None:
    """Return the state in which the plan would be put to the operator."""
    best = shown.best
    found = best.examination
    checked = CheckedPlan(found.plan, found.findings, best.verdict, best.judge_error)
    read = OrderAsRead(
        gaps=best.all_gaps,
        confidence=shown.confidence,
        read_apart=shown.read_apart,
        narrowed=best.narrowed,
        question="what is to be done?" if best.mentions.baseless else "",
    )
    return request_approval("", best.attempt, checked, read).state


def known_orders_of(recipe: Recipe, situation: Situation) -> Iterator[KnownOrder]:
    """Yield the orders of one writer's situation for which one plan will do.

    Those too like a mission of a test set are left out.
    """
    world, digest = situation.world, situation.digest
    orders = recipe.written.first_orders
    fresh = shipped_duplicates().keep([order.text for order in orders], world)
    for written, kept in zip(orders, fresh, strict=True):
        meaning = meaning_now(corrected(written.meaning))
        if not kept or not meaning:
            continue
        meant, target = meaning, None
        with suppress(ValueError):
            meant = asked_as_seen(meaning, world, digest)
        with suppress(ValueError, LookupError):
            order = order_of(meaning, world, digest)
            target = teach(order, world, situation.picture, digest)
        yield KnownOrder(written.text, recipe.writer, meant, target)


async def read_kept_aside(out: Path, reader: OrderReader) -> None:
    """Read every fourth order of the writers who are kept aside, and add them to `out`."""
    forbidden, number = generated_numbers(shipped_missions()), 0
    for recipe in recipes("development"):
        situation = situation_of(recipe, forbidden)
        orders = [*known_orders_of(recipe, situation)]
        chosen = orders[-number % EVERY :: EVERY]
        number += len(orders)
        services = reader.services(situation)
        for order in chosen:
            read = await reader.read(f"{recipe.writer}-{recipe.place}", services, order)
            if read is not None:
                with out.open("a", encoding="utf-8") as file:
                    file.write(read.model_dump_json() + "\n")


def main() -> None:
    """Add what was read to a file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="file of JSON lines; added to")
    parser.add_argument("--answers", type=Path, help="file that keeps the models' answers")
    given = parser.parse_args()
    rulebook = load_rules(find_data("rules", "checkpoint", "rules.yaml"))

    async def run() -> None:
        engine = Engine(find_model(None, second_reader=""))
        answers = MemoEngine(engine, given.answers, exact=True)
        try:
            await read_kept_aside(given.out, OrderReader(answers, rulebook))
        finally:
            await engine.close()

    asyncio.run(run())


if __name__ == "__main__":
    main()
