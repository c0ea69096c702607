"""Time limits of expressions: each has a deadline, and a group may have one together.

Time is the thread's computing time, not elapsed time: a busy machine breaks no rule. Garbage is not
collected meanwhile: in a long session that takes longer than a check may.
"""

import gc
import threading
from collections.abc import Generator
from contextlib import contextmanager
from time import thread_time

DEADLINE_S = 0.010
"""The time limit of one expression, seconds, unless the settings have another."""

USUAL_SIZE = 200
"""Assets, tracks and gates up to which that holds; with more of them it is more in proportion."""

ROUNDS_A_LOOK = 8
"""Rounds of a loop between two looks at the clock, which take longer than the round."""


class DeadlineError(Exception):
    """An expression took too long; nothing was decided by it."""


class _Running(threading.local):
    """The expression that runs in this thread: its deadline, and whether that was reported."""

    end_s: float | None = None
    group_end_s: float | None = None
    scale: float = 1.0
    overdue: bool = False
    rounds: int = 0


_running = _Running()


@contextmanager
def shared_deadline(seconds: float, size: int = 0) -> Generator[None]:
    """Let all expressions that this thread evaluates in the block take `seconds` together.

    They are about `size` assets, tracks and gates; above USUAL_SIZE all times are longer. So they
    are within another such block about more of them.
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
    """Let the expression in the block take `seconds`; raises DeadlineError when it took longer.

    It is raised even if the expression itself ignored the end of its time.
    """
    now = thread_time()
    seconds *= _running.scale
    group_end_s = _running.group_end_s
    if group_end_s is not None and now >= group_end_s:
        raise DeadlineError("no time is left: the checks before it took too long")
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
    """Return how many seconds the running expression has left, None where nothing limits it."""
    if _running.end_s is None:
        return None
    left = _running.end_s - thread_time()
    if left <= 0.0:
        _running.overdue = True
    return max(left, 0.0)


@contextmanager
def unmeasured() -> Generator[None]:
    """Give the running expression, and its group, the time back that the block takes.

    For work that is done once for all expressions, such as the compiling of a pattern.
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
    """Note that the running expression used up its time, whatever it still comes to."""
    _running.overdue = True
