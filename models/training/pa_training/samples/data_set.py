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
from dataclasses import dataclass, field
from functools import cache
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait
from pathlib import Path
from typing import Literal, NamedTuple, TypeVar

from pydantic import ValidationError

from pa_console.policy.retriever import Retriever
from pa_console.policy.rulebook import Rulebook, load_rules
from pa_console.schema.base import StrictModel
from pa_training.phrasing.rewording import Rewording, spoken_words
from pa_training.samples.judge_samples import judge_samples
from pa_training.samples.near_duplicates import NearDuplicates, NearReport
from pa_training.samples.outcome_samples import outcome_samples
from pa_training.samples.planner_samples import Group, Recipe, make_group, planner_samples
from pa_training.samples.sample import Sample
from pa_training.situations.worlds import Numbers, generated_numbers, shipped_missions

Task = TypeVar("Task")
Result = TypeVar("Result")


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


Part = Literal["planner", "judge"]
"""What an adapter learns from; the judge's part holds verdicts on plans and on outcomes."""


class Job(NamedTuple):
    """One group that is to be made, and the parts that are wanted of it."""

    recipe: Recipe
    parts: tuple[Part, ...]


@dataclass
class Made:
    """The samples of one group; `dropped` counts why missions or texts were not taken.

    `near` says how near its missions came to those of the test sets, whatever was made before.
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
    with closing(each_in_order(made_in, tasks, processes)) as groups:
        for job, made in zip(jobs, groups, strict=True):
            on_group(job, made)


def made_in(task: tuple[Job, Path, frozenset[Numbers]]) -> Made:
    """Return the group of a job, made in this process under a rule file.

    Worlds of the generator with those numbers are not drawn.
    """
    job, rules, forbidden = task
    rulebook, retriever = _policy(rules)
    recipe, known = job.recipe, _filter()
    known.forget()
    group = make_group(recipe, rulebook, forbidden)
    drop_known(group)
    made = Made(known.report())
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
    made.near = known.report()
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


JOURNAL, REPORT = "groups.jsonl", "report.json"
FILES = ("planner.jsonl", "judge.jsonl", "valid-planner.jsonl", "valid-judge.jsonl")
VALID_EVERY, VALID_REST = 50, 7


class Entry(StrictModel):
    """One group that is on disk as a whole, and how long each file was when it was."""

    seed: int
    number: int
    parts: tuple[Part, ...]
    generator: str
    counts: dict[str, int]
    dropped: dict[str, int]
    near: NearReport
    sizes: dict[str, int]

    @property
    def valid(self) -> bool:
        """Whether the group is for validation."""
        return for_validation(self.number)


class DataFolder:
    """Adds groups to the files of a folder; what a sudden end has torn is cut off."""

    def __init__(self, path: Path, generator: str) -> None:
        """Open the folder at `path`, made when it is missing; `generator` says what makes groups.

        Raises OSError, and ValueError for a journal that is none.
        """
        path.mkdir(parents=True, exist_ok=True)
        self.path, self._generator = path, generator
        self.entries = _fitting(path, read_journal(path))
        self._nearest: dict[str, float] = {}
        for entry in self.entries:
            for name, score in entry.near.nearest.items():
                self._nearest[name] = max(score, self._nearest.get(name, 0.0))
        self.mend()

    @property
    def generators(self) -> set[str]:
        """Every version of the generator that has made groups."""
        return {entry.generator for entry in self.entries}

    def missing(self, recipe: Recipe, parts: tuple[Part, ...]) -> tuple[Part, ...]:
        """Return those of `parts` that the group of `recipe` does not have yet."""
        there = self._there(recipe)
        return tuple(part for part in parts if part not in there)

    def add(self, recipe: Recipe, parts: tuple[Part, ...], made: Made) -> None:
        """Write a group, and then that it is whole; both are on the disk before this returns."""
        texts: dict[str, list[str]] = {name: [] for name in FILES}
        for sample in made.samples:
            texts[_file_of(sample, recipe)].append(sample.model_dump_json() + "\n")
        sizes = {name: _append(self.path / name, "".join(texts[name])) for name in FILES}
        entry = Entry(
            seed=recipe.seed,
            number=recipe.number,
            parts=parts,
            generator=self._generator,
            counts=Counter(f"{sample.task} {sample.kind}" for sample in made.samples),
            dropped=+made.dropped,
            near=self._nearer(made.near),
            sizes=sizes,
        )
        _append(self.path / JOURNAL, entry.model_dump_json() + "\n")
        self.entries.append(entry)

    def mend(self) -> None:
        """Cut off everything that the journal does not know to be whole."""
        text = "".join(entry.model_dump_json() + "\n" for entry in self.entries)
        _shorten(self.path / JOURNAL, len(text.encode()))
        for name in FILES:
            _shorten(self.path / name, self.entries[-1].sizes[name] if self.entries else 0)

    def _nearer(self, near: NearReport) -> NearReport:
        """Return how near a group came, of the missions only those to which it came nearest."""
        most = self._nearest
        news = {name: s for name, s in near.nearest.items() if s > most.get(name, 0.0)}
        most.update(news)
        return near.model_copy(update={"nearest": news})

    def _there(self, recipe: Recipe) -> set[Part]:
        return {
            part
            for entry in self.entries
            if (entry.seed, entry.number) == (recipe.seed, recipe.number)
            for part in entry.parts
        }


def for_validation(number: int) -> bool:
    """Return whether the group of this number is held out from training, as a whole: 2 % are."""
    return number % VALID_EVERY == VALID_REST


def read_journal(path: Path) -> list[Entry]:
    """Return every whole entry of the folder `path`, oldest first; [] where nothing is yet.

    Raises OSError, and ValueError with the line for one that is no entry, or without a journal
    beside samples.
    """
    file = path / JOURNAL
    if not file.exists():
        found = [name for name in FILES if _size(path / name)]
        if found:
            raise ValueError(f"{path / found[0]}: has no {JOURNAL} beside it; name another folder")
        return []
    entries: list[Entry] = []
    for number, line in enumerate(file.read_bytes().splitlines(keepends=True), start=1):
        if not line.endswith(b"\n"):
            break
        try:
            entries.append(Entry.model_validate_json(line))
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            raise ValueError(
                f"{file}:{number}: {'.'.join(map(str, first['loc']))}: {first['msg']}; "
                "name another folder, or remove this one"
            ) from error
    return entries


def _fitting(path: Path, entries: list[Entry]) -> list[Entry]:
    """Leave out the entries at the end whose samples a power cut has taken."""
    there = {name: _size(path / name) for name in FILES}
    while entries and any(entries[-1].sizes[name] > there[name] for name in FILES):
        entries.pop()
    return entries


def _file_of(sample: Sample, recipe: Recipe) -> str:
    part = "planner" if sample.task == "planner" else "judge"
    return f"valid-{part}.jsonl" if for_validation(recipe.number) else f"{part}.jsonl"


def _append(path: Path, text: str) -> int:
    """Append `text`, on the disk before this returns, and return the file's size, bytes."""
    with path.open("ab") as stream:
        stream.write(text.encode())
        stream.flush()
        os.fsync(stream.fileno())
        return stream.tell()


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def _shorten(path: Path, size: int) -> None:
    if _size(path) > size:
        os.truncate(path, size)
