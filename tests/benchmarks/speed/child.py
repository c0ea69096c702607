"""A process of the benchmark's own that holds a model: one JSON line in, one JSON line out.

The benchmark's process never loads a model library. The child ignores Ctrl-C, as its parent
decides, and ends at once when its parent closes it or is gone, whatever it is doing.
"""

import asyncio
import os
import signal
import sys
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from queue import SimpleQueue
from typing import IO, Self, TypeVar

from pydantic import ValidationError

from pa_console.llm.backend import ChatFormat, EngineError
from pa_console.llm.local.worker_process import LINE_LIMIT
from pa_console.schema.base import StrictModel

ROOT = Path(__file__).resolve().parents[3]
Reply = TypeVar("Reply", bound=StrictModel)


class LoadWeights(StrictModel):
    """First line to a child.

    `adapter` is the path of the one that answers are written with, empty for none.
    """

    path: str
    adapter: str = ""
    chat: ChatFormat
    n_ctx: int


class Loaded(StrictModel):
    """The weights are loaded."""

    n_ctx: int


class Failed(StrictModel):
    """What was asked for could not be done."""

    error: str


class Child:
    """A running child; every method but `kill` is for one task at a time."""

    def __init__(self, process: asyncio.subprocess.Process, module: str) -> None:
        self._process, self._module = process, module

    @classmethod
    async def start(
        cls, module: str, load: LoadWeights, environment: Mapping[str, str] | None = None
    ) -> Self:
        """Run `module` in a child and load its weights; raises EngineError when it cannot.

        `environment` is added to that of this process.
        """
        child = cls(
            await asyncio.create_subprocess_exec(
                sys.executable,
                "-P",
                "-m",
                module,
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.DEVNULL,
                start_new_session=True,
                env={**(environment or {}), **os.environ, "PYTHONPATH": _search_path()},
                limit=LINE_LIMIT,
            ),
            module,
        )
        try:
            await child.ask(load, Loaded)
        except BaseException:
            await child.close()
            raise
        return child

    @property
    def pid(self) -> int:
        """The process id."""
        return self._process.pid

    async def ask(self, request: StrictModel, reply: type[Reply]) -> Reply:
        """Return the answer to `request`; raises EngineError when there is none."""
        source, sink = self._process.stdout, self._process.stdin
        line = b""
        if source is not None and sink is not None and not sink.is_closing():
            sink.write(request.model_dump_json().encode() + b"\n")
            line = await source.readline()
        if not line:
            raise EngineError(f"the benchmark's process {self._module} ended unexpectedly")
        try:
            return reply.model_validate_json(line)
        except ValidationError:
            failed = Failed.model_validate_json(line)
        raise EngineError(f"{self._module}: {failed.error}")

    async def close(self) -> None:
        """End the process and wait until it is gone; its memory is free then."""
        if self._process.returncode is None:
            self._process.kill()
        await self._process.wait()


def _search_path() -> str:
    """Return where the child finds this package, which is installed nowhere."""
    return os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))


def serve(load: Callable[[LoadWeights], tuple[int, Callable[[bytes], StrictModel]]]) -> None:
    """Be the child: `load` gives the context's size and what answers each line after the first.

    What it raises goes to the parent in words; stdin and stdout are kept for messages only.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    incoming, outgoing = os.dup(0), os.dup(1)
    nothing = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):
        os.dup2(nothing, descriptor)
    lines: SimpleQueue[bytes] = SimpleQueue()
    source = os.fdopen(incoming, "rb")
    threading.Thread(target=_listen, args=(source, lines), daemon=True).start()

    def send(message: StrictModel) -> None:
        os.write(outgoing, message.model_dump_json().encode() + b"\n")

    try:
        n_ctx, answer = load(LoadWeights.model_validate_json(lines.get()))
        send(Loaded(n_ctx=n_ctx))
        while True:
            send(answer(lines.get()))
    except Exception as error:  # whatever it is, the parent has to know
        send(Failed(error=str(error) or type(error).__name__))


def _listen(source: IO[bytes], lines: "SimpleQueue[bytes]") -> None:
    for line in source:
        lines.put(line)
    os._exit(0)
