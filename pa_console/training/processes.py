"""Runs independent pieces of work in several processes and gives what they made in order."""

import signal
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
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
    with ProcessPoolExecutor(processes, context, initializer=_leave_interrupts) as pool:
        try:
            yield from pool.map(work, tasks)
        except BrokenProcessPool as error:
            raise OSError(
                f"one of {processes} processes was killed, perhaps for want of memory: "
                "the same command goes on, with fewer --jobs"
            ) from error
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _leave_interrupts() -> None:
    """Let Ctrl-C be the parent's alone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
