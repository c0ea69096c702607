"""Planner samples that are only to be read: what is asked is known, no plan is carried out.

Proving a plan costs a hundred times as much as wording an order, and what a planner gets wrong is
what was meant. The teacher's first plan says which fact comes after the reading, and no more of it
is learnt.
"""

import gzip
import random
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import closing
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import NamedTuple

from pa_console.llm.roles.prompts import compact_planner_prompt, picture_prefix
from pa_console.policy.retriever import Retriever
from pa_console.policy.rulebook import Rulebook, load_rules
from pa_console.schema.mission import MAX_MISSION_TEXT, Mission
from pa_console.schema.rule import Rule
from pa_training.order_generator.console_missions import console_missions
from pa_training.order_generator.orders import Order, canonical_meaning
from pa_training.order_generator.sampler import sample_order, with_exclusion
from pa_training.phrasing.no_orders import NOTHING_ASKED, NoOrders
from pa_training.phrasing.phrasing import phrase
from pa_training.phrasing.rewording import COMBINED, CONSOLE, SPOKEN, spoken_words
from pa_training.samples.as_said import with_names_as_said
from pa_training.samples.data_set import each_in_order
from pa_training.samples.near_duplicates import NearDuplicates
from pa_training.samples.planner_samples import TOP_K, Recipe
from pa_training.samples.sample import Sample, make_sample
from pa_training.samples.selection import judge_readings, reading_of
from pa_training.situations.situations import Situation, random_situation
from pa_training.situations.worlds import (
    Numbers,
    generated_numbers,
    random_world,
    shipped_missions,
)
from pa_training.teacher.teacher import teach

WITH_RULES = 0.35
"""Share of the samples whose prompt quotes the rules that were retrieved, as serving does."""
FOR_JUDGE = 0.25
"""Share of the samples that the judge reads as well."""
TRIES = 3
"""Orders that are drawn for each one wanted where words were written for proven missions."""


NO_TIME = datetime(2026, 1, 1, tzinfo=UTC)


class Policy(NamedTuple):
    """The rules that prompts quote, and how they are found."""

    rulebook: Rulebook
    retriever: Retriever


def write_readings(
    file: Path, recipes: Sequence[Recipe], rules: Path, processes: int
) -> Generator[int, None, None]:
    """Write the samples of `recipes` to `file`, gzipped JSON lines; yield how many a group has.

    The file appears when it is whole. Raises DocumentError for a broken rule file, and OSError.
    """
    load_rules(rules)
    forbidden = generated_numbers(shipped_missions())
    tasks = [(recipe, rules, forbidden) for recipe in recipes]
    partial = file.with_name(f"{file.name}.partial")
    with (
        gzip.open(partial, "wt", encoding="utf-8", compresslevel=4) as stream,
        closing(each_in_order(_lines, tasks, processes)) as groups,
    ):
        for lines in groups:
            stream.writelines(lines)
            yield len(lines)
    partial.replace(file)


def _lines(task: tuple[Recipe, Path, frozenset[Numbers]]) -> list[str]:
    recipe, rules, forbidden = task
    samples = reading_samples(recipe, _policy(rules), forbidden, _no_orders())
    return [f"{sample.model_dump_json()}\n" for sample in samples]


@cache
def _policy(rules: Path) -> Policy:
    rulebook = load_rules(rules)
    return Policy(rulebook, Retriever(rulebook.rules))


@cache
def _no_orders() -> NoOrders:
    return NoOrders.shipped()


