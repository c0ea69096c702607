"""How long an event loop is held up at most: how late a beat comes that is due every 2 ms."""

import asyncio
import gc
import selectors
import sys
import threading
from contextlib import suppress
from math import ceil
from time import perf_counter, thread_time
from types import FrameType
from typing import Self

from pa_console.schema.base import StrictModel

BEAT_S = 0.002
LOOK_S = 0.005
"""How often it is looked what holds the loop up."""

LATE_S = 0.03
"""A beat as late as this is looked into."""

PACKAGE = "pa_console"


class LoopBlocks(StrictModel):
    """How late the beats came in a scene, in seconds.

    `during` is where the longest block was. `computing_s` is the longest time that the loop's own
    thread computed between two beats: what else there is of a block is the machine's, which was
    busy with other work.
    """

    scene: str
    seconds: float
    beats: int
    late_99_s: float
    longest_s: float
    computing_s: float
    during: str


class LoopWatch:
    """Beats in the running loop while it is entered; a thread looks at what holds it up."""

    def __init__(self, scene: str) -> None:
        self._scene = scene
        self._late_s: list[float] = []
        self._longest_s, self._during, self._seen = 0.0, "", ""
        self._computing_s = 0.0
        self._due_s = 0.0
        self._over = threading.Event()
        self._collecting_since_s: float | None = None

    async def __aenter__(self) -> Self:
        self._began_s = perf_counter()
        self._loop_thread = threading.get_ident()
        self._due_s = perf_counter() + BEAT_S
        self._beating = asyncio.create_task(self._beat())
        self._looking = threading.Thread(target=self._look, daemon=True)
        self._looking.start()
        gc.callbacks.append(self._collects)
        await asyncio.sleep(0)
        return self

    async def __aexit__(self, *_: object) -> None:
        """Stop; a block that is just over counts."""
        await asyncio.sleep(2 * BEAT_S)
        self._seconds = perf_counter() - self._began_s
        self._over.set()
        gc.callbacks.remove(self._collects)
        self._beating.cancel()
        with suppress(asyncio.CancelledError):
            await self._beating
        self._looking.join()

    @property
    def blocks(self) -> LoopBlocks:
        """What was found, once this is left."""
        late = sorted(self._late_s)
        return LoopBlocks(
            scene=self._scene,
            seconds=self._seconds,
            beats=len(late),
            late_99_s=late[ceil(0.99 * len(late)) - 1] if late else 0.0,
            longest_s=self._longest_s,
            computing_s=self._computing_s,
            during=self._during,
        )

    async def _beat(self) -> None:
        while True:
            self._due_s, self._seen = perf_counter() + BEAT_S, ""
            computed_s = thread_time()
            await asyncio.sleep(BEAT_S)
            self._computing_s = max(self._computing_s, thread_time() - computed_s)
            late_s = max(perf_counter() - self._due_s, 0.0)
            self._late_s.append(late_s)
            if late_s > self._longest_s:
                self._longest_s, self._during = late_s, self._seen

    def _collects(self, phase: str, _info: dict[str, int]) -> None:
        """Note a collection of garbage that takes long: it is nobody's code."""
        if phase == "start":
            self._collecting_since_s = perf_counter()
        elif self._collecting_since_s is not None:
            taken_s = perf_counter() - self._collecting_since_s
            if taken_s > LATE_S:
                self._seen = f"garbage collection, {1000 * taken_s:.0f} ms"

    def _look(self) -> None:
        while not self._over.wait(LOOK_S):
            if perf_counter() - self._due_s > LATE_S and not self._seen.startswith("garbage"):
                frames = sys._current_frames()  # pyright: ignore[reportPrivateUsage] - documented
                self._seen = _place(frames.get(self._loop_thread)) or self._seen


def _place(frame: FrameType | None) -> str:
    """Return the innermost function on the stack, and the innermost of this package.

    A thread that waits for events is held up by nobody but the machine.
    """
    if frame is not None and frame.f_globals.get("__name__") == selectors.__name__:
        return "other work on the machine"
    found: list[str] = []
    while frame is not None:
        name = str(frame.f_globals.get("__name__", ""))
        own = name.startswith(f"{PACKAGE}.")
        if not found or own:
            found.append(f"{name.removeprefix(f'{PACKAGE}.')}.{frame.f_code.co_name}")
        if own:
            break
        frame = frame.f_back
    return " < ".join(found)
