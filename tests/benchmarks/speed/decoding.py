"""Tokens a second of our planner against bare llama.cpp: how near the limit of the weights."""

import asyncio
from collections.abc import Sequence

from pa_console.llm.local.engine import Engine
from pa_console.llm.local.worker_process import ENVIRONMENT
from pa_console.llm.roles.role_model import PROMPT_FORMATS
from pa_console.schema.base import StrictModel
from tests.benchmarks.speed.child import Child, LoadWeights
from tests.benchmarks.speed.compare import Bench, Comparison, compare
from tests.benchmarks.speed.measured_missions import OurWay, bench_missions
from tests.benchmarks.speed.messages import MeasureSpeed, Speed

PART = "decoding"
RAW_MODULE = "tests.benchmarks.speed.raw"
ONE_BY_ONE = "limit: llama_decode, the same tokens one at a time, no grammar"


class Pass(StrictModel):
    """One run over all missions: the speeds of ours and of bare llama.cpp, mission by mission."""

    ours: tuple[Speed, ...]
    bare: tuple[Speed, ...]


def measure_decoding(bench: Bench) -> list[Comparison]:
    """Compare prompts and plans; raises EngineError when the process fails."""
    return comparisons(asyncio.run(_passes(bench)))


def comparisons(passes: Sequence[Pass]) -> list[Comparison]:
    """Return a line for the prompts and one for the plans; figures are of each pass as a whole."""
    last = passes[-1]
    batch, bare_batch = last.ours[0].batch, last.bare[0].batch
    prompts = compare(
        PART,
        f"{sum(speed.prompt_tokens for speed in last.ours)} prompt tokens, nothing cached",
        (
            f"{batch} at a time, can be interrupted",
            [_prompt_rate(run.ours) for run in passes],
        ),
        (f"limit: {bare_batch} at a time", [_prompt_rate(run.bare) for run in passes]),
        "tokens/s",
    )
    plans = compare(
        PART,
        f"{len(last.ours)} plans",
        ("chosen, guessed and forced", [_plan_rate(run.ours) for run in passes]),
        (ONE_BY_ONE, [_plan_rate(run.bare) for run in passes]),
        "tokens/s",
        _kinds(last.ours),
    )
    return [prompts, plans]


def _prompt_rate(speeds: Sequence[Speed]) -> float:
    """Return prompt tokens a second over all of `speeds`."""
    return _rate([(speed.prompt_tokens, speed.prompt_s) for speed in speeds])


def _plan_rate(speeds: Sequence[Speed]) -> float:
    """Return written tokens a second over all of `speeds`."""
    return _rate([(len(speed.answer.tokens), speed.answer_s) for speed in speeds])


def _rate(parts: Sequence[tuple[int, float]]) -> float:
    seconds = sum(part[1] for part in parts)
    return sum(part[0] for part in parts) / seconds if seconds > 0.0 else 0.0


def _kinds(speeds: Sequence[Speed]) -> str:
    """Return how many tokens came in which way; those read with the prompt are in no rate."""
    written = sum(len(speed.answer.tokens) for speed in speeds)
    chosen, guessed = sum(s.chosen for s in speeds), sum(s.guessed for s in speeds)
    read = sum(len(speed.answer.read) for speed in speeds)
    return (
        f"{written} tokens in {sum(s.evaluations for s in speeds)} evaluations: "
        f"{chosen - guessed} chosen one at a time, {guessed} guessed and confirmed, "
        f"{written - chosen} forced by the grammar; {read} more forced at the beginning were read "
        f"with the prompt"
    )


async def _passes(bench: Bench) -> list[Pass]:
    """Let both write the same plans in turn; a pass that is not counted warms up."""
    model = bench.weights
    ours = OurWay(bench.site, Engine(model))
    questions = [ours.question(mission) for mission in bench_missions(bench.site.world)]
    asks = [
        MeasureSpeed(
            system=question.prompt.system,
            user=question.prompt.user,
            grammar=question.grammar,
            max_tokens=PROMPT_FORMATS[model.prompts].plan_tokens,
        )
        for question in questions
    ]
    bench.tell("loading the model", 0.0)
    adapters = {adapter.role: str(adapter.path) for adapter in model.adapters}
    child = await Child.start(
        RAW_MODULE,
        LoadWeights(
            path=str(model.path),
            adapter=adapters.get("planner", ""),
            chat=model.chat,
            n_ctx=model.n_ctx,
        ),
        ENVIRONMENT,
    )
    try:
        passes: list[Pass] = []
        for run in range(-1, bench.runs):
            what = f"run {run + 1} of {bench.runs}" if run >= 0 else "warming up"
            bench.tell(what, max(run, 0) / bench.runs)
            pairs = [await _both(child, ask) for ask in asks]
            passes.append(Pass(ours=tuple(p[0] for p in pairs), bare=tuple(p[1] for p in pairs)))
        return passes[1:]
    finally:
        await child.close()


async def _both(child: Child, ask: MeasureSpeed) -> tuple[Speed, Speed]:
    ours = await child.ask(ask, Speed)
    bare = await child.ask(ask.model_copy(update={"bare": ours.answer}), Speed)
    return ours, bare
