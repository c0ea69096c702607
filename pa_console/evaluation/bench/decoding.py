"""Tokens a second of our planner against bare llama.cpp: how near the limit of the weights."""

import asyncio
from collections.abc import Sequence

from pa_console.evaluation.bench.child import Child, LoadWeights
from pa_console.evaluation.bench.compare import Bench, Comparison, compare
from pa_console.evaluation.bench.missions import bench_missions, planner_request
from pa_console.evaluation.bench.raw_messages import MeasureSpeed, Speed
from pa_console.llm.catalog import N_CTX
from pa_console.llm.planner import MAX_TOKENS
from pa_console.llm.threads import physical_cores

PART = "decoding"
RAW_MODULE = "pa_console.evaluation.bench.raw"
ONE_BY_ONE = "limit: llama_decode, one token at a time, no grammar"
FEWEST_TOKENS = 16
"""Bare llama.cpp writes no fewer, however short our answer was."""


def measure_decoding(bench: Bench) -> list[Comparison]:
    """Compare prompts and answers step by step; raises EngineError when the process fails."""
    return comparisons(asyncio.run(_speeds(bench)))


def comparisons(rounds: Sequence[tuple[Speed, Speed]]) -> list[Comparison]:
    """Return a line for the prompt and one for each kind of step; `rounds` are (ours, bare)."""
    ours, bare = [pair[0] for pair in rounds], [pair[1] for pair in rounds]
    single, last = [speed.rate for speed in bare], ours[-1]
    prompt = f"{last.prompt_tokens} prompt tokens"
    found = [
        compare(
            PART,
            f"{prompt}, nothing cached",
            (f"{last.batch} at a time, can be interrupted", [s.prompt_rate for s in ours]),
            (f"limit: {bare[-1].batch} at a time", [s.prompt_rate for s in bare]),
            "tokens/s",
        )
    ]
    whole = f"{last.written} tokens written, {last.chosen} of them chosen by the model"
    chosen = [speed.decoded_rate for speed in ours]
    forced = [speed.forced_rate for speed in ours]
    kinds = (
        ("tokens chosen one at a time", "greedy, under the grammar", chosen, ""),
        ("tokens forced by the grammar", "in batches, each after a chosen token", forced, ""),
        ("the whole answer", "chosen and forced", [speed.rate for speed in ours], whole),
    )
    for name, what, figures, note in kinds:
        if all(figures):
            found.append(
                compare(PART, name, (what, figures), (ONE_BY_ONE, single), "tokens/s", note)
            )
    return found


async def _speeds(bench: Bench) -> list[tuple[Speed, Speed]]:
    """Measure both in turn on one prompt; a round that is not counted warms up."""
    model = bench.weights
    mission = bench_missions(bench.site.world)[-1]
    prompt, grammar = planner_request(bench.site, mission)
    ask = MeasureSpeed(
        system=prompt.system, user=prompt.user, grammar=grammar, max_tokens=MAX_TOKENS
    )
    bench.tell("loading the model", 0.0)
    threads = physical_cores()
    child = await Child.start(
        RAW_MODULE,
        LoadWeights(path=str(model.path), chat=model.chat, n_ctx=N_CTX, threads=threads),
    )
    try:
        rounds: list[tuple[Speed, Speed]] = []
        for run in range(-1, bench.runs):
            what = f"run {run + 1} of {bench.runs}" if run >= 0 else "warming up"
            bench.tell(what, max(run, 0) / bench.runs)
            ours = await child.ask(ask, Speed)
            count = max(FEWEST_TOKENS, sum(tokens for tokens, _ in ours.steps))
            bare = await child.ask(ask.model_copy(update={"bare_tokens": count}), Speed)
            rounds.append((ours, bare))
        return rounds[1:]
    finally:
        await child.close()
