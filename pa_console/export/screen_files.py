"""A replay on the console's own screen as numbered SVG screenshots or an asciicast, version 2."""

import asyncio
import gc
import io
import json
from collections.abc import Awaitable, Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, BinaryIO, cast, get_args

from rich.console import Console
from textual._compositor import ChopsUpdate, Compositor
from textual.driver import Driver
from textual.drivers.headless_driver import HeadlessDriver
from textual.geometry import Region
from textual.message_pump import MessagePump
from textual.pilot import Pilot

import pa_console.tui
from pa_console.policy.retriever import Retriever
from pa_console.schema.base import Payload
from pa_console.schema.events.event import EventPayload, MissionReceived
from pa_console.schema.text import clock_text, visible_json, visible_line
from pa_console.session.recording import Player, Recording
from pa_console.station.assembly import Site
from pa_console.tui.app import ConsoleApp
from pa_console.tui.refresh import ALL_VIEWS, views_of
from pa_console.tui.screens.recording import RecordingScreen

Size = tuple[int, int]
"""The number of columns and rows."""

DRAWN_LIMIT_S = 10.0
"""The longest wait for one drawing of the screen, in seconds."""
QUIET_ROUNDS = 3
"""The number of rounds of the event loop without a message after which the screen is settled."""
JUST_BEFORE_S = 5e-7
"""Half the resolution of time stamps in seconds; the resolution is a microsecond."""
BEGIN = "\x1b[?25l\x1b[0m\x1b[2J"
END = "\x1b[0m\x1b[?25h\r\n"
QUIET_STEPS = 8
"""The number of steps after which telemetry is shown if there is no other event."""


class TapeDriver(HeadlessDriver):
    """A driver that collects the terminal output instead of writing it."""

    @property
    def is_headless(self) -> bool:
        """False, as for a terminal, because a headless driver writes nothing."""
        return False

    def write(self, data: str) -> None:
        """Keep `data` for the next shot."""
        cast(ShotApp, self._app).tape.append(data)


class ChangedCompositor(Compositor):
    """A compositor that renders only the widgets with changes; the output is the same.

    Textual's own compositor renders every widget in the rectangle around all changes. In a replay,
    that is nearly always the whole screen.
    """

    def render_partial_update(self) -> ChopsUpdate | None:
        """Render the changed regions."""
        widgets, _ = self.visible_widgets, self.cuts  # cuts need all widgets
        # A widget that begins where a change ends is included, because the cursor moves there.
        changed = [Region(x, y, width + 1, height) for x, y, width, height in self._dirty_regions]
        self._visible_widgets = {
            widget: (region, clip)
            for widget, (region, clip) in widgets.items()
            if any(map(region.intersection(clip).overlaps, changed))
        }
        try:
            return super().render_partial_update()
        finally:
            self._visible_widgets = widgets


class ShotRecordingScreen(RecordingScreen):
    """A recording screen whose player the exporter moves."""

    shown: int | None = None
    """The number of events that had been played at the last painting."""
    filmed: bool = False
    """True once only the exporter decides when something is painted."""

    def __init__(self, *shown: Any) -> None:
        """Pass the arguments `shown` on to the recording screen."""
        super().__init__(*shown)
        self._compositor = ChangedCompositor()

    def paint(self) -> None:
        """Send the changes on the screen to the terminal."""
        super()._on_timer_update()

    def _on_timer_update(self) -> None:
        if not self.filmed:
            super()._on_timer_update()

    def _tick(self) -> None:
        """Let no time pass, because the exporter moves the player."""

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
    """The replay console with its output on a tape; its clock is stopped, so nothing moves."""

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
        """Show the recording on a `ShotRecordingScreen`."""
        session, rules = self.session, self.controllers.rules.texts
        assert session.player is not None
        self.recording_screen = ShotRecordingScreen(
            session.world, rules, session.player, session.clock
        )
        session.main = self.recording_screen
        self.push_screen(self.recording_screen)


class ReplayedScreen:
    """The exporter's access to the screen between two screenshots."""

    def __init__(self, app: ShotApp, pilot: Pilot[object], player: Player) -> None:
        self._app, self._pilot = app, pilot
        self._pumps: tuple[MessagePump, ...] = (app,)
        """The app, the screen and its widgets, as of the last search for them."""
        self.player = player

    async def show(self) -> None:
        """Paint the present state of the player.

        The wait for a console that has failed is limited, because it no longer paints.
        """
        screen = self._app.recording_screen
        if screen is None:
            return
        screen.filmed = True
        screen.show_now()
        sent, tape = -1, self._app.tape
        with suppress(TimeoutError):
            async with asyncio.timeout(DRAWN_LIMIT_S):
                while sent != len(tape):
                    sent = len(tape)
                    await self._settled(screen)
                    screen.paint()

    async def _settled(self, screen: ShotRecordingScreen) -> None:
        """Wait until no widget has a message left to process."""
        quiet = 0
        while quiet < QUIET_ROUNDS:
            await asyncio.sleep(0)
            if quiet == QUIET_ROUNDS - 1:  # slow, so new widgets are looked for only once
                self._pumps = (self._app, *screen.walk_children(with_self=True))
            quiet = 0 if any(pump.message_queue_size for pump in self._pumps) else quiet + 1

    def written(self) -> str:
        """Return the terminal output since the last call."""
        text = "".join(self._app.tape)
        self._app.tape.clear()
        return text

    def svg(self, title: str) -> str:
        """Return a screenshot as SVG, with spaces preserved in every viewer."""
        screenshot = self._app.export_screenshot(title=visible_line(title))
        return screenshot.replace("<svg ", '<svg xml:space="preserve" ', 1)


