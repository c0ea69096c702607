"""Lets the models read orders of which it is known what they ask for; nothing is carried out.

`python -m pa_training.confidence.read_orders --out FILE` puts generated orders through the steps of
a mission up to the judge's verdict: as people say them, in words of the templates, and in worlds
and words that no training has. With `--written` it is every fourth order of the writers who are
kept aside. For each the file gets a line: the readings of all readers with their evidence, and
which of them are right.
"""

import argparse
import asyncio
import random
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from pa_console.evaluation.memo_engine import MemoEngine
from pa_console.fleets.simulated import SimulatedFleet
from pa_console.language.canonical.clauses import ASKED
from pa_console.language.canonical.reading import agree
from pa_console.llm.local.engine import Engine
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
from pa_console.schema.mission import ApprovalState, Mission
from pa_console.schema.plan import Plan
from pa_console.session.confidence import Evidence
from pa_training import LANGUAGE
from pa_training.order_generator.orders import canonical_meaning, canonical_order
from pa_training.order_generator.sampler import sample_order
from pa_training.phrasing.no_orders import NOTHING_ASKED
from pa_training.phrasing.phrasing import phrase
from pa_training.phrasing.rewording import spoken_words
from pa_training.proof.playing import words_findings
from pa_training.samples.near_duplicates import NearDuplicates
from pa_training.samples.planner_samples import Recipe
from pa_training.samples.reading_samples import NO_TIME
from pa_training.samples.written_orders import (
    WrittenOrder,
    asked_as_seen,
    drawn_situation,
    meaning_now,
    ordered,
    read_writers,
)
from pa_training.situations.situations import Situation, random_situation
from pa_training.situations.worlds import (
    Split,
    generated_numbers,
    random_world,
    shipped_missions,
)
from pa_training.teacher.teacher import Target, teach

SEEDS = (434, 436)
"""Seeds of which neither the default model nor its second reader has learnt the words."""
MISSIONS = 8
"""So many missions have the groups that the words were written for."""
TRIES = 3
OF_EACH = 6
"""The most orders that are read in one situation."""
IN_TEMPLATES = 0.25
"""The share of the orders of such a seed that are read in words of the templates too."""
HELD_OUT = 438
"""The seed of the orders in worlds and words that no training has."""
EVERY = 4
"""Of the written orders, every so many is read."""


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


class KnownOrder(NamedTuple):
    """An order in words, and what it asks for."""

    text: str
    kind: str
    meant: str
    target: Target | None
    """What is right to do; None where the teacher has no plan."""


class OrderReader:
    """Reads orders in their situations with the models of `engine`."""

    def __init__(self, engine: Engine, rulebook: Rulebook) -> None:
        self._engine, self.rulebook = engine, rulebook

    def services(self, situation: Situation) -> Services:
        """Return what the steps of a mission need in `situation`."""
        return Services.open(SimulatedFleet(situation.fork()), self.rulebook, self._engine)

    async def read(self, group: str, services: Services, order: KnownOrder) -> ReadOrder | None:
        """Return how one order is read; None where no model gave a plan, or it is blocked."""
        world, base = services.fleet.world, services.fleet.world.base
        mission = Mission(id="M", text=order.text, created=NO_TIME)
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
        gaps=best.gaps_told,
        confidence=shown.confidence,
        read_apart=shown.read_apart,
        narrowed=best.narrowed,
        question="what is to be done?" if best.mentions.baseless else "",
    )
    return request_approval("", best.attempt, checked, read).state


def generated_orders(
    recipe: Recipe, rng: random.Random, situation: Situation
) -> Iterator[KnownOrder]:
    """Yield the orders of one group, as people say them where that is known, or in templates."""
    world, picture, digest = situation.world, situation.picture, situation.digest
    spoken, known = spoken_words(recipe), NearDuplicates(shipped_missions())
    seen = set[str]()
    for _ in range(TRIES * recipe.missions):
        order, kind = sample_order(rng, world, picture, digest)
        words = phrase(order, world, picture, rng, recipe.split)
        meaning = canonical_meaning(order, world)
        if meaning in seen or (spoken and meaning not in spoken and len(seen) >= recipe.missions):
            continue
        seen.add(meaning)
        try:
            target = teach(order, world, picture, digest)
        except ValueError:
            continue
        said = [] if order.injected else list(spoken.get(meaning, ()))
        texts = {random.Random(meaning).choice(said): f"{kind}/spoken"} if said else {}
        if not spoken or random.Random(meaning).random() < IN_TEMPLATES:
            texts[words.text] = kind
        for (text, how), kept in zip(texts.items(), known.keep(list(texts), world), strict=True):
            if kept:
                meant = f"{ASKED}{canonical_order(order, world, picture, digest)}"
                yield KnownOrder(text, how, meant, target)


