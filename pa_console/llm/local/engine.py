"""The parent side of the local LLM: an asyncio engine for one worker process.

The worker is an asyncio subprocess that exchanges JSON lines, so the event loop is never blocked.
"""

import asyncio
import os
import signal
from collections.abc import AsyncGenerator, Callable
from contextlib import aclosing, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import Literal

from pa_console.child_processes import OWN_FOLDER, python_command
from pa_console.llm.backend import (
    EngineDiedError,
    EngineError,
    Finish,
    GenerationEnd,
    ModelUnavailableError,
    PromptRefusedError,
    Request,
)
from pa_console.llm.local.confinement import clean_environment
from pa_console.llm.local.messages import (
    Cancel,
    Done,
    FromWorker,
    Generate,
    GenerationFailure,
    Load,
    LoadFailed,
    PinnedFile,
    Ready,
    TextPiece,
    encode,
)
from pa_console.llm.local.threads import physical_cores
from pa_console.llm.models.catalogue import LocalModel
from pa_console.schema.base import StrictModel
from pa_console.schema.events.event import Role, WorkerState
from pa_console.schema.finding import Usage

COMMAND = ("-m", "pa_console.llm.local.worker")
ENVIRONMENT = {
    # The number of checks that llama.cpp's waiting threads make before they give up their core. On
    # an idle machine, 1,000 is as fast as 10,000; with 100, a plan takes half as long again. If
    # another process is busy, two threads that check longer waste the time of the one they wait
    # for.
    "GOMP_SPINCOUNT": "1000",
    # Without this, the C library raises its threshold when the first large buffer is freed. It then
    # keeps later buffers in its heap and does not return those that others lie behind: 35 MB after
    # a context has grown. Rows of logits are smaller than this value, so they need no system call
    # each.
    "MALLOC_MMAP_THRESHOLD_": str(4 << 20),
    "MALLOC_TRIM_THRESHOLD_": str(8 << 20),
}
"""The worker's environment variables; values that the console was started with and passes on
override them."""

LINE_LIMIT = 1 << 20
WAITING_LIMIT = 8 << 20
"""The limit on unread bytes from a worker: ten times its longest answers."""

EXIT_S = 2.0

Answer = TextPiece | Done | GenerationFailure
Signal = Literal["stop", "late", "ended"]

SAMPLER = "greedy seed=0"
WARM_GRAMMAR = 'start: "{"'
LOAD_LIMIT_S = 300.0
SLOWED = "the machine is busy with other work, so answers take longer"
DIED = "the model's process died; it is started again when it is needed"
DIED_LOADING = (
    "the model's process died while it loaded {path}; if that happens again, the file is damaged "
    "or made to do harm: fetch it again, or choose another model"
)
GRACE_S = 1.0
"""Seconds for a worker to stop before it is killed."""

OnState = Callable[[WorkerState, str], None]


class Worker:
    """A running worker; `ready` yields True once its model is loaded, or `error` has the reason.

    A worker that has `ended` with an empty `error` has died.
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

        It has no terminal, so Ctrl-C does not reach it, and only the environment variables that it
        needs.
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
        """Return the next answer or signal, or "late" if none comes by perf_counter() `limit`."""
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
        """Close the input of the process, which ends it; kill it if it does not end."""
        if self._child.stdin is not None:
            self._child.stdin.close()
        try:
            async with asyncio.timeout(EXIT_S):
                await asyncio.shield(self._listener)
        except TimeoutError:
            await self.kill()

    def strike(self) -> None:
        """Kill the process without waiting for its end.

        The signal is sent directly, because Popen.kill could reap the process, which the event loop
        must do.
        """
        if self._child.returncode is None:
            with suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)

    async def _reap(self) -> None:
        """Wait for the end of a process that has closed its output; kill it if it lingers."""
        try:
            async with asyncio.timeout(EXIT_S):
                await self._child.wait()
        except TimeoutError:
            self.strike()
            await self._child.wait()

    async def _listen(self) -> None:
        """Distribute the worker's messages until they end or one is invalid, then reap it.

        A line that is too long, or a second Ready, is invalid.
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


@dataclass(frozen=True)
class ModelInfo:
    """The facts of a model for the session log; `n_ctx` is exact once the engine is ready.

    `adapters` has the SHA-256 of every adapter by file name.
    """

    name: str
    path: Path
    sha256: str
    n_ctx: int
    description: str
    adapters: dict[str, str] = field(default_factory=dict[str, str])


