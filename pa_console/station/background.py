"""Reports from outside the site's sensors: they are shown, and have no other effect."""

import asyncio
from collections.abc import Callable, Coroutine, Sequence
from typing import Protocol, get_args

from pa_console.schema.events import event as ev


class Background:
    """Runs tasks beside a session."""

    def __init__(self, on_failure: Callable[[BaseException], None]) -> None:
        """Call `on_failure` with the error of a task that broke."""
        self._on_failure = on_failure
        self._tasks: set[asyncio.Task[None]] = set()

    def start(self, work: Coroutine[None, None, None]) -> asyncio.Task[None]:
        """Run `work` from now on."""
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._ended)
        return task

    async def stop(self) -> None:
        """Cancel every task and wait until it has ended."""
        tasks = list(self._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def _ended(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            self._on_failure(error)


LOOK_S = 0.5
"""The interval between two requests for reports, wall seconds."""
_ADMITTED = get_args(ev.OutsideReport)


class Outside(Protocol):
    """A source of reports."""

    def news(self) -> Sequence[ev.OutsideReport]:
        """Return the new reports since the last call; at once, and never many."""
        ...


async def pass_on(outside: Outside, emit: Callable[[ev.OutsideReport], None]) -> None:
    """Emit the reports of a source for as long as the session lasts; only reports are let in.

    A source that fails is reported and left out: the session goes on without it.
    """
    while True:
        try:
            told = [report for report in outside.news() if isinstance(report, _ADMITTED)]
        except Exception as error:  # whoever reports from outside must not end the session
            text = f"nothing more is taken from outside: {type(error).__name__}: {error}"
            emit(ev.Noticed(level="warning", subject="TAK", text=text))
            return
        for report in told:
            emit(report)
        await asyncio.sleep(LOOK_S)