async def read_generated(out: Path, reader: OrderReader, first: int, groups: int) -> None:
    """Read the orders of `groups` groups of every seed, from `first` on, and add them to `out`."""
    forbidden = generated_numbers(shipped_missions())
    for number in range(first, first + groups):
        for seed in (*SEEDS, HELD_OUT):
            split: Split = "heldout" if seed == HELD_OUT else "train"
            recipe = Recipe(number, seed, MISSIONS, split)
            rng = random.Random(f"{seed}/{recipe.split}/{number}")
            world = random_world(rng, recipe.split, forbidden)
            situation = random_situation(rng, world, history=recipe.history)
            orders = [
                order
                for order in generated_orders(recipe, rng, situation)
                if not words_findings(world, situation.case("o", order.text, ()), reader.rulebook)
            ]
            await _read_all(out, reader, f"{seed}-{number}", situation, orders[:OF_EACH])


async def read_written(out: Path, reader: OrderReader) -> None:
    """Read every fourth order of the writers who are kept aside, and add them to `out`."""
    missions = shipped_missions()
    forbidden, number = generated_numbers(missions), 0
    for name, writer in read_writers(LANGUAGE / "development").items():
        known = NearDuplicates(missions)
        for place, each in enumerate(writer.situations, 1):
            situation = drawn_situation(each, forbidden)
            fresh = known.keep([order.text for order in each.first_orders], situation.world)
            orders = [
                one.model_copy(update={"meaning": meaning_now(one.meaning)})
                for one, kept in zip(each.first_orders, fresh, strict=True)
                if kept and meaning_now(one.meaning)
            ]
            chosen = orders[-number % EVERY :: EVERY]
            number += len(orders)
            read = [_written_order(name, order, situation) for order in chosen]
            await _read_all(out, reader, f"{name}-{place}", situation, read)


def _written_order(writer: str, order: WrittenOrder, situation: Situation) -> KnownOrder:
    meant, target = order.meaning, None
    with suppress(ValueError):
        meant = asked_as_seen(meant, situation.world, situation.digest)
    with suppress(ValueError, LookupError):
        target = ordered(order.meaning, situation)
    return KnownOrder(order.text, writer, meant, target)


async def _read_all(
    out: Path, reader: OrderReader, group: str, situation: Situation, orders: Sequence[KnownOrder]
) -> None:
    services = reader.services(situation)
    for order in orders:
        read = await reader.read(group, services, order)
        if read is not None:
            with out.open("a", encoding="utf-8") as file:
                file.write(read.model_dump_json() + "\n")


def main() -> None:
    """Add what was read to a file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="file of JSON lines; added to")
    parser.add_argument("--first", type=int, default=0, help="the first situation")
    parser.add_argument("--groups", type=int, default=45, help="situations of each seed")
    parser.add_argument("--written", action="store_true", help="orders of the writers kept aside")
    parser.add_argument("--answers", type=Path, help="file that keeps the models' answers")
    given = parser.parse_args()
    rulebook = load_rules(find_data("rules", "checkpoint", "rules.yaml"))

    async def run() -> None:
        engine = Engine(find_model(None, second_reader=""))
        answers = MemoEngine(engine, given.answers, exact=True)
        try:
            reader = OrderReader(answers.engine(), rulebook)
            if given.written:
                await read_written(given.out, reader)
            else:
                await read_generated(given.out, reader, given.first, given.groups)
        finally:
            await engine.close()

    asyncio.run(run())


if __name__ == "__main__":
    main()
