"""Spares the tests what Textual does anew for each of some hundred applications.

A test goes on once its application has nothing left to do, without a look at the clock. Each style
sheet is parsed once a session of tests. Frames that reach no terminal are not drawn, but those
that a test waits for with `paint`, and the last one.
"""

import asyncio
from time import monotonic, process_time
from typing import Any

import pytest
import textual.app
import textual.pilot
from textual._compositor import Compositor
from textual._context import active_app
from textual.app import App
from textual.css.model import RuleSet
from textual.css.stylesheet import Stylesheet

STEP_S = 0.004
BUSY = 0.25
"""A process that computes for more than this share of a step, in any of its threads, is busy."""


def quicken(patch: pytest.MonkeyPatch) -> None:
    """Put what is quicker in the place of Textual's own."""
    for module in (textual.app, textual.pilot):
        patch.setattr(module, "wait_for_idle", wait_for_idle)
    patch.setattr(textual.pilot.Pilot, "_wait_for_screen", _waiting_for_busy_ones())
    patch.setattr(Stylesheet, "_parse_rules", _parsing_once())
    patch.setattr(RuleSet, "__hash__", object.__hash__)  # by identity as Textual's, but faster
    patch.setattr(Compositor, "render_update", _leave_undrawn)
    patch.setattr(App, "_shutdown", _painting_at_the_end())


_render_update: Any = getattr(Compositor, "render_update")  # noqa: B009


def paint(app: App[Any]) -> None:
    """Draw what has changed on the screen in front since the last time.

    Raises whatever a widget raises that cannot be drawn.
    """
    shown: Any = app
    if shown.screen._compositor._dirty_regions:
        _render_update(shown.screen._compositor, screen_stack=shown._background_screens)


def _leave_undrawn(compositor: Compositor, full: bool = False, **options: Any) -> Any:
    """Draw what is asked for as a whole or written somewhere; leave other frames to `paint`."""
    app = active_app.get(None)
    if full or app is None or not app.is_headless:
        return _render_update(compositor, full, **options)
    return None


def _painting_at_the_end() -> Any:
    """Return what ends an application once the last frame is drawn."""
    shutdown: Any = getattr(App, "_shutdown")  # noqa: B009

    async def paint_and_shutdown(app: Any) -> None:
        try:
            if app._screen_stack and app._exception is None:
                paint(app)
        except Exception as error:
            app._handle_exception(error)
        await shutdown(app)

    return paint_and_shutdown


async def wait_for_idle(min_sleep: float = 0.0, max_sleep: float = 1.0) -> None:
    """Wait until nothing is ready to run in the event loop, no thread computes and all is laid out.

    Textual's own looks at the processor time of 20 ms, and nothing else, twice a key. A loop in
    which nothing is ready waits for keys, timers and threads: only for a thread is time spent, as
    long as it computes. Takes `min_sleep` to `max_sleep` seconds.
    """
    loop: Any = asyncio.get_running_loop()
    begun = monotonic()
    while monotonic() - begun < max_sleep:
        await asyncio.sleep(0)
        if loop._ready or await _a_thread_computes(loop) or loop._ready or _has_gone_on():
            continue
        if monotonic() - begun >= min_sleep:
            return


async def _a_thread_computes(loop: Any) -> bool:
    """Look for a step at threads that have work; one that waits for something does not compute."""
    pool = loop._default_executor
    if pool is None or (
        not pool._work_queue.qsize() and pool._idle_semaphore._value == len(pool._threads)
    ):
        return False
    computed = process_time()
    await asyncio.sleep(STEP_S)
    return process_time() - computed >= BUSY * STEP_S


def _has_gone_on() -> bool:
    """Take what waits for a frame: a new size, a layout, and whatever is called after it."""
    app: Any = active_app.get(None)
    if not getattr(app, "_screen_stack", None) or app._batch_count:
        return False
    if app._resize_event is not None and app._screen_stack[-1].is_running:
        app._check_resize()
        return True
    waiting = [screen for screen in app._screen_stack if screen.is_running and _waits(screen)]
    for screen in waiting:
        screen._on_timer_update()
    return bool(waiting)


def _waits(screen: Any) -> bool:
    """Return whether a screen, the one in front or one behind it, waits for its next frame."""
    return bool(
        screen._layout_required
        or screen._scroll_required
        or screen._recompose_required
        or screen._callbacks
    )


def _waiting_for_busy_ones() -> Any:
    """Return what waits for the widgets of a screen unless all of them wait for messages."""
    wait: Any = getattr(textual.pilot.Pilot, "_wait_for_screen")  # noqa: B009

    async def wait_for_screen(pilot: Any, *args: Any, **options: Any) -> bool:
        screen = pilot.app._screen_stack[-1] if pilot.app._screen_stack else None
        if screen is None:
            return await wait(pilot, *args, **options)
        pumps: list[Any] = [pilot.app, *screen.walk_children(with_self=True)]
        queues = [pump._message_queue for pump in pumps]
        if all(not queue.values and queue.ready_event._waiters for queue in queues):
            return True
        return await wait(pilot, *args, **options)

    return wait_for_screen


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
