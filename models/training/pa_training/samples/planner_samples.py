"""Planner samples: a random situation, missions in words, and plans that were proven right."""

import random
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from pa_console.llm.roles.prompts import Prompt, compact_planner_prompt, picture_prefix
from pa_console.policy.retriever import Retriever
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.command import Verb
from pa_console.schema.evaluation import MissionCase
from pa_console.schema.plan import Plan
from pa_training.order_generator.console_missions import console_missions
from pa_training.order_generator.orders import Order
from pa_training.order_generator.sampler import sample_order
from pa_training.phrasing.phrasing import phrase
from pa_training.proof.playing import mission_of
from pa_training.proof.verify import Verified, verify
from pa_training.samples.as_said import with_names_as_said
from pa_training.samples.sample import Sample, make_sample
from pa_training.situations.situations import Situation, random_situation
from pa_training.situations.worlds import Numbers, Split, random_world
from pa_training.teacher.teacher import Target, teach

TOP_K = 3
TRIES = 3
"""Missions that are drawn for each one wanted, at most: some cannot be proven."""
MOST_ALTERNATIVES = 3
LEAVING_BARE = frozenset(("WF-02", "WF-03", "CAP-08"))
"""Rules for which an order is given up when every plan for it breaks one of them."""


class Recipe(NamedTuple):
    """What a group is made from; equal recipes give equal groups."""

    number: int
    seed: int
    missions: int
    split: Split = "train"
    wordings: int = 1
    """Ways in which each mission is worded for the planner."""
    history: bool = True
    """Whether something may have been ordered before; a case of a mission set has no history."""


@dataclass(frozen=True)
class Proven:
    """A mission with a plan that is right for it."""

    order: Order
    case: MissionCase
    target: Target
    plan: Plan
    kind: str
    verified: Verified


@dataclass
class Group:
    """Everything that was made in one situation; `dropped` counts why missions were not taken."""

    name: str
    situation: Situation
    proven: list[Proven] = field(default_factory=list[Proven])
    dropped: Counter[str] = field(default_factory=Counter[str])


def make_group(recipe: Recipe, rulebook: Rulebook, forbidden: frozenset[Numbers]) -> Group:
    """Draw a world, a situation and missions in it; keep those whose plan was proven right.

    Worlds of the generator with `forbidden` numbers are not drawn.
    """
    rng = random.Random(f"{recipe.seed}/{recipe.split}/{recipe.number}")
    world = random_world(rng, recipe.split, forbidden)
    situation = random_situation(rng, world, history=recipe.history)
    group = Group(f"{recipe.split}{recipe.seed}-{recipe.number}", situation)
    for text, order, kind, verbs in _missions(rng, recipe, situation):
        if len(group.proven) == recipe.missions:
            break
        proven = prove(
            f"{group.name}-{len(group.proven)}", text, order, kind, situation, rulebook, verbs
        )
        if isinstance(proven, Proven):
            group.proven.append(proven)
        else:
            group.dropped[proven] += 1
    return group


def _missions(
    rng: random.Random, recipe: Recipe, situation: Situation
) -> Iterator[tuple[str, Order, str, tuple[Verb, ...]]]:
    """Yield missions in words: one that the console itself would give, then operators' own."""
    world, picture, digest = situation.world, situation.picture, situation.digest
    own = console_missions(world, picture)
    if own:
        text, order, verbs = rng.choice(own)
        yield text, order, "console", verbs
    for _ in range(TRIES * recipe.missions):
        order, kind = sample_order(rng, world, picture, digest)
        words = phrase(order, world, picture, rng, recipe.split)
        yield words.text, order, f"{kind}/{words.style}", ()


def prove(  # noqa: PLR0917
    name: str,
    text: str,
    order: Order,
    kind: str,
    situation: Situation,
    rulebook: Rulebook,
    verbs: Sequence[Verb] = (),
) -> Proven | str:
    """Return the mission with the first of the teacher's plans that is right, or why none is."""
    category, why = kind.partition("/")[0], ""
    target: Target | None
    try:
        target = teach(order, situation.world, situation.picture, situation.digest, verbs)
    except ValueError as error:
        return f"{category}: {error}"
    while target is not None:
        case = situation.case(name, text, target.success, target.expect, category, target.watch_s)
        failed: set[str] = set()
        for plan in (target.plan, *target.alternatives[:MOST_ALTERNATIVES]):
            verified = verify(case, situation, plan, rulebook, follow=target.follow)
            if verified.right:
                return Proven(order, case, target, plan, kind, verified)
            first = verified.reasons[0]
            failed.add(first.rule_id)
            why = why or f"{category}: {first.stage} {first.rule_id}".strip()
        target = target.otherwise if failed <= LEAVING_BARE else None
    return why


def planner_samples(
    group: Group, missions: Iterable[Proven], rulebook: Rulebook, retriever: Retriever
) -> Iterator[Sample]:
    """Yield a sample for each of the proven `missions` of `group`."""
    situation = group.situation
    picture = picture_prefix("planner", situation.world, situation.digest).user
    for proven in missions:
        prompt = planner_prompt_of(proven.case, situation, rulebook, retriever)
        answer = proven.plan.answer
        sample = make_sample(group.name, "planner", prompt, picture, answer, proven.kind)
        yield with_names_as_said(sample, proven.order)


def planner_prompt_of(
    case: MissionCase, situation: Situation, rulebook: Rulebook, retriever: Retriever
) -> Prompt:
    """Return the prompt that the console would give for `case` in `situation`."""
    hits = retriever.retrieve(case.command, TOP_K)
    rules = [rulebook.get(hit.rule_id) for hit in hits]
    return compact_planner_prompt(situation.world, situation.digest, rules, mission_of(case))
