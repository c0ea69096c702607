"""The longest block of the console's event loop: how late a beat comes that is due every 2 ms."""

import asyncio
import gc
import selectors
import sys
import tempfile
import threading
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import replace
from math import ceil
from pathlib import Path
from time import perf_counter, thread_time
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Self

import typer
from rich.table import Table

from pa_console.cli.options import ModelOption
from pa_console.evaluation.run_record import Machine, describe_machine
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.catalogue import LocalModel, find_model
from pa_console.schema.base import StrictModel
from pa_console.sim.worlds.world_generator import generate_world
from pa_console.station.assembly import Site, load_site, open_station
from pa_console.station.clock import RealTimeClock
from pa_console.terminal.output import errors, out
from tests.benchmarks.harness import JsonFileOption, introduce, keep

if TYPE_CHECKING:
    from pa_console.tui.app import ConsoleApp


BEAT_S = 0.002
LOOK_S = 0.005
"""How often it is looked what holds the loop up."""

LATE_S = 0.03
"""A beat as late as this is looked into."""

PACKAGE = "pa_console"


class LoopBlocks(StrictModel):
    """How late the beats came in a scene, in seconds.

    `during` is where the longest block was. `computing_s` is the longest time that the loop's own
    thread computed between two beats: what else there is of a block is the machine's, which was
    busy with other work.
    """

    scene: str
    seconds: float
    beats: int
    late_99_s: float
    longest_s: float
    computing_s: float
    during: str


class LoopWatch:
    """Beats in the running loop while it is entered; a thread looks at what holds it up."""

    def __init__(self, scene: str) -> None:
        self._scene = scene
        self._late_s: list[float] = []
        self._longest_s, self._during, self._seen = 0.0, "", ""
        self._computing_s = 0.0
        self._due_s = 0.0
        self._over = threading.Event()
        self._collecting_since_s: float | None = None

    async def __aenter__(self) -> Self:
        self._began_s = perf_counter()
        self._loop_thread = threading.get_ident()
        self._due_s = perf_counter() + BEAT_S
        self._beating = asyncio.create_task(self._beat())
        self._looking = threading.Thread(target=self._look, daemon=True)
        self._looking.start()
        gc.callbacks.append(self._collects)
        await asyncio.sleep(0)
        return self

    async def __aexit__(self, *_: object) -> None:
        """Stop; a block that is just over counts."""
        await asyncio.sleep(2 * BEAT_S)
        self._seconds = perf_counter() - self._began_s
        self._over.set()
        gc.callbacks.remove(self._collects)
        self._beating.cancel()
        with suppress(asyncio.CancelledError):
            await self._beating
        self._looking.join()

    @property
    def blocks(self) -> LoopBlocks:
        """What was found, once this is left."""
        late = sorted(self._late_s)
        return LoopBlocks(
            scene=self._scene,
            seconds=self._seconds,
            beats=len(late),
            late_99_s=late[ceil(0.99 * len(late)) - 1] if late else 0.0,
            longest_s=self._longest_s,
            computing_s=self._computing_s,
            during=self._during,
        )

    async def _beat(self) -> None:
        while True:
            self._due_s, self._seen = perf_counter() + BEAT_S, ""
            computed_s = thread_time()
            await asyncio.sleep(BEAT_S)
            self._computing_s = max(self._computing_s, thread_time() - computed_s)
            late_s = max(perf_counter() - self._due_s, 0.0)
            self._late_s.append(late_s)
            if late_s > self._longest_s:
                self._longest_s, self._during = late_s, self._seen

    def _collects(self, phase: str, _info: dict[str, int]) -> None:
        """Note a collection of garbage that takes long: it is nobody's code."""
        if phase == "start":
            self._collecting_since_s = perf_counter()
        elif self._collecting_since_s is not None:
            taken_s = perf_counter() - self._collecting_since_s
            if taken_s > LATE_S:
                self._seen = f"garbage collection, {1000 * taken_s:.0f} ms"

    def _look(self) -> None:
        while not self._over.wait(LOOK_S):
            if perf_counter() - self._due_s > LATE_S and not self._seen.startswith("garbage"):
                frames = sys._current_frames()  # pyright: ignore[reportPrivateUsage] - documented
                self._seen = _place(frames.get(self._loop_thread)) or self._seen


def _place(frame: FrameType | None) -> str:
    """Return the innermost function on the stack, and the innermost of this package.

    A thread that waits for events is held up by nobody but the machine.
    """
    if frame is not None and frame.f_globals.get("__name__") == selectors.__name__:
        return "other work on the machine"
    found: list[str] = []
    while frame is not None:
        name = str(frame.f_globals.get("__name__", ""))
        own = name.startswith(f"{PACKAGE}.")
        if not found or own:
            found.append(f"{name.removeprefix(f'{PACKAGE}.')}.{frame.f_code.co_name}")
        if own:
            break
        frame = frame.f_back
    return " < ".join(found)


