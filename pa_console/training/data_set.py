"""Makes data sets in several processes: planner and judge samples of many groups, in order."""

import random
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Literal, NamedTuple

from pa_console.policy.retriever import Retriever
from pa_console.policy.rulebook import Rulebook, load_rules
from pa_console.training.judge_data import judge_samples
from pa_console.training.near_duplicates import NearDuplicates, NearReport
from pa_console.training.outcome_data import outcome_samples
from pa_console.training.planner_data import Group, Recipe, make_group, planner_samples
from pa_console.training.processes import each_in_order
from pa_console.training.rewording import Rewording
from pa_console.training.samples import Sample
from pa_console.training.spoken import spoken_words
from pa_console.training.worlds import Numbers, generated_numbers, shipped_missions

Part = Literal["planner", "judge"]
"""What an adapter learns from; the judge's part holds verdicts on plans and on outcomes."""


class Job(NamedTuple):
    """One group that is to be made, and the parts that are wanted of it."""

    recipe: Recipe
    parts: tuple[Part, ...]


@dataclass
class Made:
    """The samples of one group; `dropped` counts why missions or texts were not taken.

    `near` says how near its missions came to those of the test sets.
    """

    near: NearReport
    samples: list[Sample] = field(default_factory=list[Sample])
    dropped: Counter[str] = field(default_factory=Counter[str])


def build(
    jobs: Sequence[Job], rules: Path, processes: int, on_group: Callable[[Job, Made], None]
) -> None:
    """Make the groups of `jobs` and give each to `on_group`, in order, as it is ready.

    Every process loads the rule file `rules`; one process is this one. Whatever ends it sooner,
    groups that were not begun are not made. Raises DocumentError when the rule file is broken and
    OSError when a process was killed.
    """
    load_rules(rules)
    forbidden = generated_numbers(shipped_missions())
    tasks = [(job, rules, forbidden) for job in jobs]
    with closing(each_in_order(_make, tasks, processes)) as groups:
        for job, made in zip(jobs, groups, strict=True):
            on_group(job, made)


def _make(task: tuple[Job, Path, frozenset[Numbers]]) -> Made:
    job, rules, forbidden = task
    rulebook, retriever = _policy(rules)
    recipe, known = job.recipe, _filter()
    before = known.report()
    group = make_group(recipe, rulebook, forbidden)
    drop_known(group)
    made = Made(before)
    if "planner" in job.parts:
        rng, spoken = _rng("words", recipe), spoken_words(recipe)
        words = Rewording(group.situation, rulebook, known, rng, recipe.split, spoken)
        missions = words.all(group.proven, recipe.wordings)
        made.samples += planner_samples(group, missions, rulebook, retriever)
        made.dropped += group.dropped
    if "judge" in job.parts:
        rng, split, dropped = _rng("judge", recipe), recipe.split, made.dropped
        words = Rewording(group.situation, rulebook, known, _rng("judge-words", recipe), split)
        made.samples += judge_samples(
            group, rulebook, retriever, rng, split, dropped, words.reworded
        )
        made.samples += outcome_samples(group, rulebook, rng, dropped)
    made.near = seen_since(before, known.report())
    return made


def _rng(purpose: str, recipe: Recipe) -> random.Random:
    return random.Random(f"{purpose}/{recipe.seed}/{recipe.number}")


def drop_known(group: Group) -> NearReport:
    """Leave out every mission that is too like one of a test set, and say how near all came."""
    known = _filter()
    before = known.report()
    commands = [proven.case.command for proven in group.proven]
    kept = known.keep(commands, group.situation.world)
    group.dropped["near duplicate"] += kept.count(False)
    group.proven[:] = [p for p, keep in zip(group.proven, kept, strict=True) if keep]
    return seen_since(before, known.report())


def seen_since(before: NearReport, after: NearReport) -> NearReport:
    """Return what was seen between two reports; `nearest` has only what has come nearer."""
    return after.model_copy(
        update={
            "checked": after.checked - before.checked,
            "dropped": after.dropped - before.dropped,
            "nearest": {
                name: score for name, score in after.nearest.items() if score > before.nearest[name]
            },
            "histogram": {
                name: count - before.histogram[name] for name, count in after.histogram.items()
            },
        }
    )


@cache
def _policy(rules: Path) -> tuple[Rulebook, Retriever]:
    rulebook = load_rules(rules)
    return rulebook, Retriever(rulebook.rules)


@cache
def _filter() -> NearDuplicates:
    return NearDuplicates(shipped_missions())
