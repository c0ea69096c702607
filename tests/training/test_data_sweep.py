"""A data set that Dask's workers make is the one that a single process makes, byte by byte."""

import asyncio
import os
import signal
from collections.abc import Sequence
from pathlib import Path

import pytest
from pa_training.samples.data_sweep import (
    GroupMaker,
    RemoteGroup,
    build_on_dask,
    make_groups,
)
from pa_training.samples.planner_samples import Recipe

from pa_console.evaluation.dask_sweep import SweepError, Workers, cluster
from pa_console.resources import find_data
from pa_training.samples.data_report import fingerprint
from pa_training.samples.data_set import (
    FILES,
    JOURNAL,
    DataFolder,
    Job,
    Made,
    Part,
    build,
)

RULES = find_data("rules", "checkpoint", "rules.yaml")
PARTS: tuple[Part, ...] = ("planner", "judge")
RECIPES = [Recipe(number, seed=5, missions=1) for number in (3, 4, 7, 8)]


def contents(path: Path) -> dict[str, bytes]:
    return {name: (path / name).read_bytes() for name in (*FILES, JOURNAL)}


def missing(data: DataFolder) -> list[Job]:
    jobs = (Job(recipe, data.missing(recipe, PARTS)) for recipe in RECIPES)
    return [job for job in jobs if job.parts]


@pytest.fixture(scope="module")
def one_process(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """What one process has made."""
    path = tmp_path_factory.mktemp("single")
    data = DataFolder(path, "g")
    build(missing(data), RULES, 1, lambda job, made: data.add(job.recipe, job.parts, made))
    return contents(path)


def test_two_workers_one_of_them_killed_make_the_same_files(
    tmp_path: Path, one_process: dict[str, bytes]
) -> None:
    data = DataFolder(tmp_path, "g")
    killed: list[int] = []

    async def make() -> None:
        async with cluster(Workers(count=2)) as target:

            def kill_once(_made: Made) -> None:
                if not killed:
                    killed.append(target.workers[0].pid)
                    os.kill(killed[0], signal.SIGKILL)

            def keep(job: Job, made: Made) -> None:
                data.add(job.recipe, job.parts, made)

            await make_groups(target, missing(data), RULES, keep, on_made=kill_once)

    asyncio.run(make())
    assert killed
    assert contents(tmp_path) == one_process


def test_what_is_there_is_not_made_again(tmp_path: Path, one_process: dict[str, bytes]) -> None:
    for name, content in one_process.items():
        (tmp_path / name).write_bytes(content)
    data, made = DataFolder(tmp_path, "g"), list[Sequence[object]]()
    nowhere = Workers(scheduler="tcp://127.0.0.1:1")
    build_on_dask(
        missing(data), RULES, nowhere, lambda job, _: made.append(job), on_made=id, told=print
    )
    assert made == []


def test_a_worker_with_other_code_makes_nothing(tmp_path: Path) -> None:
    maker = GroupMaker(RULES.read_text(encoding="utf-8"))
    maker.setup(None)
    try:
        task = RemoteGroup(0, Job(RECIPES[0], PARTS), "another version")
        with pytest.raises(SweepError, match="one version everywhere"):
            maker.make(task)
    finally:
        maker.teardown(None)


def test_a_group_has_one_key_and_other_code_another() -> None:
    job = Job(RECIPES[0], PARTS)
    one = RemoteGroup(0, job, fingerprint(RULES))
    assert one.key == RemoteGroup(0, job, fingerprint(RULES)).key
    assert one.key != RemoteGroup(0, job, "other code").key
    assert one.key != RemoteGroup(0, Job(job.recipe, ("planner",)), one.generator).key
