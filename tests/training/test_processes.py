"""Work in several processes: in order, stopped, and when a process is killed."""

import os
import signal
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import pytest

from pa_training.samples.data_set import each_in_order


class Note(NamedTuple):
    """A task that leaves a file with its number in `folder`."""

    folder: Path
    number: int


def note(task: Note) -> int:
    """Leave a file that says that this task was done."""
    (task.folder / str(task.number)).touch()
    return task.number


def die(task: Note) -> int:
    """End the process as the system ends one that takes too much memory."""
    os.kill(os.getpid(), signal.SIGKILL)
    return task.number


@pytest.mark.parametrize("processes", [1, 2])
def test_results_come_in_order(processes: int, tmp_path: Path) -> None:
    tasks = [Note(tmp_path, number) for number in range(5)]
    assert list(each_in_order(note, tasks, processes)) == [0, 1, 2, 3, 4]


def test_what_was_not_begun_is_not_done_after_the_end(tmp_path: Path) -> None:
    tasks = [Note(tmp_path, number) for number in range(5)]
    with closing(each_in_order(note, tasks, 1)) as results:
        next(results)
    assert [path.name for path in tmp_path.iterdir()] == ["0"]


def test_a_killed_process_is_said_with_a_remedy(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="fewer --jobs"):
        list(each_in_order(die, [Note(tmp_path, 0)], 2))
