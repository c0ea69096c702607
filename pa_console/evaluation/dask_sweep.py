"""Tasks on the workers of a Dask scheduler; the module is imported only for a sweep.

A task that is submitted twice runs once, because its key is unique. If a worker dies, its task
moves to another worker. If the scheduler restarts, the unfinished tasks are submitted again.
"""

import asyncio
import logging
import signal
from abc import ABC, abstractmethod
from collections.abc import AsyncGenerator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Lock
from typing import Any, Generic, Protocol, TypeVar, cast

from distributed import Client, LocalCluster, WorkerPlugin, as_completed, get_worker
from distributed.scheduler import KilledWorker

from pa_console.child_processes import isolated_workers

AWAY_S = 600.0
"""The longest wait for an unreachable scheduler, in seconds."""
AGAIN_S = 2.0
"""The time between two attempts to reach the scheduler, in seconds."""


class SweepError(ValueError):
    """Raised if a sweep cannot continue; its results are kept, and the same command resumes it."""


class KeyedTask(Protocol):
    """One unit of work."""

    @property
    def key(self) -> str:
        """The key on the scheduler; it includes a hash of all dependencies."""
        ...


TaskT = TypeVar("TaskT", bound=KeyedTask)
MadeT = TypeVar("MadeT")


class TaskMaker(WorkerPlugin, ABC, Generic[TaskT, MadeT]):
    """The plugin that runs tasks on a worker; each worker receives it once, with dependencies."""

    name: str
    """The name of the plugin on the scheduler."""
    own_process = False
    """True if the worker is a process of this program, which handles Ctrl-C in its place."""

    def setup(self, worker: object) -> None:  # noqa: ARG002 - the library's signature
        """Prepare a worker."""
        if self.own_process:
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        self.turn = Lock()
        self._temporary = TemporaryDirectory(prefix="pa-console-")
        self.folder = Path(self._temporary.name)
        self.begin()

    def teardown(self, worker: object) -> None:  # noqa: ARG002
        """Release a worker."""
        self.end()
        self._temporary.cleanup()

    def begin(self) -> None:
        """Prepare the work, once on each worker; files go into `folder`."""

    def end(self) -> None:
        """Release what `begin` prepared."""

    @abstractmethod
    def make(self, task: TaskT) -> MadeT:
        """Return the result of `task`; called on threads of the worker."""


def make_remotely(maker: str, task: KeyedTask) -> object:
    """Run `task` on the current worker with the plugin called `maker`; return the result."""
    return cast(Any, get_worker()).plugins[maker].make(task)


@dataclass(frozen=True)
class Workers:
    """The workers of the scheduler at the address `scheduler`, or `count` local processes."""

    scheduler: str = ""
    count: int = 0


class DaskSweep(Generic[TaskT, MadeT]):
    """A sweep that runs the `missing` tasks on Dask's workers with the plugin `maker`."""

    def __init__(
        self,
        maker: TaskMaker[TaskT, MadeT],
        missing: Callable[[], Sequence[TaskT]],
        *,
        told: Callable[[str], None] = lambda _text: None,
        again_s: float = AGAIN_S,
    ) -> None:
        """Pass progress lines to `told`; try a lost scheduler again every `again_s` seconds."""
        self._maker, self._missing, self._told, self._again_s = maker, missing, told, again_s
        self._reached = False
        """True once the scheduler was reached; from then on, the sweep waits for a lost one."""

    async def run_on(self, target: Any) -> AsyncGenerator[MadeT]:
        """Yield each result as it arrives from the workers of `target`, an address or a cluster.

        The caller must store a result before it requests the next one. Raises SweepError if there
        is no scheduler, or if a task ends every worker that runs it.
        """
        clock = asyncio.get_running_loop().time
        last = clock()
        while tasks := self._missing():
            try:
                async for made in self._round(target, tasks):
                    last = clock()
                    yield made
            except (OSError, TimeoutError) as error:
                if not self._reached or clock() - last > AWAY_S:
                    raise SweepError(
                        f"no scheduler answers at {target}: see its address"
                    ) from error
            if left := self._missing():
                self._told(f"the scheduler is away: {len(left)} results are asked for again")
                await asyncio.sleep(self._again_s)

    async def _round(self, target: Any, tasks: Sequence[TaskT]) -> AsyncGenerator[MadeT]:
        """Submit `tasks`, and yield results until all are complete or the scheduler is lost."""
        connecting: Any = Client(target, asynchronous=True, timeout=AGAIN_S)
        async with connecting as client:
            self._reached = True
            self._maker.own_process = not isinstance(target, str)
            name = self._maker.name
            await client.register_plugin(self._maker, name=name)
            futures = [client.submit(make_remotely, name, task, key=task.key) for task in tasks]
            completed: Any = as_completed(futures)
            async for future in completed:
                if future.status == "error":
                    raise _failed(await future.exception())
                if future.status != "finished":  # lost in a restart of the scheduler
                    continue
                yield cast(MadeT, await future.result())
                future.release()


def _failed(error: BaseException) -> BaseException:
    if isinstance(error, KilledWorker):
        return SweepError(f"one task ended every worker that made it: {error}")
    return error


@asynccontextmanager
async def cluster(workers: Workers) -> AsyncGenerator[Any]:
    """Yield the target for a client; local worker processes end on exit."""
    if workers.scheduler:
        yield workers.scheduler
        return
    started = cast(Any, LocalCluster)(
        n_workers=workers.count,
        threads_per_worker=1,
        processes=True,
        asynchronous=True,
        host="127.0.0.1",
        dashboard_address=None,
        silence_logs=logging.CRITICAL,
    )
    with isolated_workers():
        async with started as running:
            yield running
