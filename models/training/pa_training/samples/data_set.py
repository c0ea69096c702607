"""Makes data sets in several processes, and keeps them on disk group by group."""

import os
import random
import signal
import threading
from collections import Counter
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from functools import cache
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait
from pathlib import Path
from typing import NamedTuple, TypeVar

from pa_console.policy.retriever import Retriever
from pa_console.policy.rulebook import Rulebook, load_rules
from pa_console.schema.base import StrictModel
from pa_training.results.lineage import read_json
from pa_training.samples.groups import Recipe, make_group, planner_samples
from pa_training.samples.judge_samples import judge_samples
from pa_training.samples.outcome_samples import outcome_samples
from pa_training.samples.readings import written_readings
from pa_training.samples.sample import Sample
from pa_training.situations.worlds import Numbers, generated_numbers, shipped_missions

GROUPS = "groups"
"""The folder of a data set that holds a file for each group."""
FILES = ("planner.jsonl", "judge.jsonl", "valid-planner.jsonl", "valid-judge.jsonl")
"""The samples that training reads, put together from the groups."""
ANOTHER_FOLDER = "name another folder, or remove this one"

Task = TypeVar("Task")
Result = TypeVar("Result")


class Made(StrictModel):
    """The samples of one group; `dropped` counts why orders and plans were not taken."""

    name: str
    valid: bool
    generator: str
    samples: tuple[Sample, ...]
    dropped: dict[str, int]


class _Work(NamedTuple):
    recipe: Recipe
    rules: Path
    forbidden: frozenset[Numbers]
    generator: str


def build(
    recipes: Sequence[Recipe], rules: Path, generator: str, processes: int
) -> Generator[Made, None, None]:
    """Yield the groups of `recipes`, in order, as they are ready.

    Every process loads the rule file `rules`; one process is this one. When the iterator is closed,
    groups that were not begun are not made. Raises DocumentError when a file is broken and OSError
    when a process was killed.
    """
    load_rules(rules)
    forbidden = generated_numbers(shipped_missions())
    tasks = [_Work(recipe, rules, forbidden, generator) for recipe in recipes]
    with closing(each_in_order(_made, tasks, processes)) as groups:
        yield from groups


def _made(work: _Work) -> Made:
    """Return a group, made in this process: readings of all orders, plans and verdicts of some."""
    recipe = work.recipe
    rulebook, retriever = _policy(work.rules)
    group = make_group(recipe, rulebook, work.forbidden)
    rng = random.Random(f"judge/{recipe.name}")
    samples = list[Sample]()
    if recipe.round == 0:
        samples += written_readings(recipe.name, recipe.written, group.situation)
    samples += planner_samples(group, rulebook, retriever)
    samples += judge_samples(group, rulebook, retriever, rng)
    samples += outcome_samples(group, rulebook, rng)
    valid = recipe.source == "development"
    return Made(
        name=recipe.name,
        valid=valid,
        generator=work.generator,
        samples=tuple(samples),
        dropped=+Counter(group.dropped),
    )


@cache
def _policy(rules: Path) -> tuple[Rulebook, Retriever]:
    rulebook = load_rules(rules)
    return rulebook, Retriever(rulebook.rules)


def each_in_order(
    work: Callable[[Task], Result], tasks: Sequence[Task], processes: int
) -> Generator[Result, None, None]:
    """Yield what `work` makes of each task, in order; one process is this one.

    When the iterator is closed, tasks that were not begun are not done. Raises OSError when a
    process was killed.
    """
    if processes == 1:
        yield from map(work, tasks)
        return
    context = get_context("spawn")
    with ProcessPoolExecutor(processes, context, initializer=_prepare) as pool:
        try:
            yield from pool.map(work, tasks)
        except BrokenProcessPool as error:
            raise OSError(
                f"one of {processes} processes was killed, perhaps for want of memory: "
                "the same command goes on, with fewer --jobs"
            ) from error
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _prepare() -> None:
    """Leave Ctrl-C to the parent, and end when it does, however suddenly."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


class DataFolder:
    """A data set on disk: one file a group, which appears when it is whole."""

    def __init__(self, path: Path) -> None:
        """Open the folder at `path`, made when it is missing.

        Raises OSError, and ValueError for a folder that holds samples but no groups.
        """
        self.path, self._groups = path, path / GROUPS
        if not self._groups.is_dir() and (strange := [n for n in FILES if (path / n).exists()]):
            raise ValueError(f"{path / strange[0]}: has no groups beside it: {ANOTHER_FOLDER}")
        self._groups.mkdir(parents=True, exist_ok=True)

    def __contains__(self, recipe: Recipe) -> bool:
        """Return whether the group of `recipe` is there already."""
        return self._file(recipe.name).exists()

    def add(self, made: Made) -> None:
        """Write a group."""
        file = self._file(made.name)
        partial = file.with_suffix(".partial")
        partial.write_text(made.model_dump_json(), encoding="utf-8")
        partial.replace(file)

    def groups(self) -> Generator[Made, None, None]:
        """Yield all groups by name; raises ValueError that names a file which holds none."""
        for file in sorted(self._groups.glob("*.json")):
            yield read_json(file, Made, ANOTHER_FOLDER)

    def put_together(self) -> None:
        """Write the samples of all groups to the files that training reads."""
        texts: dict[str, list[str]] = {name: [] for name in FILES}
        for made in self.groups():
            for sample in made.samples:
                part = "planner" if sample.task == "planner" else "judge"
                name = f"valid-{part}.jsonl" if made.valid else f"{part}.jsonl"
                texts[name].append(f"{sample.model_dump_json()}\n")
        for name, lines in texts.items():
            (self.path / name).write_text("".join(lines), encoding="utf-8")

    def _file(self, name: str) -> Path:
        return self._groups / f"{name}.json"