async def film_replay(
    site: Site, player: Player, size: Size, direct: Callable[[ReplayedScreen], Awaitable[None]]
) -> None:
    """Show `player` on a screen of `size` while `direct` takes shots.

    Raises the errors of `direct`, and RuntimeError if the console itself fails.
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
    gc.freeze()  # the garbage collector skips the modules and the recording
    try:
        await asyncio.shield(running)
    except asyncio.CancelledError:
        for task in directing:
            task.cancel()
        app.exit()
        await asyncio.gather(running, return_exceptions=True)
        raise
    finally:
        gc.unfreeze()
    if app.return_code:
        raise RuntimeError("the console failed while it was being recorded")


KINDS = tuple(
    sorted(
        payload.model_fields["kind"].default
        for payload in get_args(get_args(EventPayload)[0])
        if issubclass(payload, Payload) and not payload.transient
    )
)
"""The kinds of events that a log may contain."""


@dataclass(frozen=True)
class Shot:
    """The time of a screenshot, its name, and the index of the event after which it is taken."""

    seconds: float
    name: str
    index: int | None = None


def shots_at(recording: Recording, kinds: Iterable[str], first: float, last: float) -> list[Shot]:
    """Return a shot after every event of one of `kinds`, except telemetry."""
    wanted = frozenset(kinds)
    span = range(
        recording.timeline.count_until(first - JUST_BEFORE_S), recording.timeline.count_until(last)
    )
    others = (index for index in span if not recording.timeline.is_telemetry(index))
    events = [(index, recording[index].data.kind) for index in others]
    return [
        Shot(recording.timeline.seconds[index], kind, index)
        for index, kind in events
        if kind in wanted
    ]


def shots_every(step: float, first: float, last: float) -> list[Shot]:
    """Return a shot every `step` seconds, beginning with `first`."""
    count = int((last - first) / step) + 1
    return [Shot(first + n * step, f"{first + n * step:.0f}s") for n in range(count)]


async def take(
    screen: ReplayedScreen,
    shots: list[Shot],
    folder: Path,
    session: str,
    advance: Callable[[int], None],
) -> None:
    """Write the files 0001-NAME.svg and so on to `folder`; `shots` are in chronological order."""
    digits = max(4, len(str(len(shots))))
    for number, shot in enumerate(shots, start=1):
        if shot.index is None:
            screen.player.seek(shot.seconds)
        else:
            screen.player.seek(shot.seconds - JUST_BEFORE_S)
            while screen.player.index <= shot.index:
                screen.player.step()
        await screen.show()
        screenshot = screen.svg(f"{session}  {shot.name}  {clock_text(shot.seconds)}")
        path = folder / f"{number:0{digits}}-{shot.name}.svg"
        path.write_text(screenshot, encoding="utf-8")
        advance(1)


def positions(recording: Recording, first: float, last: float, step: float) -> list[float]:
    """Return the times to show, in seconds, `step` apart; times without a new event are left out.

    While only telemetry arrives, the times are `QUIET_STEPS` steps apart.
    """
    shown, timeline = [first], recording.timeline
    shown_count, since = timeline.count_until(first), 0
    for number in range(1, int((last - first) / step) + 1):
        at = first + number * step
        count = timeline.count_until(at)
        eventful = any(True for _ in timeline.without_telemetry(shown_count, count))
        if eventful or (count > shown_count and number - since >= QUIET_STEPS):
            shown.append(at)
            shown_count, since = count, number
    if timeline.count_until(last) > shown_count:
        shown.append(last)
    return shown


class CastWriter:
    """A cast file: the terminal output at each position of a replay."""

    def __init__(
        self, target: BinaryIO, size: Size, speed: float, advance: Callable[[int], None]
    ) -> None:
        """Play `speed` recorded seconds per second; `advance` is called after every frame."""
        self._target, self._size = target, size
        self._speed, self._advance = speed, advance

    def begin(self, start: datetime, title: str) -> None:
        """Write the header; `start` is the time of the recording."""
        width, height = self._size
        header = {
            "version": 2,
            "width": width,
            "height": height,
            "timestamp": int(start.timestamp()),
            "title": visible_line(title),
            "env": {"TERM": "xterm-256color"},
        }
        self._write(header)

    async def shoot(self, screen: ReplayedScreen, shown: list[float]) -> None:
        """Write a frame for each position in `shown`, and a marker for each new mission."""
        screen.player.rate = self._speed
        done = screen.player.recording.timeline.count_until(shown[0])
        screen.player.seek(shown[0])
        screen.player.playing = True
        await screen.show()
        self._write((0.0, "o", BEGIN + screen.written()))
        self._advance(1)
        for position in shown[1:]:
            screen.player.seek(position)
            screen.player.playing = True
            await screen.show()
            when = round((position - shown[0]) / self._speed, 3)
            for text in _arrivals(screen.player.recording, range(done, screen.player.index)):
                self._write((when, "m", text))
            done = screen.player.index
            self._write((when, "o", screen.written()))
            self._advance(1)
        self._write((round((shown[-1] - shown[0]) / self._speed + 2.0, 3), "o", END))

    def _write(self, line: object) -> None:
        self._target.write(visible_json(json.dumps(line, ensure_ascii=False)).encode() + b"\n")


def _arrivals(recording: Recording, span: range) -> Iterator[str]:
    """Yield the id and the text of every new mission in the events of `span`."""
    for index in span:
        if recording.of_mission(index):
            data = recording[index].data
            if isinstance(data, MissionReceived):
                yield visible_line(f"{data.mission.id} {data.mission.said}")
