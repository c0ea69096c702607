"""Spares the tests what Textual does anew for each of some hundred applications.

A session of tests waits a fifth of the time until an application is idle, and parses each style
sheet once.
"""

import asyncio
from time import monotonic, process_time
from typing import Any

import pytest
import textual.app
import textual.pilot
from textual.css.stylesheet import Stylesheet

STEP_S = 0.004
BUSY = 0.25
"""A process that computes for more than this share of a step, in any of its threads, is busy."""


def quicken(patch: pytest.MonkeyPatch) -> None:
    """Put what is quicker in the place of Textual's own."""
    for module in (textual.app, textual.pilot):
        patch.setattr(module, "wait_for_idle", wait_for_idle)
    patch.setattr(Stylesheet, "_parse_rules", _parsing_once())


async def wait_for_idle(min_sleep: float = 0.0, max_sleep: float = 1.0) -> None:
    """Wait until nothing is ready to run in the event loop and no thread computes.

    Textual's own looks at the processor time of 20 ms, and nothing else, twice a key. A loop in
    which nothing is ready waits for keys, timers and threads. Takes `min_sleep` to `max_sleep`
    seconds.
    """
    begun, ready = monotonic(), getattr(asyncio.get_running_loop(), "_ready", ())
    while monotonic() - begun < max_sleep:
        computed = process_time()
        await asyncio.sleep(STEP_S)
        quiet = process_time() - computed < BUSY * STEP_S
        if quiet and not ready and monotonic() - begun >= min_sleep:
            return


def _parsing_once() -> Any:
    """Return what parses a style sheet, and remembers the rules of one with the same variables."""
    parse: Any = Stylesheet._parse_rules  # pyright: ignore[reportPrivateUsage]
    parsed: dict[Any, Any] = {}

    def parse_rules(sheet: Any, css: str, *args: Any, **options: Any) -> Any:
        variables = frozenset(sheet._variables.items())
        key = (css, args, tuple(sorted(options.items())), variables)
        if key not in parsed:
            parsed[key] = parse(sheet, css, *args, **options)
        return parsed[key]

    return parse_rules
