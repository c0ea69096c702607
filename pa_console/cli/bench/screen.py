"""`pa-console bench screen`: for how long the console's screen answers nothing at most."""

import asyncio
import tempfile
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from pa_console.benchmarks.event_loop import LoopBlocks, LoopWatch
from pa_console.benchmarks.machine import Machine, describe_machine
from pa_console.cli.output import JsonOption, ModelOption, errors, out, print_json
from pa_console.llm.engine.engine import Engine
from pa_console.llm.models.catalogue import LocalModel, find_model
from pa_console.orchestrator.station.assembly import Site, load_site, open_station
from pa_console.orchestrator.station.ticking import RealTimeClock
from pa_console.schema.base import StrictModel
from pa_console.sim.worlds.world_generator import generate_world

if TYPE_CHECKING:
    from pa_console.tui.app import ConsoleApp

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
LOOK_S = 0.05
PAINT_S = 1.0
"""So long after it came a plan is on the screen."""


class ScreenReport(StrictModel):
    """The whole output of `pa-console bench screen`."""

    machine: Machine
    model: str
    model_sha256: str
    scenes: tuple[LoopBlocks, ...]


def screen(
    model: ModelOption = None,
    seconds: Annotated[float, typer.Option(min=1.0, help="How long it is idle.")] = 5.0,
    json: JsonOption = False,
) -> None:
    """Time the longest block of the console's event loop: idle, planning, drawing a picture."""
    weights, machine = find_model(model), describe_machine()
    with errors.status("measuring") as status:
        scenes = asyncio.run(_measure(weights, seconds, status.update))
    if json:
        print_json(
            ScreenReport(
                machine=machine,
                model=weights.name,
                model_sha256=weights.sha256,
                scenes=tuple(scenes),
            )
        )
        return
    for line in machine.lines:
        out.print(line, markup=False)
    out.print(f"model {weights.name} ({weights.sha256[:12]}), a screen of {SIZE[0]} x {SIZE[1]}")
    out.print(blocks_table(scenes))
    out.print(LEGEND)


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
    from pa_console.cli.console.screen import keep_loaded  # noqa: PLC0415 - with the screen
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
    from pa_console.tui.composing.examples import example_orders  # noqa: PLC0415 - with the screen

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
            await asyncio.sleep(LOOK_S)
