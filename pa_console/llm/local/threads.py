"""The number of threads for the model: one for each core that no other program uses.

llama.cpp's threads share the work of every operation and then wait for each other, one to two
thousand times per plan. If another process uses the core of one thread, the scheduler suspends this
thread for milliseconds, and all other threads wait. Therefore, on two cores of which one is busy,
two threads are slower than one thread. The model's answers do not depend on the number of threads
(see `runtime`).
"""

import os
import re
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter, process_time

TOPOLOGY = Path("/sys/devices/system/cpu")
STATISTICS = Path("/proc/stat")
FEW_TOKENS = 16
FEW_CORES = 4
"""The largest number of cores of which all are used for small batches."""

LOOK_S = 0.1
"""The time between two measurements of the cores' load, in seconds. The system counts the load in
hundredths of a second."""

PAUSE_S = 0.02
"""The pause between evaluations after which other programs may have used the cores, in seconds."""

NEARLY = 0.5
"""The largest share of a core that other programs may use while the core still counts as free. The
console itself is one of these programs.
"""

SHORT = 0.65
"""The share of an evaluation's time for which threads compute; below it, they count as suspended.
"""

BRIEF_S = 0.004
"""The shortest evaluation that shows whether threads were suspended, in seconds."""

PATIENCE_S = (LOOK_S, 2.0)
"""The first and the longest wait before more threads are tried again, in seconds.

The wait begins if threads are suspended although the system reports free cores. It doubles each
time.
"""

TELLING_S = 0.5
"""The evaluation time that is needed to decide whether the machine is busy, in seconds."""

BUSY_SHARE = 0.8
"""The share of evaluation time that is slowed by other programs; above it, answers count as slowed.
"""


def physical_cores() -> int:
    """Return the number of physical cores that this process may use.

    If it is unknown, the number of logical cores is returned.
    """
    if not hasattr(os, "sched_getaffinity"):
        return os.cpu_count() or 1
    allowed = os.sched_getaffinity(0)
    siblings: set[str] = set()
    for cpu in allowed:
        try:
            path = TOPOLOGY / f"cpu{cpu}" / "topology" / "thread_siblings_list"
            siblings.add(path.read_text(encoding="ascii").strip())
        except OSError:
            return len(allowed)
    return len(siblings)


def decoding_threads(cores: int) -> int:
    """Return how many of `cores` to use for one token at a time.

    A prompt is computed on every core. The speed of small batches is limited by memory, not by
    arithmetic. On a machine with many cores, half of the cores saturate the memory, so the other
    half is left to the console.
    """
    return max(min(cores, FEW_CORES), cores // 2)


def batch_threads(cores: int, tokens: int) -> int:
    """Return how many of `cores` to use for a batch of `tokens`."""
    return cores if tokens > FEW_TOKENS else decoding_threads(cores)


def idle_seconds() -> float | None:
    """Return the idle time of the cores that this process may use since the machine started.

    It is the sum over these cores, in seconds; None if the system does not report it.
    """
    try:
        lines = STATISTICS.read_text("ascii").splitlines()
        cores = [line.split() for line in lines if re.match(r"cpu\d", line)]
        allowed = {f"cpu{number}" for number in os.sched_getaffinity(0)}
        # Columns 4 and 5 are the idle time and the time spent waiting for a disk.
        ticks = sum(int(c[4]) + int(c[5]) for c in cores if c[0] in allowed)
        return ticks / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, IndexError, AttributeError):
        return None


class FreeCores:
    """The number of cores, up to `most`, that other programs leave to this process.

    The clocks return seconds: `now` is elapsed time, `computed` the processor time of this process,
    and `idle` the idle time of the cores, or None if it is unknown.
    """

    def __init__(
        self,
        most: int,
        *,
        fixed: bool = False,
        now: Callable[[], float] = perf_counter,
        computed: Callable[[], float] = process_time,
        idle: Callable[[], float | None] = idle_seconds,
    ) -> None:
        self.count = self._most = most
        """The number of cores in use; it is constant if `fixed`."""
        self._fixed = fixed
        self._now, self._computed, self._idle = now, computed, idle
        self._looked = self._look()
        self._ended = self._looked[0]
        self._patience_s, self._try_at = PATIENCE_S[0], 0.0
        self._busy_s = self._whole_s = 0.0
        self._was_busy = False

    @contextmanager
    def evaluating(self, tokens: int) -> Generator[int]:
        """Yield the number of threads with which the block evaluates `tokens`; record the speed."""
        now = self._now()
        paused = now - self._ended >= PAUSE_S
        if not self._fixed and (paused or now - self._looked[0] >= LOOK_S):
            self._follow(paused=paused)
        threads = min(self.count, batch_threads(self._most, tokens))
        began, computed = self._now(), self._computed()
        yield threads
        self._ended = self._now()
        seconds = self._ended - began
        if seconds > 0.0:
            self._note(threads, seconds, (self._computed() - computed) / (seconds * threads))

    def busy(self) -> bool:
        """Return whether other work slows evaluations; a new result needs TELLING_S of them."""
        if self._whole_s >= TELLING_S:
            self._was_busy = self._busy_s > BUSY_SHARE * self._whole_s
            self._busy_s = self._whole_s = 0.0
        return self._was_busy

    def _look(self) -> tuple[float, float, float | None]:
        return self._now(), self._computed(), self._idle()

    def _follow(self, *, paused: bool) -> None:
        """Use the cores that were idle, or used by this process, since the last measurement.

        Load from other programs during a pause does not reduce the number of cores, because the
        load may end with the pause.
        """
        (then, before, idle_then), self._looked = self._looked, self._look()
        now, computed, idle = self._looked
        if now - then < LOOK_S:
            return
        if idle is None or idle_then is None:
            if now >= self._try_at:
                self.count = min(self._most, 2 * self.count)
            return
        free = (max(0.0, idle - idle_then) + computed - before) / (now - then)
        free = max(1, min(self._most, int(free + NEARLY)))
        if (free < self.count and not paused) or (free > self.count and now >= self._try_at):
            self.count = free

    def _note(self, threads: int, seconds: float, share: float) -> None:
        """Record an evaluation; use fewer threads if they computed for a small `share` of it."""
        put_aside = share < SHORT and seconds >= BRIEF_S
        self._whole_s += seconds
        if put_aside or self.count < self._most:
            self._busy_s += seconds
        if self._fixed or threads == 1 or seconds < BRIEF_S:
            return
        now = self._now()
        if put_aside:
            self.count = max(1, threads // 2)
            self._patience_s = min(2 * self._patience_s, PATIENCE_S[1])
            self._try_at = now + self._patience_s
            self._looked = self._look()
        elif now >= self._try_at + self._patience_s:
            self._patience_s = PATIENCE_S[0]