SIZE = (120, 36)
LARGE = (50, 1000)
"""Gates and assets of the large world."""

LIMIT_S = 120.0
"""A plan that has not come by then fails the measurement."""

GOAL_S = 0.1
LEGEND = (
    "longest: the screen answered nothing for so long. computing: how much of such a time the "
    "console itself computed at most; the rest is other work on the machine."
)
SEEN_S = 0.05
PAINT_S = 1.0
"""So long after it came a plan is on the screen."""


class ScreenReport(StrictModel):
    """The whole output of the benchmark `screen`."""

    machine: Machine
    model: str
    model_sha256: str
    scenes: tuple[LoopBlocks, ...]


def screen(
    model: ModelOption = None,
    seconds: Annotated[float, typer.Option(min=1.0, help="How long it is idle.")] = 5.0,
    json: JsonFileOption = None,
) -> None:
    """Time the longest block of the console's event loop: idle, planning, drawing a picture."""
    weights, machine = find_model(model), describe_machine()
    with errors.status("measuring") as status:
        scenes = asyncio.run(_measure(weights, seconds, status.update))
    introduce(machine, weights, f"a screen of {SIZE[0]} x {SIZE[1]}")
    out.print(blocks_table(scenes))
    out.print(LEGEND)
    report = ScreenReport(
        machine=machine, model=weights.name, model_sha256=weights.sha256, scenes=tuple(scenes)
    )
    keep("screen", report, json)


def blocks_table(scenes: list[LoopBlocks]) -> Table:
    """Return a line a scene, beside the goal."""
    table = Table("scene", box=None, pad_edge=False)
    for name in ("s", "99 % ms", "longest ms", "computing ms", "goal ms", "reached"):
        table.add_column(name, justify="right")
    table.add_column("the longest was in", overflow="fold", ratio=1)
    for each in scenes:
        table.add_row(
            each.scene,
            f"{each.seconds:.1f}",
            f"{1000 * each.late_99_s:.1f}",
            f"{1000 * each.longest_s:.1f}",
            f"{1000 * each.computing_s:.1f}",
            f"{1000 * GOAL_S:g}",
            "yes" if each.longest_s <= GOAL_S else "NO",
            each.during,
        )
    return table


async def _measure(
    weights: LocalModel, seconds: float, tell: Callable[[str], None]
) -> list[LoopBlocks]:
    site = load_site("checkpoint", "checkpoint")
    large = replace(site, world=generate_world(*LARGE, 0))
    found: list[LoopBlocks] = []
    for name, of in (("", site), (f", {LARGE[1]:,} assets", large)):
        tell(f"a console{name}")
        async with _console(of, weights) as app:
            found += await _scenes(app, of, seconds, name)
    return found


@asynccontextmanager
async def _console(site: Site, weights: LocalModel) -> "AsyncGenerator[ConsoleApp]":
    """Give a console on a live station, in a terminal that is none; it keeps nothing."""
    from pa_console.cli.sessions.screen import keep_loaded  # noqa: PLC0415 - with the screen
    from pa_console.settings.sources import default_settings  # noqa: PLC0415
    from pa_console.tui.app import ConsoleApp  # noqa: PLC0415 - no other verb waits for Textual

    engine = Engine(weights)
    await engine.start()
    try:
        station = open_station(site, engine, RealTimeClock(), keep_engine=True)
        with tempfile.TemporaryDirectory(prefix="pa-console-screen-") as folder:
            app = ConsoleApp(
                site.world,
                station,
                site.rulebook,
                station.retriever,
                history=Path(folder) / "history.txt",
                favourites=Path(folder) / "favourites.yaml",
                copies=Path(folder),
                settings=default_settings(),
            )
            keep_loaded()
            async with app.run_test(size=SIZE):
                await _until(lambda: app.session.state.picture is not None)
                yield app
                await station.close()
    finally:
        await engine.close()


async def _scenes(app: "ConsoleApp", site: Site, seconds: float, name: str) -> list[LoopBlocks]:
    from pa_console.tui.order_templates import example_orders  # noqa: PLC0415 - with the screen

    async with LoopWatch(f"idle{name}") as idle:
        await asyncio.sleep(seconds)
    async with LoopWatch(f"planning{name}") as planning:
        app.controllers.commands.submit(example_orders(site.world)[0])
        await _until(lambda: _waits(app))
        await asyncio.sleep(PAINT_S)
    async with LoopWatch(f"a picture of the screen{name}") as picture:
        app.export_screenshot()
    return [idle.blocks, planning.blocks, picture.blocks]


def _waits(app: "ConsoleApp") -> bool:
    current = app.session.state.current
    return current is not None and current.approval is not None


async def _until(done: Callable[[], bool]) -> None:
    """Wait; raises TimeoutError after LIMIT_S."""
    async with asyncio.timeout(LIMIT_S):
        while not done():
            await asyncio.sleep(SEEN_S)