def reading_samples(
    recipe: Recipe,
    policy: Policy,
    forbidden: frozenset[Numbers],
    no_orders: NoOrders | None = None,
) -> Iterator[Sample]:
    """Yield the samples of one situation: `recipe.missions` orders in `recipe.wordings` wordings.

    Orders that ask for several things get twice as many. With `no_orders` some texts that ask for
    nothing join them. Equal recipes give equal samples; texts too like a test mission are dropped.
    """
    rng = random.Random(f"{recipe.seed}/{recipe.split}/{recipe.number}")
    world = random_world(rng, recipe.split, forbidden)
    situation = random_situation(rng, world, history=recipe.history)
    words = random.Random(f"readings/{recipe.seed}/{recipe.split}/{recipe.number}")
    writer = _Writer(recipe, situation, policy, words)
    spoken = spoken_words(recipe)
    for text, order, kind in _orders(rng, recipe, situation, bool(spoken)):
        yield from writer.worded(text, order, kind, spoken)
    if no_orders is not None:
        yield from writer.asking_nothing(no_orders, max(1, recipe.missions // 3))


def _orders(
    rng: random.Random, recipe: Recipe, situation: Situation, spoken: bool
) -> Iterator[tuple[str, Order, str]]:
    """Yield orders as `planner_data.make_group` draws them, with words and kind."""
    world, picture, digest = situation.world, situation.picture, situation.digest
    own = console_missions(world, picture)
    if own:
        text, order, _ = rng.choice(own)
        yield text, order, CONSOLE
    for _ in range(recipe.missions * (TRIES if spoken else 1)):
        order, kind = sample_order(rng, world, picture, digest)
        if not spoken:  # what people say was written for orders as they are drawn
            order = with_exclusion(rng, order, world, picture, digest)
        worded = phrase(order, world, picture, rng, recipe.split)
        yield worded.text, order, f"{kind}/{worded.style}"


class _Writer:
    """Makes samples of the orders in one situation."""

    def __init__(
        self, recipe: Recipe, situation: Situation, policy: Policy, rng: random.Random
    ) -> None:
        self._recipe, self._situation, self._policy, self._rng = recipe, situation, policy, rng
        self._group = f"readings-{recipe.split}{recipe.seed}-{recipe.number}"
        self._picture = picture_prefix("planner", situation.world, situation.digest).user

    def worded(
        self, text: str, order: Order, kind: str, spoken: Mapping[str, Sequence[str]]
    ) -> Iterator[Sample]:
        """Yield `order` as `text` and in other words; nothing where the teacher has no plan."""
        situation, recipe = self._situation, self._recipe
        world, picture, digest = situation.world, situation.picture, situation.digest
        try:
            answer = teach(order, world, picture, digest).plan.answer
        except ValueError:
            return
        texts = {text: kind}
        if kind != CONSOLE:
            first = kind.rpartition("/")[0]
            if not order.injected:
                said = spoken.get(canonical_meaning(order, world), ())
                texts |= dict.fromkeys(said, f"{first}/{SPOKEN}")
            more = (recipe.wordings - 1) * (2 if kind.startswith(COMBINED) else 1)
            for _ in range(more):
                other = phrase(order, world, picture, self._rng, recipe.split)
                texts.setdefault(other.text, f"{first}/{other.style}")
        fresh = _known().keep(list(texts), world)
        for (words, how), kept in zip(texts.items(), fresh, strict=True):
            if kept:
                sample = with_names_as_said(self._sample(words, answer, how), order)
                yield from self._with_judge(reading_of(sample))

    def asking_nothing(self, no_orders: NoOrders, count: int) -> Iterator[Sample]:
        """Yield `count` texts that are no orders."""
        for _ in range(count):
            text, kind = no_orders.draw(self._rng, self._situation.world)
            answer = f'{{"reason": "asked: {NOTHING_ASKED}", "actions": []}}'
            sample = self._sample(text, answer, f"nothing/{kind}")
            yield from self._with_judge(sample)

    def _sample(self, text: str, answer: str, kind: str) -> Sample:
        situation, rules = self._situation, list[Rule]()
        if self._rng.random() < WITH_RULES:
            hits = self._policy.retriever.retrieve(text, TOP_K)
            rules = [self._policy.rulebook.get(hit.rule_id) for hit in hits]
        mission = Mission(id="M", text=text[:MAX_MISSION_TEXT], created=NO_TIME)
        prompt = compact_planner_prompt(situation.world, situation.digest, rules, mission)
        return make_sample(self._group, "planner", prompt, self._picture, answer, kind)

    def _with_judge(self, sample: Sample) -> Iterator[Sample]:
        yield sample
        if self._rng.random() < FOR_JUDGE:
            yield from judge_readings([sample])


@cache
def _known() -> NearDuplicates:
    return NearDuplicates(shipped_missions())
