"""Missions through our pipeline against the plain way of doing it with the same weights.

The plain way is one chat completion for the plan, under a JSON schema, then a second one for the
verdict: no digest, no rules found, no checks and no rehearsal, only the two prompts that ours has
made. It has as many threads, the same context and the same sampling.
"""

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass

from pa_console.evaluation.bench.child import Child, LoadWeights
from pa_console.evaluation.bench.compare import Bench, Comparison, compare
from pa_console.evaluation.bench.missions import BenchMission, OurWay, Pair, bench_missions
from pa_console.evaluation.bench.plain_messages import (
    PlainAnswer,
    PlainAsk,
    plan_schema,
    verdict_schema,
)
from pa_console.llm import judge, planner
from pa_console.llm.catalog import N_CTX, LocalModel
from pa_console.llm.engine import Engine
from pa_console.llm.judge import read_verdict
from pa_console.llm.planner import read_plan
from pa_console.llm.threads import physical_cores

PART = "missions"
PLAIN_MODULE = "pa_console.evaluation.bench.plain"
OURS = "steps 2 to 6: retrieval, digest, plan, checks, rehearsal, verdict"
PLAIN = "plain: two create_chat_completion calls with JSON schemas"
WARM_TOKENS = 8


@dataclass(frozen=True)
class Round:
    """One mission done in both ways, one directly after the other."""

    mission: str
    ours: Pair
    plan: PlainAnswer
    verdict: PlainAnswer

    @property
    def plain_seconds(self) -> float:
        """Wall time of the plain way."""
        return self.plan.seconds + self.verdict.seconds

    @property
    def plain_usable(self) -> int:
        """How many of the plain way's two answers can be read."""
        answers = read_plan(self.plan.text)[0], read_verdict(self.verdict.text)[0]
        return sum(answer is not None for answer in answers)


def measure_missions(bench: Bench) -> list[Comparison]:
    """Compare wall seconds a mission; raises EngineError when a model's process fails."""
    return comparisons(asyncio.run(_rounds(bench)))


def comparisons(rounds: Sequence[Sequence[Round]]) -> list[Comparison]:
    """Return a line a mission, one for all, and one for each call; `rounds` is by run."""
    found = [
        compare(
            PART,
            f"“{column[0].mission}”",
            (OURS, [entry.ours.seconds for entry in column]),
            (PLAIN, [entry.plain_seconds for entry in column]),
            note=_tokens(column),
        )
        for column in zip(*rounds, strict=True)
    ]

    everything = [entry for run in rounds for entry in run]
    answers = 2 * len(everything)
    usable = (
        f"answers that can be read: ours {sum(e.ours.usable for e in everything)} of {answers}, "
        f"plain {sum(e.plain_usable for e in everything)} of {answers}"
    )
    ours = "grammar, forced tokens, a KV cache a role"
    return [
        *found,
        compare(
            PART,
            f"all {len(found)} missions",
            (OURS, [sum(e.ours.seconds for e in run) for run in rounds]),
            (PLAIN, [sum(e.plain_seconds for e in run) for run in rounds]),
            note=usable,
        ),
        compare(
            PART,
            "the planner's calls alone",
            (ours, [sum(e.ours.planning_s for e in run) for run in rounds]),
            ("plain: one call, plan schema", [sum(e.plan.seconds for e in run) for run in rounds]),
        ),
        compare(
            PART,
            "the judge's calls alone",
            (ours, [sum(e.ours.judging_s for e in run) for run in rounds]),
            (
                "plain: one call, verdict schema",
                [sum(e.verdict.seconds for e in run) for run in rounds],
            ),
        ),
    ]


async def _rounds(bench: Bench) -> list[list[Round]]:
    """Do every mission in both ways, `bench.runs` times, after a round that is not counted.

    The missions take turns, so neither way finds more of a prompt in its cache than it would in
    service.
    """
    model, missions = bench.weights, bench_missions(bench.site.world)
    engine, threads = Engine(model), physical_cores()
    ours = OurWay(bench.site, engine)
    plain: Child | None = None
    try:
        bench.tell("loading the model twice", 0.0)
        plain = await start_plain(model, threads)
        bench.tell("warming up", 0.0)
        warm = [await ours.run(mission) for mission in missions]
        await _plainly(plain, missions[0], warm[0], WARM_TOKENS)
        rounds: list[list[Round]] = []
        for run in range(bench.runs):
            rounds.append([])
            for number, mission in enumerate(missions):
                share = (run + number / len(missions)) / bench.runs
                bench.tell(f"run {run + 1} of {bench.runs}: {mission.text}", share)
                pair = await ours.run(mission)
                answers = await _plainly(plain, mission, pair)
                rounds[-1].append(Round(mission.text, pair, *answers))
        return rounds
    finally:
        await engine.close()
        if plain is not None:
            await plain.close()


async def start_plain(model: LocalModel, threads: int, n_ctx: int = N_CTX) -> Child:
    """Start the plain way's process; raises EngineError when it cannot load the model."""
    load = LoadWeights(path=str(model.path), chat=model.chat, n_ctx=n_ctx, threads=threads)
    return await Child.start(PLAIN_MODULE, load)


async def _plainly(
    plain: Child, mission: BenchMission, pair: Pair, most: int | None = None
) -> tuple[PlainAnswer, PlainAnswer]:
    """Ask the plain way for plan and verdict with the prompts of ours."""
    sim = mission.sim
    asks = (
        (pair.planner, plan_schema(sim.world, sim.picture()), planner.MAX_TOKENS),
        (pair.judge, verdict_schema(pair.judged_rules), judge.MAX_TOKENS),
    )
    plan, verdict = [
        await plain.ask(
            PlainAsk(
                system=prompt.system,
                user=prompt.user,
                answer_schema=schema,
                max_tokens=most or limit,
            ),
            PlainAnswer,
        )
        for prompt, schema, limit in asks
    ]
    return plan, verdict


def _tokens(rounds: Sequence[Round]) -> str:
    """Return what the last round of a mission read and wrote; decoding is greedy, so all did."""
    last = rounds[-1]
    usages = (last.ours.plan_usage, last.ours.verdict_usage)
    answers = (last.plan, last.verdict)
    prompt = sum(usage.prompt_tokens for usage in usages)
    cached = sum(usage.cached_tokens for usage in usages)
    written = sum(usage.completion_tokens for usage in usages)
    chosen = sum(usage.sampled_tokens for usage in usages)
    cut = "" if all(answer.complete for answer in answers) else ", cut off"
    return (
        f"tokens: ours read {prompt - cached} of {prompt}, wrote {written} ({chosen} chosen); "
        f"plain had {sum(a.prompt_tokens for a in answers)}, "
        f"wrote {sum(a.completion_tokens for a in answers)}{cut}"
    )
