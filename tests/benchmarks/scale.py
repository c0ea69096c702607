"""The costs of teams of 10, 100 and 1,000 assets: simulation, rehearsal, checks, prompt, memory."""

import asyncio
import resource
from concurrent.futures import ProcessPoolExecutor
from datetime import UTC, datetime
from multiprocessing import get_context
from statistics import median
from time import perf_counter
from typing import Annotated, NamedTuple

import typer
from rich.table import Table

from pa_console.cli.options import ModelOption, RulesOption
from pa_console.llm.backend import GenerationEnd, Request
from pa_console.llm.local.engine import LOAD_LIMIT_S, WARM_GRAMMAR, Engine
from pa_console.llm.models.catalogue import PromptFormatName, find_model
from pa_console.llm.roles.grammar import plan_grammar
from pa_console.llm.roles.prompts import Prompt
from pa_console.llm.roles.role_model import PROMPT_FORMATS
from pa_console.mission.examine import examine
from pa_console.mission.planning.picture_text import digest_picture, select
from pa_console.policy.retriever import Retriever
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.base import StrictModel
from pa_console.schema.command import DeviceCommand
from pa_console.schema.incident import SpawnTrack
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action, Plan
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.world_generator import generate_world
from pa_console.station.assembly import load_site
from pa_console.terminal.output import errors, out
from tests.benchmarks.harness import JsonFileOption, keep

SIZES: tuple[tuple[int, int], ...] = ((4, 10), (16, 100), (50, 1000))
"""(gates, assets) of the table's rows."""

MOVING_SHARE = 0.05
SIMULATED_S = 20.0
REPEATS = 3


class ScaleRow(StrictModel):
    """One size; times are wall time, medians of a few repeats."""

    gates: int
    assets: int
    start_s: float
    speed_idle: float
    """Simulated seconds a second with nobody moving."""
    speed_moving: float
    """The same with one asset in twenty on its way and a vehicle at a gate."""
    rehearsal_ms: float
    rehearsed_s: float
    checks_ms: float
    select_ms: float
    prompt_characters: int
    grammar_characters: int
    memory_mb: float


class Measured(NamedTuple):
    """A row, and what it was measured on."""

    row: ScaleRow
    prompt: Prompt
    world: World
    picture: Picture


def measure(
    gates: int, assets: int, rulebook: Rulebook, prompts: PromptFormatName, seed: int = 0
) -> Measured:
    """Measure one size in this process, whose peak memory counts as the size's own."""
    world = generate_world(gates, assets, seed)
    started = perf_counter()
    sim = Checkpoint(world, seed)
    start_s = perf_counter() - started
    speed_idle = _speed(sim)
    gate = world.gates[0]
    sim.inject(SpawnTrack(gate=gate, distance_m=40.0))
    _run(sim, 3.0)
    mission = _mission(gate)
    plan = _plan(sim, world, mission)
    found = [asyncio.run(examine(plan, mission, sim, rulebook)) for _ in range(REPEATS)]
    select_ms, prompt, grammar = _prompt(sim, world, rulebook, mission, prompts)
    speed_moving = _speed_moving(sim, world)
    rehearsal = found[0].rehearsal
    row = ScaleRow(
        gates=gates,
        assets=assets,
        start_s=start_s,
        speed_idle=speed_idle,
        speed_moving=speed_moving,
        rehearsal_ms=1000 * median(f.rehearsal_s for f in found),
        rehearsed_s=rehearsal.timeline.duration_s if rehearsal is not None else 0.0,
        checks_ms=1000 * median(f.checks_s for f in found),
        select_ms=select_ms,
        prompt_characters=len(prompt.system) + len(prompt.user),
        grammar_characters=len(grammar),
        memory_mb=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    )
    return Measured(row, prompt, world, sim.picture())


def _mission(gate: str) -> Mission:
    text = f"An unknown vehicle is approaching {gate}."
    return Mission(id="scale", text=text, created=datetime.now(UTC), gate=gate)


