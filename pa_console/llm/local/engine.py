"""The engine of a local model: it keeps one worker process and sends prompts to it (asyncio)."""

import asyncio
from collections.abc import AsyncGenerator, Callable
from contextlib import aclosing, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import Protocol

from pa_console.llm.backend import (
    EngineDiedError,
    EngineError,
    Finish,
    GenerationEnd,
    ModelUnavailableError,
    PromptRefusedError,
    Request,
)
from pa_console.llm.local.messages import (
    Cancel,
    Done,
    Generate,
    GenerationFailure,
    Load,
    PinnedFile,
    Ready,
    TextPiece,
)
from pa_console.llm.local.threads import physical_cores
from pa_console.llm.local.worker_process import Worker
from pa_console.llm.models.catalogue import LocalModel
from pa_console.schema.events.event import Role, WorkerState
from pa_console.schema.finding import Usage

SAMPLER = "greedy seed=0"
WARM_GRAMMAR = 'start: "{"'
LOAD_LIMIT_S = 300.0
SLOWED = "the machine is busy with other work, so answers take longer"
DIED = "the model's process died; it is started again when it is needed"
DIED_LOADING = (
    "the model's process died while it loaded {path}; if this happens again, the file is damaged "
    "or malicious: fetch it again, or choose another model"
)
GRACE_S = 1.0
"""The time that a worker has to stop before it is killed, in seconds."""

OnState = Callable[[WorkerState, str], None]


class SessionEngine(Protocol):
    """The engine of a session's local model, as a station uses it."""

    on_state: OnState | None
    """A callback for each new state and its reason."""

    @property
    def name(self) -> str:
        """The model's name."""
        ...

    @property
    def model(self) -> LocalModel:
        """The model, with its second reader and its adapters."""
        ...

    @property
    def second_reader(self) -> "SessionEngine | None":
        """The engine of the second reader; None if the model has none."""
        ...

    @property
    def sampler(self) -> str:
        """The sampling settings of the engine, as written to the session log."""
        ...

    @property
    def state(self) -> WorkerState:
        """The current state of the engine."""
        ...

    @property
    def busy(self) -> bool:
        """True while a prompt is being answered."""
        ...

    async def start(self) -> None:
        """Start loading the model and return at once."""
        ...

    async def close(self) -> None:
        """Stop any generation and end the model's process."""
        ...

    def kill_worker(self) -> None:
        """Kill the model's process, to inject a fault."""
        ...

    async def warm(self, role: Role, system: str, user: str = "") -> None:
        """Evaluate the beginning of the prompts of `role` in advance."""
        ...

    def generate(self, request: Request) -> AsyncGenerator[str | GenerationEnd]:
        """Yield the answer to `request` in pieces, then one GenerationEnd; raises EngineError."""
        ...


@dataclass(frozen=True)
class ModelInfo:
    """The facts about a model for the session log; `n_ctx` is exact once the engine is ready.

    `adapters` has the SHA-256 of every adapter by the name of its file.
    """

    name: str
    path: Path
    sha256: str
    n_ctx: int
    description: str
    adapters: dict[str, str] = field(default_factory=dict[str, str])


class Engine:
    """An engine that answers prompts, one at a time; `on_state` is called at each new state."""

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
        """The engine of the second reader, which is started when it is first needed. It reads ahead
        only while no caller waits for this engine."""
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
        """The number of prompts that a caller waits for, both queued and being answered."""
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
        """The process id of the running worker; None if no worker is running."""
        return None if self._worker is None or self._worker.ended else self._worker.pid

    async def start(self) -> None:
        """Start loading the model and return at once.

        If the state changed before `on_state` was set, `on_state` is called with the current state.
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
        """Kill the model's process, to inject a fault; it is started again when needed."""
        if self._worker is not None:
            self._worker.strike()

    async def generate(self, request: Request) -> AsyncGenerator[str | GenerationEnd]:
        """Yield the answer to `request` in pieces, then one GenerationEnd.

        A request that `yields` ends as `cancelled` as soon as a caller waits for another request.
        Raises ModelUnavailableError if the model cannot be loaded, PromptRefusedError if the prompt
        does not fit, and EngineDiedError if the worker ended during the request.
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
        """Evaluate the beginning of the prompts of `role` in advance.

        A prompt that a caller waits for interrupts this. The evaluated part is kept, so the work is
        not lost. Failures are reported in `state`.
        """
        beginning = Request(role, system, user, WARM_GRAMMAR, 1, LOAD_LIMIT_S, yields=True)
        with suppress(EngineError):
            async for _ in self.generate(beginning):
                pass

    async def _generate(self, request: Request) -> AsyncGenerator[str | GenerationEnd]:
        """Wait until earlier prompts are answered and the model is loaded, then send the prompt."""
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
        """Return the worker, and start it if necessary.

        If the caller is cancelled, the worker starts nevertheless.
        """
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
        """Wait until the model is loaded; return False if the request is cancelled meanwhile."""
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
        """Send `request`, and yield the answer until it ends or its deadline passes."""
        worker.send(
            # The worker uses the grammar. The schema is for servers and may be long.
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
        """Report when answers become slow because the machine is busy, and when this ends."""
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
            self._change("unconfined", f"{self.model.name}; not enforced: {self._unconfined}")
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
