"""Missions through our pipeline against the plain way of doing it with the same weights.

The plain way is one chat completion for the plan, under a JSON schema, then a second one for the
verdict: no digest, no rules found, no checks and no rehearsal, only the two prompts that ours has
made. It has the same adapters, the same context and the same sampling.
"""

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

from pa_console.llm.local.engine import Engine
from pa_console.llm.models.catalogue import LocalModel
from pa_console.llm.roles.judge import read_verdict
from pa_console.llm.roles.planner import read_plan
from pa_console.llm.roles.role_model import PROMPT_FORMATS
from pa_console.schema.events.event import Role
from tests.benchmarks.harness import Memory, process_memory
from tests.benchmarks.speed.child import Child, LoadWeights
from tests.benchmarks.speed.compare import Bench, Comparison, compare
from tests.benchmarks.speed.measured_missions import BenchMission, OurWay, Pair, bench_missions
from tests.benchmarks.speed.messages import PlainAnswer, PlainAsk, plan_schema, verdict_schema

PART = "missions"
OURS = "Enter to verdict; picture and words, but for the last one, read while typing"
OURS_UNREAD = "Enter to verdict, the picture not read before"
PLAIN = "plain: two create_chat_completion calls with JSON schemas"
WARM_TOKENS = 8
AHEAD = 2
"""The number of missions after which one is repeated with its text read ahead: by then the model's
cache of it is overwritten."""
PLAIN_MODULE = "tests.benchmarks.speed.plain"
ROLES: tuple[Role, ...] = ("planner", "judge")


class PlainWay:
    """llama-cpp-python's own way with `model`; each process reuses what it finds in its cache.

    An adapter belongs to a `Llama` for good, so roles with different ones need a `Llama` each.
    """

    def __init__(self, model: LocalModel) -> None:
        self._model = model
        self._prompt_format = PROMPT_FORMATS[model.prompts]
        files = {adapter.role: str(adapter.path) for adapter in model.adapters}
        self._adapters = {role: files.get(role, "") for role in ROLES}
        self._children: dict[str, Child] = {}

    async def start(self) -> Self:
        """Load the model; raises EngineError when a process cannot."""
        for adapter in dict.fromkeys(self._adapters.values()):
            load = LoadWeights(
                path=str(self._model.path),
                adapter=adapter,
                chat=self._model.chat,
                n_ctx=self._model.n_ctx,
            )
            self._children[adapter] = await Child.start(PLAIN_MODULE, load)
        return self

    async def answer(
        self, mission: BenchMission, pair: Pair, most: int | None = None
    ) -> tuple[PlainAnswer, PlainAnswer]:
        """Return a plan and a verdict to the prompts of ours, of `most` tokens at most."""
        world, picture = mission.sim.world, mission.sim.picture()
        plan = await self._ask(
            "planner",
            PlainAsk(
                system=pair.planner.system,
                user=pair.planner.user,
                answer_schema=plan_schema(world, picture),
                max_tokens=most or self._prompt_format.plan_tokens,
            ),
        )
        told = pair.judged_plan in pair.judge.user
        user = pair.judge.user if told else f"{pair.judge.user}\nPlan: {pair.judged_plan}"
        verdict = await self._ask(
            "judge",
            PlainAsk(
                system=pair.judge.system,
                user=user,
                answer_schema=verdict_schema(self._prompt_format.name, pair.judged_rules),
                max_tokens=most or self._prompt_format.verdict_tokens,
            ),
        )
        return plan, verdict

    @property
    def memory(self) -> Memory | None:
        """The memory of all processes; None if the system does not report it."""
        sizes = [process_memory(child.pid) for child in self._children.values()]
        known = [size for size in sizes if size is not None]
        if len(known) < len(sizes):
            return None
        return Memory(sum(size.pss_mb for size in known), sum(size.peak_mb for size in known))

    async def close(self) -> None:
        """End every process."""
        for child in self._children.values():
            await child.close()

    async def _ask(self, role: Role, ask: PlainAsk) -> PlainAnswer:
        return await self._children[self._adapters[role]].ask(ask, PlainAnswer)


@dataclass(frozen=True)
class Round:
    """One mission done in every way: ours, ours with nothing read ahead, and the plain one."""

    mission: str
    ours: Pair
    unread: Pair
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


@dataclass(frozen=True)
class Measured:
    """The rounds of every run, and the memory of the processes that hold the model at the end."""

    runs: Sequence[Sequence[Round]]
    ours: Memory | None
    plain: Memory | None


def measure_missions(bench: Bench) -> list[Comparison]:
    """Compare wall seconds a mission; raises EngineError when a model's process fails."""
    return comparisons(asyncio.run(_measured(bench)))


