"""One worker process as the event loop sees it: spawned, spoken to, noticed when it ends."""

import asyncio
import os
import signal
from collections.abc import Callable
from contextlib import suppress
from time import perf_counter
from typing import Literal

from pa_console.child_processes import OWN_FOLDER, python_command
from pa_console.llm.worker.confinement import clean_environment
from pa_console.llm.worker.messages import (
    Done,
    FromWorker,
    Load,
    LoadFailed,
    Piece,
    Ready,
    Refused,
    encode,
)
from pa_console.schema.base import StrictModel

COMMAND = ("-m", "pa_console.llm.worker.worker")
ENVIRONMENT = {"GOMP_SPINCOUNT": "1000"}
"""Threads of llama.cpp that wait for each other look so often before they give their core away.

On an idle machine 1,000 is as fast as 10,000; a tenth of it makes a plan half as long again. Beside
a busy process two threads that look longer waste the time of the one that they wait for.
"""

LINE_LIMIT = 1 << 20
WAITING_LIMIT = 8 << 20
"""The largest number of unread bytes from a worker: ten times its longest answers."""

EXIT_S = 2.0

Answer = Piece | Done | Refused
Signal = Literal["stop", "late", "ended"]


class Worker:
    """A running worker; `ready` resolves to whether its model was loaded, `error` says why not.

    An empty `error` of a worker that has `ended` means that it died.
    """

    def __init__(
        self,
        child: asyncio.subprocess.Process,
        on_ready: Callable[[int, str], None],
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
        cls, load: Load, on_ready: Callable[[int, str], None], on_end: Callable[[str], None]
    ) -> "Worker":
        """Start a worker that loads a model.

        It has no terminal, so Ctrl-C does not reach it, and of the environment only what it needs.
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
        """Write a message; a worker that is gone gets none."""
        stream = self._child.stdin
        if stream is not None and not self.ended and not stream.is_closing():
            stream.write(encode(message))

    async def receive(self, limit: float) -> Answer | Signal:
        """Return the next answer or signal, "late" when none came until perf_counter() `limit`."""
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
        """Keep a message of `size` bytes until `receive` takes it."""
        self._waiting += size
        self._answers.put_nowait((answer, size))

    async def kill(self) -> None:
        """End the process now and wait until it is gone."""
        self.strike()
        await self._listener

    async def close(self) -> None:
        """Let the process end by closing its input; kill it when it does not."""
        if self._child.stdin is not None:
            self._child.stdin.close()
        try:
            async with asyncio.timeout(EXIT_S):
                await asyncio.shield(self._listener)
        except TimeoutError:
            await self.kill()

    def strike(self) -> None:
        """Kill the process without waiting for its end.

        Signal the process itself: Popen.kill could reap it, which is the event loop's part.
        """
        if self._child.returncode is None:
            with suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)

    async def _reap(self) -> None:
        """Wait for a process that sends no more; kill it if it lingers."""
        try:
            async with asyncio.timeout(EXIT_S):
                await self._child.wait()
        except TimeoutError:
            self.strike()
            await self._child.wait()

    async def _listen(self) -> None:
        """Sort the worker's messages until they end or make no sense, then reap it.

        A line that is too long, or a second Ready, makes no sense.
        """
        stream = self._child.stdout
        try:
            while stream is not None and (line := await stream.readline()):
                match FromWorker.validate_json(line):
                    case Ready(n_ctx=n_ctx, description=description) if not self.ready.done():
                        self._on_ready(n_ctx, description)
                        self.ready.set_result(True)
                    case LoadFailed(error=error):
                        self.error = error
                    case Ready():
                        raise ValueError("the worker says twice that it is ready")
                    case answer:
                        self._put(answer, len(line))
                if self._waiting > WAITING_LIMIT:
                    raise ValueError("the worker says more than it was asked for")
        except ValueError:
            self.strike()
        finally:
            self.ended = True
            await self._reap()
            if not self.ready.done():
                self.ready.set_result(False)
            self._put("ended")
            self._on_end(self.error)
