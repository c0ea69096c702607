"""What others report from outside the site's sensors: it is told, and nothing else comes of it."""

import asyncio
from collections.abc import Callable, Sequence
from typing import Protocol, get_args

from pa_console.schema.events import event as ev

LOOK_S = 0.5
"""So often reports are asked for, in wall seconds."""
_ADMITTED = get_args(ev.OutsideReport)


class Outside(Protocol):
    """Where reports come from."""

    def news(self) -> Sequence[ev.OutsideReport]:
        """Return what is to be told since this was last asked; at once, and never much."""
        ...


async def pass_on(outside: Outside, emit: Callable[[ev.OutsideReport], None]) -> None:
    """Tell what is reported for as long as the session lasts; nothing but reports is let in.

    A source that fails is told of and left out: the session goes on without it.
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