class Engine:
    """Answers prompts, one at a time; `on_state` is called for every change of state."""

    def __init__(
        self,
        model: LocalModel,
        on_state: OnState | None = None,
        *,
        n_ctx: int | None = None,
        threads: int | None = None,
        fixed: bool = False,
        require_sandbox: bool = False,
    ) -> None:
        """Use at most `threads` threads, by default one per core.

        The number is reduced while other programs use cores, unless it is `fixed`. With
        `require_sandbox`, no model is loaded by a process that is not confined.
        """
        self.model = model
        reader = model.second_reader
        self.second_reader = (
            Engine(reader, threads=threads, fixed=fixed, require_sandbox=require_sandbox)
            if reader
            else None
        )
        """The engine of the second reader; it is started when first needed. It reads ahead only
        while no caller waits for this engine."""
        n_ctx = n_ctx or model.n_ctx
        adapters = {adapter.path.name: adapter.sha256 for adapter in model.adapters}
        self.info = ModelInfo(
            model.name, model.path, model.sha256, n_ctx, model.description, adapters
        )
        self.sampler = SAMPLER
        self.state: WorkerState = "unavailable"
        self.detail = "not started"
        self.on_state = on_state
        self._load = Load(
            weights=PinnedFile(path=str(model.path.absolute()), sha256=model.sha256),
            chat=model.chat,
            n_ctx=n_ctx,
            threads=threads or physical_cores(),
            fixed=fixed,
            require_sandbox=require_sandbox,
            adapters={
                adapter.role: PinnedFile(path=str(adapter.path.absolute()), sha256=adapter.sha256)
                for adapter in model.adapters
            },
        )
        self._worker: Worker | None = None
        self._birth: asyncio.Future[Worker] | None = None
        self.busy = False
        """True while the worker is answering a prompt."""
        self._urgent = 0
        """The number of prompts with a waiting caller, both queued and being answered."""
        self._interruptible = False
        """True if an urgent prompt may interrupt the current one."""
        self._unreported = False
        self._turn, self._spawning = asyncio.Lock(), asyncio.Lock()
        self._stop = asyncio.Event()
        self._number = 0
        self._closed = self._slowed = False
        self._unconfined = ""

    @property
    def name(self) -> str:
        """The model's name."""
        return self.model.name

    @property
    def usable(self) -> bool:
        """False if the model could not be loaded."""
        return self.state != "unavailable"

    @property
    def pid(self) -> int | None:
        """The process id of the running worker, or None."""
        return None if self._worker is None or self._worker.ended else self._worker.pid

    async def start(self) -> None:
        """Start loading the model and return at once.

        If it was started before `on_state` was set, `on_state` gets its present state.
        """
        self._closed = False
        if self.second_reader is not None:
            self.second_reader._closed = False
        await self._living_worker()
        if self._unreported:
            self._change(self.state, self.detail)

    async def close(self) -> None:
        """Stop any generation and end the worker."""
        self._closed = True
        self.cancel()
        async with self._spawning:
            worker, self._worker = self._worker, None
        if worker is not None:
            await worker.close()
        if self.second_reader is not None:
            await self.second_reader.close()

    def cancel(self) -> None:
        """Stop the running generation, if any; it ends as `cancelled`."""
        self._stop.set()
        if self._worker is not None:
            self._worker.interrupt()

    def kill_worker(self) -> None:
        """Kill the model's process for fault injection; it is started again when needed."""
        if self._worker is not None:
            self._worker.strike()

    async def generate(self, request: Request) -> AsyncGenerator[str | GenerationEnd]:
        """Yield the answer to `request` in pieces, then one GenerationEnd.

        A request that `yields` ends as `cancelled` as soon as another request arrives, and at once
        if another one is waiting. Raises ModelUnavailableError if the model cannot be loaded,
        PromptRefusedError if the prompt does not fit, and EngineDiedError if the worker ended
        during the request.
        """
        urgent = not request.yields
        self._urgent += urgent
        if urgent:
            self._give_way()
            if self.second_reader is not None:
                self.second_reader._give_way()
        try:
            async with aclosing(self._generate(request)) as items:
                async for item in items:
                    yield item
        finally:
            self._urgent -= urgent

    def _give_way(self) -> None:
        """Stop the current prompt if it may be interrupted."""
        if self._interruptible:
            self.cancel()

    async def warm(self, role: Role, system: str, user: str = "") -> None:
        """Evaluate the beginning of prompts of `role` ahead; a real prompt interrupts this.

        The evaluated part is kept, so an interrupted warm-up is not lost. Failures appear in
        `state`.
        """
        beginning = Request(role, system, user, WARM_GRAMMAR, 1, LOAD_LIMIT_S, yields=True)
        with suppress(EngineError):
            async for _ in self.generate(beginning):
                pass

    async def _generate(self, request: Request) -> AsyncGenerator[str | GenerationEnd]:
        """Wait for the turn and for the model, then send the prompt."""
        async with self._turn:
            self._stop.clear()
            if request.yields and self._urgent:
                yield GenerationEnd("", Usage(), "cancelled")
                return
            self._interruptible = request.yields
            worker = await self._living_worker()
            if not await self._loaded(worker):
                yield GenerationEnd("", Usage(), "cancelled")
                return
            self._number += 1
            self.busy = True
            try:
                async for item in self._exchange(worker, self._number, request):
                    yield item
            finally:
                self.busy = False
                worker.send(Cancel(id=self._number))

    async def _living_worker(self) -> Worker:
        """Return the worker, started if needed; cancelling the caller does not stop the start."""
        if self._closed:
            raise ModelUnavailableError("the engine is closed")
        self._birth = asyncio.ensure_future(self._spawned())
        return await asyncio.shield(self._birth)

    async def _spawned(self) -> Worker:
        async with self._spawning:
            if self._worker is None or self._worker.ended:
                self._change("loading", self.model.name)
                self._worker = await Worker.spawn(self._load, self._on_ready, self._on_end)
            return self._worker

    async def _loaded(self, worker: Worker) -> bool:
        """Wait until the model is loaded; return False if cancelled meanwhile."""
        name = self.model.name
        stop = asyncio.ensure_future(self._stop.wait())
        try:
            await asyncio.wait(
                {worker.ready, stop}, timeout=LOAD_LIMIT_S, return_when=asyncio.FIRST_COMPLETED
            )
        finally:
            stop.cancel()
        if self._stop.is_set():
            return False
        if worker.ready.done():
            if worker.error:
                raise ModelUnavailableError(self._unusable(worker.error))
            if worker.ended:
                raise EngineDiedError(DIED_LOADING.format(path=self.model.path))
            return True
        await worker.kill()
        raise ModelUnavailableError(f"model {name} was not loaded within {LOAD_LIMIT_S:.0f} s")

    async def _exchange(
        self, worker: Worker, number: int, request: Request
    ) -> AsyncGenerator[str | GenerationEnd]:
        """Send `request` and pass on the worker's messages until the answer ends or is too late."""
        worker.send(
            # The worker uses the grammar: the schema is for servers, and may be long.
            Generate(id=number, request=replace(request, schema=None))
        )
        started = perf_counter()
        limit, text = started + request.deadline_s, ""
        finish: Finish | None = None
        while True:
            message = await worker.receive(limit)
            match message:
                case TextPiece(id=id_) if id_ == number:
                    text += message.text
                    yield message.text
                case Done(id=id_) if id_ == number:
                    self._report_slowed(message.slowed)
                    reason = finish or message.finish
                    yield GenerationEnd(text, message.usage, reason, message.texts, message.chances)
                    return
                case GenerationFailure(id=id_) if id_ == number:
                    raise PromptRefusedError(message.error)
                case "ended" if worker.error:
                    raise ModelUnavailableError(self._unusable(worker.error))
                case "ended":
                    raise EngineDiedError(DIED)
                case "stop" if finish is None and self._stop.is_set():
                    finish = "cancelled"
                    worker.send(Cancel(id=number))
                    limit = perf_counter() + GRACE_S
                case "late" if finish is None:
                    finish = "deadline"
                    worker.send(Cancel(id=number))
                    limit = perf_counter() + GRACE_S
                case "late":
                    await worker.kill()
                    usage = Usage(seconds=perf_counter() - started)
                    yield GenerationEnd(text, usage, finish or "deadline")
                    if not self._closed:
                        await self._living_worker()
                    return
                case _:
                    continue

    def _unusable(self, error: str) -> str:
        return f"model {self.model.name} cannot be used: {error}"

    def _report_slowed(self, slowed: bool) -> None:
        """Report that answers are slow because the machine is busy, or that they no longer are."""
        if slowed != self._slowed:
            self._slowed = slowed
            if slowed:
                self._change("slow", SLOWED)
            else:
                self._become_ready()

    def _on_ready(self, loaded: Ready) -> None:
        self.info = replace(self.info, n_ctx=loaded.n_ctx, description=loaded.description)
        self._slowed, self._unconfined = False, loaded.unconfined
        self._become_ready()

    def _become_ready(self) -> None:
        """Report that the model is loaded, and any restrictions that do not hold."""
        if self._unconfined:
            self._change("unconfined", f"{self.model.name}; what does not hold: {self._unconfined}")
        else:
            self._change("ready", self.model.name)

    def _on_end(self, error: str) -> None:
        """Report why the worker ended: the model could not be loaded, or the process died."""
        if not self._closed:
            self._change("unavailable" if error else "dead", error or "the process ended")

    def _change(self, state: WorkerState, detail: str) -> None:
        self.state, self.detail = state, detail
        self._unreported = self.on_state is None
        if self.on_state is not None:
            self.on_state(state, detail)
