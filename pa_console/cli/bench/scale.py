"""`pa-console bench scale`: what teams of 10, 100 and 1,000 assets cost."""

import asyncio
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from statistics import median
from time import perf_counter
from typing import Annotated

import typer
from rich.table import Table

from pa_console.benchmarks.scale import SIZES, ScaleRow, count_tokens, measure
from pa_console.cli.output import JsonOption, ModelOption, RulesOption, errors, out, print_json
from pa_console.llm.engine.engine import Engine
from pa_console.llm.models.catalogue import find_model
from pa_console.llm.roles.prompts import Prompt
from pa_console.orchestrator.station.assembly import load_site

MAP_SIZE = (120, 36)
FRAMES = 20


def scale(
    rules: RulesOption = "checkpoint",
    model: ModelOption = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the generated worlds.")] = 0,
    json: JsonOption = False,
) -> None:
    """Measure teams of 10, 100 and 1,000 assets in generated worlds."""
    engine = Engine(find_model(model))
    measured: list[tuple[ScaleRow, float, Prompt]] = []
    with errors.status("measuring") as status:
        for gates, assets in SIZES:
            status.update(f"measuring {assets} assets, {gates} gates")
            with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
                measured.append(pool.submit(_measured, gates, assets, rules, seed).result())
        status.update("counting tokens")
        tokens = asyncio.run(_count(engine, [prompt for _, _, prompt in measured]))
    rows = [
        {**row.model_dump(), "map_ms": map_ms, "prompt_tokens": count}
        for (row, map_ms, _), count in zip(measured, tokens, strict=True)
    ]
    if json:
        print_json(rows)
        return
    table = Table("", *(f"{row['assets']} assets" for row in rows), box=None, pad_edge=False)
    for name in rows[0]:
        if name != "assets":
            table.add_row(name.replace("_", " "), *(f"{row[name]:,.4g}" for row in rows))
    out.print(table)


def _measured(gates: int, assets: int, rules: str, seed: int) -> tuple[ScaleRow, float, Prompt]:
    """Measure one size in a process of its own, so that its memory is its own."""
    from pa_console.tui.map.scene import MapScene  # noqa: PLC0415 - no other verb waits for Textual

    found = measure(gates, assets, load_site("checkpoint", rules).rulebook, seed)
    scene = MapScene(found.world)
    frames: list[float] = []
    for _ in range(FRAMES):
        started = perf_counter()
        scene.draw(found.picture, *MAP_SIZE)
        frames.append(perf_counter() - started)
    return found.row, 1000 * median(frames), found.prompt


async def _count(engine: Engine, prompts: list[Prompt]) -> list[int]:
    counts = [await count_tokens(engine, prompt) for prompt in prompts]
    await engine.close()
    return counts
