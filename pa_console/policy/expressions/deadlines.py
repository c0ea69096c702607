"""Time limits of expressions: one for each expression, and one for a group of them.

Time is the thread's processor time, not elapsed time, so that no rule counts as broken because the
machine is busy. Garbage collection is off while an expression runs, because in a long session it
takes longer than a check may.
"""

import gc
import threading
from collections.abc import Generator
from contextlib import contextmanager
from time import thread_time

DEADLINE_S = 0.010
"""The default time limit of one expression, in seconds; the settings can change it."""

USUAL_SIZE = 200
"""The number of assets, tracks and gates up to which the limit holds; for more of them, it grows in
proportion."""

ROUNDS_A_LOOK = 8
"""The number of rounds of a loop between two readings of the clock, because a reading takes longer
than a round."""


class DeadlineError(Exception):
    """An expression that took too long and decided nothing."""


class _Running(threading.local):
    """The expression that runs in this thread: its deadline, and whether it is overdue."""

    end_s: float | None = None
    group_end_s: float | None = None
    scale: float = 1.0
    overdue: bool = False
    rounds: int = 0


_running = _Running()


@contextmanager
def shared_deadline(seconds: float, size: int = 0) -> Generator[None]:
    """Limit all expressions that this thread evaluates in the block to `seconds` in total.

    `size` is the approximate number of assets, tracks and gates in the variables. Above USUAL_SIZE,
    all limits grow in proportion. An enclosing block with a larger size sets the scale.
    """
    outer = _running.group_end_s, _running.scale
    _running.scale = max(1.0, size / USUAL_SIZE, outer[1])
    end_s = thread_time() + seconds * _running.scale
    _running.group_end_s = end_s if outer[0] is None else min(end_s, outer[0])
    try:
        yield
    finally:
        _running.group_end_s, _running.scale = outer


@contextmanager
def deadline(seconds: float) -> Generator[None]:
    """Limit the expression in the block to `seconds`; raises DeadlineError if it took longer.

    The error is raised even if the expression itself ignored its deadline.
    """
    now = thread_time()
    seconds *= _running.scale
    group_end_s = _running.group_end_s
    if group_end_s is not None and now >= group_end_s:
        raise DeadlineError("no time is left: earlier checks took too long")
    end_s = now + seconds
    _running.end_s = end_s if group_end_s is None else min(end_s, group_end_s)
    _running.overdue, _running.rounds = False, 0
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()
        late = _running.overdue
        _running.end_s, _running.overdue = None, False
        if late:
            allowed = f"{seconds * 1000:g} ms"
            raise DeadlineError(f"it took longer than the {allowed} that a check may take")


def going_on() -> bool:
    """Return whether there is time for another round of a loop."""
    if _running.overdue:
        return False
    _running.rounds += 1
    if _running.rounds % ROUNDS_A_LOOK == 0:
        left_s()
    return not _running.overdue


def left_s() -> float | None:
    """Return the seconds that the running expression has left; None without a limit."""
    if _running.end_s is None:
        return None
    left = _running.end_s - thread_time()
    if left <= 0.0:
        _running.overdue = True
    return max(left, 0.0)


@contextmanager
def unmeasured() -> Generator[None]:
    """Exclude the time of the block from the limits of the running expression and its group.

    This is for work that is done once for all expressions, such as compiling a pattern.
    """
    began = thread_time()
    try:
        yield
    finally:
        taken = thread_time() - began
        if _running.end_s is not None:
            _running.end_s += taken
        if _running.group_end_s is not None:
            _running.group_end_s += taken


def give_up() -> None:
    """Mark the running expression as overdue, even if it still returns a value."""
    _running.overdue = True
