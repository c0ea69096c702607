"""Makes the groups of a data set on Dask's workers; imported where that is asked for.

The rules are sent as text, the phrases and the code are those of the worker's machine: where these
are others, it makes nothing.
"""

import asyncio
import hashlib
import json
import socket
from collections.abc import Callable, Sequence
from contextlib import aclosing
from dataclasses import dataclass
from pathlib import Path

from pa_console.evaluation.dask_sweep import DaskSweep, SweepError, TaskMaker, Workers, cluster
from pa_console.policy.rulebook import load_rules
from pa_console.schema.document import read_text
from pa_training.samples.data_report import fingerprint
from pa_training.samples.data_set import Job, Made, made_in
from pa_training.situations.worlds import Numbers, generated_numbers, shipped_missions


@dataclass(frozen=True)
class RemoteGroup:
    """The group at `place` among those to be made; `generator` is what has to make it."""

    place: int
    job: Job
    generator: str

    @property
    def key(self) -> str:
        """What it goes by on the scheduler."""
        recipe = self.job.recipe
        parts = json.dumps([*recipe, *self.job.parts, self.generator])
        mark = hashlib.sha256(parts.encode()).hexdigest()[:16]
        return f"group-{recipe.seed}-{recipe.number}-{self.place}-{mark}"


@dataclass(frozen=True)
class MadeGroup:
    """What a group is, and its place among those to be made."""

    place: int
    made: Made


class GroupMaker(TaskMaker[RemoteGroup, MadeGroup]):
    """Makes groups on a worker, under `rules`, the text of a rule file."""

    name = "pa-console groups"

    def __init__(self, rules: str) -> None:
        self._rules = rules

    def begin(self) -> None:
        """Write the rules to a file, and see what makes groups here."""
        self._file = self.folder / "rules.yaml"
        self._file.write_text(self._rules, encoding="utf-8")
        self._generator = ""
        self._forbidden = frozenset[Numbers]()

    def make(self, task: RemoteGroup) -> MadeGroup:
        """Return the group; raises SweepError where it would be another one."""
        with self.turn:
            if not self._generator:
                self._forbidden = generated_numbers(shipped_missions())
                self._generator = fingerprint(self._file)
            if self._generator != task.generator:
                raise SweepError(
                    f"{socket.gethostname()} has another version of the code or of the phrases: "
                    "use one version everywhere"
                )
            return MadeGroup(task.place, made_in((task.job, self._file, self._forbidden)))


class _Groups:
    """Groups as they come back, kept in the order of `jobs`."""

    def __init__(self, jobs: Sequence[Job], keep: Callable[[Job, Made], None]) -> None:
        self._jobs, self._keep = jobs, keep
        self._waiting: dict[int, Made] = {}
        self._next = 0

    @property
    def missing(self) -> list[int]:
        """The places of those that have not come back."""
        return [n for n in range(self._next, len(self._jobs)) if n not in self._waiting]

    def add(self, back: MadeGroup) -> None:
        """Keep every group that has all before it."""
        self._waiting[back.place] = back.made
        while self._next in self._waiting:
            self._keep(self._jobs[self._next], self._waiting.pop(self._next))
            self._next += 1


def build_on_dask(
    jobs: Sequence[Job],
    rules: Path,
    workers: Workers,
    keep: Callable[[Job, Made], None],
    *,
    on_made: Callable[[Made], object],
    told: Callable[[str], None],
) -> None:
    """Make the groups of `jobs` and give each to `keep` in order, to `on_made` as it comes back.

    Raises DocumentError for a broken rule file, and SweepError when there is no scheduler, or a
    group ends every worker that makes it.
    """
    load_rules(rules)

    async def run() -> None:
        async with cluster(workers) as target:
            await make_groups(target, jobs, rules, keep, on_made=on_made, told=told)

    if jobs:
        asyncio.run(run())


async def make_groups(
    target: object,
    jobs: Sequence[Job],
    rules: Path,
    keep: Callable[[Job, Made], None],
    *,
    on_made: Callable[[Made], object],
    told: Callable[[str], None] = lambda _text: None,
) -> None:
    """Do the same with the workers of `target`, an address or a cluster of Dask."""
    generator, groups = fingerprint(rules), _Groups(jobs, keep)

    def missing() -> list[RemoteGroup]:
        return [RemoteGroup(place, jobs[place], generator) for place in groups.missing]

    sweep = DaskSweep(GroupMaker(read_text(rules)), missing, told=told)
    async with aclosing(sweep.run_on(target)) as results:
        async for back in results:
            on_made(back.made)
            groups.add(back)
