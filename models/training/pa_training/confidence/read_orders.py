"""Lets the models read orders of which it is known what they ask for; nothing is carried out.

`python -m pa_training.confidence.read_orders --out FILE` puts generated orders of the
training split to planner, judge and second reader, in words of the templates and as people say
them. For each the file gets a line: what the console can know of how it was read, and whether what
it would put to the operator is what was asked.
"""

import argparse
import asyncio
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.language.clause_grammar import grounded_reason
from pa_console.language.clauses import ASKED
from pa_console.language.mention_check import check_mentions
from pa_console.language.reading import agree, asked_words, read_asked, read_reason
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.catalogue import find_model
from pa_console.llm.roles.grammar import slot_grammar
from pa_console.llm.roles.judge import Judge, JudgeQuestion, OrderReading
from pa_console.mission.context import Services
from pa_console.mission.judge import DOUBT, LEAST, compare_with_order
from pa_console.mission.propose import PlanQuestion, ask_for_plan
from pa_console.mission.retrieve import RetrievedRules
from pa_console.mission.tasking.choices import commands_serving
from pa_console.mission.tasking.moves import PlanMoves
from pa_console.mission.tasking.obstacles import unmet_asks
from pa_console.policy.rulebook import Rulebook, load_rules
from pa_console.resources import find_data
from pa_console.schema.base import StrictModel
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Plan
from pa_console.schema.rule import RuleHit
from pa_training.order_generator.orders import Order, canonical_meaning
from pa_training.order_generator.sampler import sample_order
from pa_training.phrasing.phrasing import phrase
from pa_training.phrasing.rewording import spoken_words
from pa_training.proof.playing import words_findings
from pa_training.samples.near_duplicates import NearDuplicates
from pa_training.samples.planner_samples import TOP_K, Recipe
from pa_training.samples.reading_samples import NO_TIME
from pa_training.situations.situations import Situation, random_situation
from pa_training.situations.worlds import (
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


class ReadOrder(StrictModel):
    """How one order was read: what the console can know of that, and whether it is right."""

    group: str
    kind: str
    text: str
    meant: str
    asked: str
    planner: float
    judge: float | None
    judge_fits: bool
    gaps: tuple[str, ...]
    own_gaps: int
    second: str
    """What the second reader says; '' where it was not asked."""
    second_sure: float | None
    second_same: bool
    alone: bool
    """Whether the plan is for what the second reader alone has read."""
    right: bool
    own_right: bool
    """Whether what the planner itself has read is."""


@dataclass(frozen=True)
class _Said:
    text: str
    kind: str
    order: Order
    target: Target


class OrderReader:
    """Reads orders in their situations with the models of `engine`."""

    def __init__(self, engine: Engine, rulebook: Rulebook) -> None:
        self._engine, self.rulebook = engine, rulebook

    def services(self, situation: Situation) -> Services:
        """Return what planner, judge and second reader need in `situation`."""
        return Services.open(SimulatedFleet(situation.fork()), self.rulebook, self._engine)

    async def read(
        self, group: str, situation: Situation, services: Services, said: _Said
    ) -> ReadOrder | None:
        """Return how one order is read; None where it has no reading that can be compared."""
        world, picture = situation.world, situation.picture
        task = Mission(id="M", text=said.text, created=NO_TIME)
        hits = tuple(services.retriever.retrieve(said.text, TOP_K))
        question = ask_for_plan(services, RetrievedRules(task, hits))
        proposal = await services.planner.plan(question.prompt, question.grammar)
        plan = proposal.plan
        reading = read_reason(plan.reason) if plan is not None else None
        if plan is None or reading is None or proposal.confidence is None:
            return None
        asked, moves = asked_words(plan.reason).rstrip("; "), PlanMoves(world, picture, plan)
        unmet = [one.told for one in unmet_asks(moves, reading, said.text)]
        gaps = check_mentions(world, picture, said.text, asked, plan, unmet).gaps
        judged = await _reads(services.judge, services, question, task, hits)
        own_gaps = len(gaps)
        fits = not compare_with_order(judged.asked, moves).gaps
        sure = min(proposal.confidence, judged.confidence or 1.0)
        second, same, alone, shown = OrderReading(""), False, False, (asked, plan)
        again = services.second_reader  # one without adapters is not measured, and not fitted to
        if isinstance(again, Judge) and (sure < DOUBT or not fits or gaps):
            second = await _reads(again, services, question, task, hits)
            same = agree(asked, second.asked, world.base)
            if second.asked and not same and (second.confidence or 0.0) >= LEAST:
                other = await _plan_for(services, question, said.text, second.asked)
                if other is not None and _orders(other) == _orders(plan) and fits:
                    same = any(action.verb != "hold" for action in plan.actions)
                if not same:
                    alone, shown = True, (second.asked, other)
                    gaps = check_mentions(
                        world, picture, said.text, second.asked, other or plan
                    ).gaps
        meant = f"{ASKED}{canonical_meaning(said.order, world)}"
        return ReadOrder(
            group=group,
            kind=said.kind,
            text=said.text,
            meant=meant,
            asked=shown[0],
            planner=proposal.confidence,
            judge=judged.confidence,
            judge_fits=fits,
            gaps=gaps,
            own_gaps=own_gaps,
            second=second.asked,
            second_sure=second.confidence,
            second_same=same,
            alone=alone,
            right=_right(*shown, meant, said.target, world.base),
            own_right=_right(asked, plan, meant, said.target, world.base),
        )


def _right(asked: str, plan: Plan | None, meant: str, target: Target, base: str) -> bool:
    """Whether a reading is what was meant, or a plan gives the orders that are right for that."""
    if agree(asked, meant, base):
        return True
    known = (target.plan, *target.alternatives)
    return plan is not None and any(_orders(plan) == _orders(one) for one in known)


def _orders(plan: Plan) -> frozenset[tuple[str, str]]:
    return frozenset((action.agent, action.command) for action in plan.actions)


async def _reads(
    judge: Judge, services: Services, question: PlanQuestion, task: Mission, hits: Sequence[RuleHit]
) -> OrderReading:
    world, prompt_format = services.fleet.world, services.prompt_format
    rules = [services.rulebook.get(hit.rule_id) for hit in hits]
    prompt = prompt_format.judge(world, question.digest, rules, task, None, None)
    assert prompt_format.opening is not None
    opening = prompt_format.opening(world, question.digest, task.text, "")
    return await judge.read(JudgeQuestion("judge", prompt, opening))


async def _plan_for(
    services: Services, question: PlanQuestion, text: str, asked: str
) -> Plan | None:
    """Return the plan for another reading: the console gives the commands, the planner chooses."""
    fleet, reading = services.fleet, read_asked(asked)
    if reading is None or not reading.readable:
        return None
    slots = next(iter(commands_serving(reading, fleet.world, fleet.picture())), None)
    if slots is None:
        return None
    reasons = grounded_reason(fleet.world, question.digest, text, asked)
    return (await services.planner.plan(question.prompt, slot_grammar(slots, reasons))).plan


def _said(recipe: Recipe, rng: random.Random, situation: Situation) -> Iterator[_Said]:
    """Yield the orders of one group, each in words of the templates and as people say it."""
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
        texts = {words.text: kind}
        if not order.injected:
            texts |= dict.fromkeys(spoken.get(meaning, ())[:2], f"{kind}/spoken")
        for (text, how), kept in zip(texts.items(), known.keep(list(texts), world), strict=True):
            if kept:
                yield _Said(text, how, order, target)


async def read_all(
    out: Path, reader: OrderReader, seeds: Sequence[int], first: int, groups: int
) -> None:
    """Read the orders of `groups` groups of every seed, from `first` on, and add them to `out`."""
    forbidden = generated_numbers(shipped_missions())
    for number in range(first, first + groups):
        for seed in seeds:
            recipe = Recipe(number, seed, MISSIONS)
            rng = random.Random(f"{seed}/{recipe.split}/{number}")
            world = random_world(rng, recipe.split, forbidden)
            situation = random_situation(rng, world, history=recipe.history)
            services = reader.services(situation)
            for said in _said(recipe, rng, situation):
                case = situation.case("order", said.text, ())
                if words_findings(world, case, reader.rulebook):
                    continue
                read = await reader.read(f"{seed}-{number}", situation, services, said)
                if read is not None:
                    with out.open("a", encoding="utf-8") as file:
                        file.write(read.model_dump_json() + "\n")


def main() -> None:
    """Add what was read to a file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="file of JSON lines; added to")
    parser.add_argument("--seed", type=int, action="append", help="seeds of the generator")
    parser.add_argument("--first", type=int, default=0, help="the first situation")
    parser.add_argument("--groups", type=int, default=45, help="situations of each seed")
    given = parser.parse_args()
    rulebook = load_rules(find_data("rules", "checkpoint", "rules.yaml"))

    async def run() -> None:
        engine = Engine(find_model(None, second_reader=""))
        try:
            reader = OrderReader(engine, rulebook)
            await read_all(given.out, reader, given.seed or SEEDS, given.first, given.groups)
        finally:
            await engine.close()

    asyncio.run(run())


if __name__ == "__main__":
    main()
