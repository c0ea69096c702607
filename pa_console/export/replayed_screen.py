"""A recorded session on the console's own screen, without a terminal, picture by picture."""

import asyncio
import io
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

from rich.console import Console
from textual.driver import Driver
from textual.drivers.headless_driver import HeadlessDriver
from textual.pilot import Pilot

import pa_console.tui
from pa_console.policy.retriever import Retriever
from pa_console.schema.text import visible_line
from pa_console.session.recording import Player
from pa_console.station.assembly import Site
from pa_console.tui.app import ConsoleApp
from pa_console.tui.refresh import ALL_VIEWS, views_of
from pa_console.tui.screens.recording import RecordingScreen

Size = tuple[int, int]
"""Columns and rows."""

DRAWN_LIMIT_S = 10.0
"""The longest wait for the screen to be drawn once."""


class TapeDriver(HeadlessDriver):
    """A driver that keeps the output for a terminal instead of writing it."""

    @property
    def is_headless(self) -> bool:
        """False, as for a terminal: a headless driver writes nothing."""
        return False

    def write(self, data: str) -> None:
        """Keep `data` for the next shot."""
        cast(ShotApp, self._app).tape.append(data)


class ShotRecordingScreen(RecordingScreen):
    """A recording screen that is moved by the exporter."""

    shown: int | None = None
    """The number of events that had been played at the last painting."""

    def show_now(self) -> None:
        """Paint the views that have changed since the last painting."""
        self._moved()
        first, now = self.shown, self.player.index
        if first is None or now < first:
            self._dirty = ALL_VIEWS
        else:
            kinds = self.player.recording.timeline.kinds_between(first, now)
            self._dirty = frozenset(view for kind in kinds for view in views_of(kind))
        self.shown = now
        self.repaint()


class ShotApp(ConsoleApp):
    """The replaying console on a tape, with a stopped clock so that nothing moves by itself."""

    CSS_PATH = Path(pa_console.tui.__path__[0]) / "console.tcss"

    def __init__(self, site: Site, player: Player) -> None:
        """Show `player` with the world and the rules of `site`."""
        retriever = Retriever(site.rulebook.rules)
        super().__init__(
            site.world, None, site.rulebook, retriever, player=player, clock=lambda: 0.0
        )
        self.console = Console(
            file=io.StringIO(), force_terminal=True, color_system="truecolor", legacy_windows=False
        )
        self.animation_level = "none"
        self.tape: list[str] = []
        self.recording_screen: ShotRecordingScreen | None = None

    def get_driver_class(self) -> type[Driver]:
        """Return the driver that writes to the tape."""
        return TapeDriver

    def show_session(self) -> None:
        """Show the recording in the screen that the exporter moves."""
        session, rules = self.session, self.controllers.rules.texts
        assert session.player is not None
        self.recording_screen = ShotRecordingScreen(
            session.world, rules, session.player, session.clock
        )
        session.main = self.recording_screen
        self.push_screen(self.recording_screen)


class ReplayedScreen:
    """The exporter's handle on the screen between two pictures."""

    def __init__(self, app: ShotApp, pilot: Pilot[object], player: Player) -> None:
        self._app, self._pilot = app, pilot
        self.player = player

    async def show(self) -> None:
        """Paint the present state of the player."""
        if self._app.recording_screen is not None:
            self._app.recording_screen.show_now()
        await self._pilot.pause()
        await self._drawn()

    async def _drawn(self) -> None:
        """Wait until painting is done, which may take long on a busy machine.

        A console that has broken down no longer paints: there is no wait for it.
        """
        sent = -1
        while sent != len(self._app.tape):
            sent, drawn = len(self._app.tape), asyncio.Event()
            if not self._app.screen.call_after_refresh(drawn.set):
                return
            with suppress(TimeoutError):
                await asyncio.wait_for(drawn.wait(), DRAWN_LIMIT_S)

    def written(self) -> str:
        """Return the output for a terminal since the last call."""
        text = "".join(self._app.tape)
        self._app.tape.clear()
        return text

    def svg(self, title: str) -> str:
        """Return the screen as an SVG picture, with spaces preserved in every viewer."""
        picture = self._app.export_screenshot(title=visible_line(title))
        return picture.replace("<svg ", '<svg xml:space="preserve" ', 1)


async def picture_replay(
    site: Site, player: Player, size: Size, direct: Callable[[ReplayedScreen], Awaitable[None]]
) -> None:
    """Show `player` on a screen of `size` while `direct` takes shots; raise its errors.

    Raises RuntimeError if the console itself breaks down.
    """
    app = ShotApp(site, player)
    directing: list[asyncio.Task[Any]] = []

    async def ready(pilot: Pilot[object]) -> None:
        task = asyncio.current_task()
        assert task is not None
        directing.append(task)
        await pilot.pause()
        await direct(ReplayedScreen(app, pilot, player))
        app.exit()

    running = asyncio.create_task(app.run_async(mouse=False, size=size, auto_pilot=ready))
    try:
        await asyncio.shield(running)
    except asyncio.CancelledError:
        for task in directing:
            task.cancel()
        app.exit()
        await asyncio.gather(running, return_exceptions=True)
        raise
    if app.return_code:
        raise RuntimeError("the console broke down while pictures were taken of it")
