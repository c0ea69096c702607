"""Builds data sets in several processes: planner and judge samples of many groups, in order."""

import random
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from multiprocessing import get_context
from pathlib import Path

from pa_console.policy.retriever import Retriever
from pa_console.policy.rulebook import Rulebook, load_rules
from pa_console.training.judge_data import judge_samples
from pa_console.training.near_duplicates import NearDuplicates
from pa_console.training.outcome_data import outcome_samples
from pa_console.training.planner_data import Group, Recipe, make_group, planner_samples
from pa_console.training.samples import Sample
from pa_console.training.worlds import Numbers, generated_numbers, shipped_missions


@dataclass
class Made:
    """The samples of one group; `dropped` counts why missions or texts were not taken."""

    samples: list[Sample] = field(default_factory=list[Sample])
    dropped: Counter[str] = field(default_factory=Counter[str])


@dataclass(frozen=True)
class Wish:
    """What a data set is made of: `groups` situations with `missions` each, from `seed`."""

    groups: int
    missions: int = 8
    seed: int = 1
    first: int = 0
    judge: bool = True
    planner: bool = True


def build(
    wish: Wish, rules: Path, processes: int, on_group: Callable[[int, Made], None]
) -> None:
    """Make the groups of `wish` and give each to `on_group`, in order, as it is ready.

    Every process loads the rule file `rules`; raises DocumentError when it is broken.
    """
    load_rules(rules)
    forbidden = generated_numbers(shipped_missions())
    recipes = [
        Recipe(number, wish.seed, wish.missions)
        for number in range(wish.first, wish.first + wish.groups)
    ]
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        jobs = ((recipe, rules, forbidden, wish) for recipe in recipes)
        for number, made in enumerate(pool.map(_make, jobs, chunksize=1)):
            on_group(number, made)


def _make(job: tuple[Recipe, Path, frozenset[Numbers], Wish]) -> Made:
    recipe, rules, forbidden, wish = job
    rulebook, retriever = _policy(rules)
    group = make_group(recipe, rulebook, forbidden)
    made = Made(dropped=group.dropped)
    _drop_known(group, made)
    made.samples += _samples(group, wish, rulebook, retriever, recipe)
    return made


def _drop_known(group: Group, made: Made) -> None:
    """Leave out every mission that is too like one of a test set."""
    kept = _filter().keep([proven.case.command for proven in group.proven])
    made.dropped["near duplicate"] += kept.count(False)
    group.proven[:] = [p for p, keep in zip(group.proven, kept, strict=True) if keep]


def _samples(
    group: Group, wish: Wish, rulebook: Rulebook, retriever: Retriever, recipe: Recipe
) -> Iterator[Sample]:
    rng = random.Random(f"judge/{recipe.seed}/{recipe.number}")
    if wish.planner:
        yield from planner_samples(group, rulebook, retriever)
    if wish.judge:
        yield from judge_samples(group, rulebook, retriever, rng)
        yield from outcome_samples(group, rulebook, retriever, rng)


@cache
def _policy(rules: Path) -> tuple[Rulebook, Retriever]:
    rulebook = load_rules(rules)
    return rulebook, Retriever(rulebook.rules)


@cache
def _filter() -> NearDuplicates:
    return NearDuplicates(shipped_missions())
