"""Groups of samples: a situation, the orders given there, and plans that were proven right."""

import random
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from pa_console.language.canonical.clauses import NOTHING
from pa_console.language.name_linking import link_names
from pa_console.llm.roles.compact_prompts import (
    compact_planner_prompt,
    picture_prefix,
)
from pa_console.policy.retriever import Retriever
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.evaluation import MissionCase
from pa_console.schema.plan import Plan
from pa_console.schema.world import World
from pa_training.orders.meaning import Order, corrected, meaning_now, names_asset, order_of
from pa_training.orders.near_duplicates import shipped_duplicates
from pa_training.orders.written import (
    Source,
    WrittenOrder,
    WrittenSituation,
    drawn_situation,
    read_writer,
    writer_names,
)
from pa_training.proof.playing import mission_of
from pa_training.proof.verify import Verified, verify
from pa_training.samples.sample import Sample, make_sample
from pa_training.situations.situations import Situation, random_situation
from pa_training.situations.worlds import Numbers
from pa_training.teacher.teacher import Target, teach

TOP_K = 3
MOST_ALTERNATIVES = 3
LEAVING_BARE = frozenset(("WF-02", "WF-03", "CAP-08"))
"""Rules for which an order is given up when every plan for it breaks one of them."""


class Recipe(NamedTuple):
    """The situation and the number of plans of a group; equal recipes give equal groups."""

    source: Source
    writer: str
    place: int
    """The place of the situation in the writer's file."""
    round: int = 0
    """0: the situation that the writer saw; others: another one at the same site."""
    plans: int = 0
    """The most orders for which a plan is proven."""

    @property
    def name(self) -> str:
        """The name of the group."""
        return f"{self.source}-{self.writer}-{self.place}-{self.round}"

    @property
    def written(self) -> WrittenSituation:
        """What was written for the situation; raises DocumentError for a broken file."""
        return read_writer(self.source, self.writer).situations[self.place]


def recipes(source: Source, rounds: int = 1, plans: int = 0) -> Iterator[Recipe]:
    """Yield the groups of all writers of `source`, round by round; raises DocumentError."""
    for number in range(rounds):
        for writer in writer_names(source):
            for place in range(len(read_writer(source, writer).situations)):
                yield Recipe(source, writer, place, number, plans)


@dataclass(frozen=True)
class Proven:
    """A mission with a plan that is right for it."""

    order: Order
    case: MissionCase
    target: Target
    plan: Plan
    verified: Verified

    @property
    def kind(self) -> str:
        """The task that is asked for first, for tables."""
        return self.case.category


@dataclass
class Group:
    """Everything that was made in one situation; `dropped` counts why orders were not taken."""

    name: str
    situation: Situation
    proven: list[Proven] = field(default_factory=list[Proven])
    dropped: Counter[str] = field(default_factory=Counter[str])


def make_group(recipe: Recipe, rulebook: Rulebook, forbidden: frozenset[Numbers]) -> Group:
    """Return the orders of a situation whose plan was proven right, `recipe.plans` at most.

    Orders too like a mission of a test set are dropped. In another situation than the one that the
    writer saw only those are taken that name all their assets: of the others, the meaning may have
    been looked up in the picture.
    """
    situation = situation_of(recipe, forbidden)
    group = Group(recipe.name, situation)
    orders = list(recipe.written.first_orders)
    random.Random(recipe.name).shuffle(orders)
    for number, written in enumerate(orders):
        if len(group.proven) == recipe.plans:
            break
        meaning = meaning_now(corrected(written.meaning))
        if not meaning or meaning == NOTHING:
            continue
        if recipe.round and not _names_its_assets(written, situation.world):
            continue
        if not shipped_duplicates().keep([written.text], situation.world)[0]:
            group.dropped["near duplicate"] += 1
            continue
        proven = prove(f"{group.name}-{number}", written.text, meaning, situation, rulebook)
        if isinstance(proven, Proven):
            group.proven.append(proven)
        else:
            group.dropped[proven] += 1
    return group


def situation_of(recipe: Recipe, forbidden: frozenset[Numbers]) -> Situation:
    """Return the situation of a group; no world of the generator with `forbidden` numbers."""
    seen = drawn_situation(recipe.written, forbidden)
    if recipe.round == 0:
        return seen
    rng = random.Random(f"{recipe.name}/situation")
    return random_situation(rng, seen.world, like=seen.sim)


def _names_its_assets(written: WrittenOrder, world: World) -> bool:
    """Return whether the words of an order name every asset that its meaning names."""
    linked = link_names(world, written.text)
    named = (name for name in world.assets if names_asset(written.meaning, name))
    return all(names_asset(linked, name) for name in named)


def prove(
    name: str, text: str, meaning: str, situation: Situation, rulebook: Rulebook
) -> Proven | str:
    """Return the mission with the first of the teacher's plans that is right, or why none is."""
    try:
        order = order_of(meaning, situation.world, situation.digest)
        target: Target | None = teach(order, situation.world, situation.picture, situation.digest)
    except (ValueError, LookupError):
        return "no plan for its meaning"
    category = order.reading.asks[0].task if order.reading.asks else "nothing due"
    why = ""
    while target is not None:
        case = situation.case(name, text, target.success, target.expect, category, target.watch_s)
        failed: set[str] = set()
        for plan in (target.plan, *target.alternatives[:MOST_ALTERNATIVES]):
            verified = verify(case, situation, plan, rulebook, follow=target.follow)
            if verified.right:
                return Proven(order, case, target, plan, verified)
            first = verified.reasons[0]
            failed.add(first.rule_id)
            why = why or f"{category}: {first.stage} {first.rule_id}".strip()
        target = target.otherwise if failed <= LEAVING_BARE else None
    return why


def planner_samples(group: Group, rulebook: Rulebook, retriever: Retriever) -> Iterator[Sample]:
    """Yield a sample of a whole plan for each proven mission of `group`."""
    world, digest = group.situation.world, group.situation.digest
    picture = picture_prefix("planner", world, digest).user
    for proven in group.proven:
        hits = retriever.retrieve(proven.case.command, TOP_K)
        rules = [rulebook.get(hit.rule_id) for hit in hits]
        prompt = compact_planner_prompt(world, digest, rules, mission_of(proven.case))
        answer = proven.plan.answer
        yield make_sample(group.name, "planner", prompt, picture, answer, proven.kind)
