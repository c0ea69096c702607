"""Runs independent pieces of work in several processes and gives what they made in order."""

import os
import signal
import threading
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait
from typing import TypeVar

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