def comparisons(measured: Measured) -> list[Comparison]:
    """Return a line a mission, then decisions, calls and memory as a whole."""
    found = [
        compare(
            PART,
            f"“{column[0].mission}”",
            (OURS, [entry.ours.seconds for entry in column]),
            (PLAIN, [entry.plain_seconds for entry in column]),
            note=_tokens(column),
        )
        for column in zip(*measured.runs, strict=True)
    ]
    every = [entry for run in measured.runs for entry in run]
    answers = 2 * len(every)
    usable = (
        f"answers that can be read: ours {sum(e.ours.usable for e in every)} of {answers}, "
        f"plain {sum(e.plain_usable for e in every)} of {answers}"
    )

    def over_all(
        name: str,
        ours: tuple[str, Callable[[Round], float]],
        plain: tuple[str, Callable[[Round], float]],
        note: str = "",
    ) -> Comparison:
        line = compare(
            PART,
            name,
            (ours[0], [ours[1](entry) for entry in every]),
            (plain[0], [plain[1](entry) for entry in every]),
        )
        theirs = "" if line.other is None else f", plain {line.other.p95:.2f} s"
        tail = f"95th percentile: ours {line.ours.p95:.2f} s{theirs}"
        return line.model_copy(update={"note": "; ".join(filter(None, [tail, note]))})

    call = "plain: one call with its schema"
    return [
        *found,
        over_all(
            "a decision, read ahead while typing",
            (OURS, lambda e: e.ours.seconds),
            (PLAIN, lambda e: e.plain_seconds),
            f"{_read([e.ours for e in every])}; {usable}",
        ),
        over_all(
            "a decision, nothing read ahead",
            (OURS_UNREAD, lambda e: e.unread.seconds),
            (PLAIN, lambda e: e.plain_seconds),
            _read([e.unread for e in every]),
        ),
        over_all(
            "the planner's call alone, read ahead while typing",
            ("grammar, forced and guessed tokens", lambda e: e.ours.planning_s),
            (call, lambda e: e.plan.seconds),
        ),
        over_all(
            "the judge's call alone, read ahead while typing",
            ("grammar, forced and guessed tokens", lambda e: e.ours.judging_s),
            (call, lambda e: e.verdict.seconds),
        ),
        *_memory(measured),
    ]


def _memory(measured: Measured) -> list[Comparison]:
    """Return the line about memory, none where the system does not tell it."""
    ours, plain = measured.ours, measured.plain
    if ours is None or plain is None:
        return []
    return [
        compare(
            PART,
            "memory with the model",
            ("worker after plan, verdict, other plans, outcome", [ours.pss_mb]),
            ("plain: its processes after plan and verdict", [plain.pss_mb]),
            "MB",
            f"shared pages by share (PSS); resident at most: ours {ours.peak_mb:.0f} MB, "
            f"plain {plain.peak_mb:.0f} MB",
        )
    ]


async def _measured(bench: Bench) -> Measured:
    """Do every mission in every way, `bench.runs` times, after a round that is not counted.

    The missions take turns, so no way finds more of a prompt in its cache than it would in
    service.
    """
    model, missions = bench.weights, bench_missions(bench.site.world)
    engine = Engine(model)
    ours, plain = OurWay(bench.site, engine), PlainWay(model)
    try:
        bench.tell("loading the model for each way", 0.0)
        await plain.start()
        bench.tell("warming up", 0.0)
        warm = [await ours.run(mission) for mission in missions]
        await plain.answer(missions[0], warm[0], WARM_TOKENS)
        runs: list[list[Round]] = []
        for run in range(bench.runs):
            ahead: dict[int, Pair] = {}
            unread: list[tuple[Pair, PlainAnswer, PlainAnswer]] = []
            for number, mission in enumerate(missions):
                share = (run + number / len(missions)) / bench.runs
                bench.tell(f"run {run + 1} of {bench.runs}: {mission.text}", share)
                pair = await ours.run(mission)
                later = (number + AHEAD) % len(missions)
                ahead[later] = await ours.run(missions[later], read_ahead=True)
                unread.append((pair, *await plain.answer(mission, pair)))
            runs.append([Round(m.text, ahead[n], *unread[n]) for n, m in enumerate(missions)])
        await ours.ask_the_rest(missions[0])
        worker = None if engine.pid is None else process_memory(engine.pid)
        return Measured(runs, worker, plain.memory)
    finally:
        await engine.close()
        await plain.close()


def _read(pairs: Sequence[Pair]) -> str:
    """Return how much of the prompts was left to be read after Enter."""
    usages = [usage for pair in pairs for usage in (pair.plan_usage, pair.verdict_usage)]
    whole = sum(usage.prompt_tokens for usage in usages)
    read = whole - sum(usage.cached_tokens for usage in usages)
    return f"ours read {read} of {whole} prompt tokens after Enter"


def _tokens(rounds: Sequence[Round]) -> str:
    """Return what the last round of a mission read and wrote; decoding is greedy, so all did."""
    last = rounds[-1]
    usages = (last.ours.plan_usage, last.ours.verdict_usage)
    answers = (last.plan, last.verdict)
    prompt = sum(usage.prompt_tokens for usage in usages)
    cached = sum(usage.cached_tokens for usage in usages)
    written = sum(usage.completion_tokens for usage in usages)
    chosen = sum(usage.sampled_tokens for usage in usages)
    guessed = sum(usage.guessed_tokens for usage in usages)
    cut = "" if all(answer.complete for answer in answers) else ", cut off"
    return (
        f"tokens: ours read {prompt - cached} of {prompt}, wrote {written} ({chosen} chosen, "
        f"{guessed} of them guessed before); plain had {sum(a.prompt_tokens for a in answers)}, "
        f"wrote {sum(a.completion_tokens for a in answers)}{cut}"
    )