def _plan(sim: Checkpoint, world: World, mission: Mission) -> Plan:
    """Return a plan for the free assets that a planner is told of first, if there are any.

    A UAV observes, a robot identifies; in a large world those told of first are the nearest.
    """
    picture, gate = sim.picture(), mission.gate
    free = digest_picture(picture, world, select(picture, world, mission, ())).free
    actions: list[Action] = []
    if free["uav"]:
        actions.append(Action(agent=free["uav"][0], command=f"observe {gate}"))
    if free["robot"]:
        actions.append(Action(agent=free["robot"][0], command=f"identify {gate}"))
    return Plan(reason="observe, then identify", actions=tuple(actions))


def _prompt(
    sim: Checkpoint,
    world: World,
    rulebook: Rulebook,
    mission: Mission,
    prompts: PromptFormatName,
) -> tuple[float, Prompt, str]:
    """Return the milliseconds of steps 2 to 4 without the model, the prompt and the grammar."""
    retriever = Retriever(rulebook.rules)
    started = perf_counter()
    picture = sim.picture()
    rules = [rulebook.get(hit.rule_id) for hit in retriever.retrieve(mission.text)]
    selection = select(picture, world, mission, rules)
    digest = digest_picture(picture, world, selection)
    prompt = PROMPT_FORMATS[prompts].planner(world, digest, rules, mission)
    chosen = (None, None) if selection is None else (selection.assets, selection.frames)
    grammar = plan_grammar(world, picture, *chosen)
    return 1000 * (perf_counter() - started), prompt, grammar


def _speed_moving(sim: Checkpoint, world: World) -> float:
    """Return simulated seconds a second while one asset in twenty goes to another frame."""
    movers = list(world.assets)[:: round(1 / MOVING_SHARE)]
    for number, name in enumerate(movers):
        target = world.gates[number % len(world.gates)]
        command = DeviceCommand(
            command_id=f"scale.{number}", agent=name, verb="move_to", target=target
        )
        sim.send(command)
    _run(sim, 1.0)
    return _speed(sim)


def _speed(sim: Checkpoint) -> float:
    started = perf_counter()
    _run(sim, SIMULATED_S)
    return SIMULATED_S / (perf_counter() - started)


def _run(sim: Checkpoint, seconds: float) -> None:
    for _ in range(round(seconds / sim.world.dt_s)):
        sim.step()


async def count_tokens(engine: Engine, prompt: Prompt) -> int:
    """Return how many tokens the engine's model reads `prompt` as; raises EngineError."""
    request = Request("planner", prompt.system, prompt.user, WARM_GRAMMAR, 1, LOAD_LIMIT_S)
    async for item in engine.generate(request):
        if isinstance(item, GenerationEnd):
            return item.usage.prompt_tokens
    return 0


MAP_SIZE = (120, 36)
FRAMES = 20


def scale(
    rules: RulesOption = "checkpoint",
    model: ModelOption = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the generated worlds.")] = 0,
    json: JsonFileOption = None,
) -> None:
    """Measure teams of 10, 100 and 1,000 assets in generated worlds."""
    entry = find_model(model)
    engine = Engine(entry)
    measured: list[tuple[ScaleRow, float, Prompt]] = []
    with errors.status("measuring") as status:
        for gates, assets in SIZES:
            status.update(f"measuring {assets} assets, {gates} gates")
            with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
                measured.append(
                    pool.submit(_measured, gates, assets, rules, entry.prompts, seed).result()
                )
        status.update("counting tokens")
        tokens = asyncio.run(_count(engine, [prompt for _, _, prompt in measured]))
    rows = [
        {**row.model_dump(), "map_ms": map_ms, "prompt_tokens": count}
        for (row, map_ms, _), count in zip(measured, tokens, strict=True)
    ]
    table = Table("", *(f"{row['assets']} assets" for row in rows), box=None, pad_edge=False)
    for name in rows[0]:
        if name != "assets":
            table.add_row(name.replace("_", " "), *(f"{row[name]:,.4g}" for row in rows))
    out.print(table)
    keep("scale", rows, json)


def _measured(
    gates: int, assets: int, rules: str, prompts: PromptFormatName, seed: int
) -> tuple[ScaleRow, float, Prompt]:
    """Measure one size in a process of its own, so that its memory is its own."""
    from pa_console.tui.map.scene import MapScene  # noqa: PLC0415 - no other verb waits for Textual

    found = measure(gates, assets, load_site("checkpoint", rules).rulebook, prompts, seed)
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
