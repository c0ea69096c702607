"""The parent side of one worker process: JSON lines to and from an asyncio subprocess.

The event loop is never blocked.
"""

import asyncio
import os
import signal
from collections.abc import Callable
from contextlib import suppress
from time import perf_counter
from typing import Literal

from pa_console.child_processes import OWN_FOLDER, python_command
from pa_console.llm.local.confinement import clean_environment
from pa_console.llm.local.messages import (
    Done,
    FromWorker,
    GenerationFailure,
    Load,
    LoadFailed,
    Ready,
    TextPiece,
    encode,
)
from pa_console.schema.base import StrictModel

COMMAND = ("-m", "pa_console.llm.local.worker")
ENVIRONMENT = {
    # The number of checks that a waiting thread of llama.cpp makes before it gives up its core. On
    # an idle machine, 1,000 is as fast as 10,000; with 100, a plan takes half as long again. If
    # another process is busy, a thread that checks longer takes computing time from the thread
    # that it waits for.
    "GOMP_SPINCOUNT": "1000",
    # Without this, the C library raises its threshold when the first large buffer is freed. It then
    # keeps later buffers in its heap, and cannot return a buffer to the system while others lie
    # behind it: 35 MB after a context has grown. Rows of logits are smaller than this value, so
    # that a row does not need a system call.
    "MALLOC_MMAP_THRESHOLD_": str(4 << 20),
    "MALLOC_TRIM_THRESHOLD_": str(8 << 20),
}
"""The worker's environment variables. Values from the console's own environment override them."""

LINE_LIMIT = 1 << 20
WAITING_LIMIT = 8 << 20
"""The limit on unread bytes from a worker, which is ten times the longest answers."""

EXIT_S = 2.0

Answer = TextPiece | Done | GenerationFailure
Signal = Literal["stop", "late", "ended"]


class Worker:
    """A running worker.

    `ready` has the result True once the model is loaded, and False if the worker ended before. If
    the worker has `ended`, `error` has the reason; an empty `error` means that it died.
    """

    def __init__(
        self,
        child: asyncio.subprocess.Process,
        on_ready: Callable[[Ready], None],
        on_end: Callable[[str], None],
    ) -> None:
        self.pid = child.pid
        self.ended = False
        self.error = ""
        self.ready: asyncio.Future[bool] = asyncio.get_running_loop().create_future()
        self._child, self._on_ready, self._on_end = child, on_ready, on_end
        self._answers: asyncio.Queue[tuple[Answer | Signal, int]] = asyncio.Queue()
        self._waiting = 0
        self._listener = asyncio.create_task(self._listen(), name="llm worker")

    @classmethod
    async def spawn(
        cls, load: Load, on_ready: Callable[[Ready], None], on_end: Callable[[str], None]
    ) -> "Worker":
        """Start a worker that loads a model.

        The worker has no terminal, so Ctrl-C does not reach it. It gets only the environment
        variables that it needs.
        """
        child = await asyncio.create_subprocess_exec(
            *python_command(*COMMAND),
            cwd=OWN_FOLDER,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.DEVNULL,
            start_new_session=True,
            env={**ENVIRONMENT, **clean_environment(os.environ)},
            limit=LINE_LIMIT,
        )
        worker = cls(child, on_ready, on_end)
        worker.send(load)
        return worker

    def send(self, message: StrictModel) -> None:
        """Send a message, unless the worker has ended."""
        stream = self._child.stdin
        if stream is not None and not self.ended and not stream.is_closing():
            stream.write(encode(message))

    async def receive(self, limit: float) -> Answer | Signal:
        """Return the next answer or signal, or "late" if none arrives by `limit`.

        `limit` is a time of perf_counter().
        """
        try:
            async with asyncio.timeout(max(0.0, limit - perf_counter())):
                answer, size = await self._answers.get()
        except TimeoutError:
            return "late"
        self._waiting -= size
        return answer

    def interrupt(self) -> None:
        """Make `receive` return "stop"."""
        self._put("stop")

    def _put(self, answer: Answer | Signal, size: int = 0) -> None:
        """Queue a message of `size` bytes for `receive`."""
        self._waiting += size
        self._answers.put_nowait((answer, size))

    async def kill(self) -> None:
        """Kill the process and wait until it has ended."""
        self.strike()
        await self._listener

    async def close(self) -> None:
        """Close the input of the process, so that it ends; kill it if it does not end."""
        if self._child.stdin is not None:
            self._child.stdin.close()
        try:
            async with asyncio.timeout(EXIT_S):
                await asyncio.shield(self._listener)
        except TimeoutError:
            await self.kill()

    def strike(self) -> None:
        """Kill the process without waiting for its end.

        The signal is sent directly, because Popen.kill could reap the process before the event loop
        does.
        """
        if self._child.returncode is None:
            with suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)

    async def _reap(self) -> None:
        """Wait until a process that has closed its output ends; kill it if this takes too long."""
        try:
            async with asyncio.timeout(EXIT_S):
                await self._child.wait()
        except TimeoutError:
            self.strike()
            await self._child.wait()

    async def _listen(self) -> None:
        """Distribute the worker's messages until they end or one is invalid, then reap the process.

        A line that is too long is invalid, and so are a second Ready and too many unread messages.
        """
        stream = self._child.stdout
        try:
            while stream is not None and (line := await stream.readline()):
                match FromWorker.validate_json(line):
                    case Ready() as loaded if not self.ready.done():
                        self._on_ready(loaded)
                        self.ready.set_result(True)
                    case LoadFailed(error=error):
                        self.error = error
                    case Ready():
                        raise ValueError("the worker reported twice that it is ready")
                    case answer:
                        self._put(answer, len(line))
                if self._waiting > WAITING_LIMIT:
                    raise ValueError("the worker sent more messages than are read")
        except ValueError:
            self.strike()
        finally:
            self.ended = True
            await self._reap()
            if not self.ready.done():
                self.ready.set_result(False)
            self._put("ended")
            self._on_end(self.error)
