"""The processes of the plain way: a `Llama` for every adapter, asked for a plan, then a verdict."""

from typing import Self

from pa_console.llm.models.catalogue import LocalModel
from pa_console.llm.roles.role_model import PROMPT_FORMATS
from pa_console.schema.events.event import Role
from tests.benchmarks.speed.child import Child, LoadWeights
from tests.benchmarks.speed.measured_missions import BenchMission, Pair
from tests.benchmarks.speed.memory import Memory, process_memory
from tests.benchmarks.speed.messages import (
    PlainAnswer,
    PlainAsk,
    plan_schema,
    verdict_schema,
)

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
        """What all processes take together; None where the system does not tell."""
        found = [process_memory(child.pid) for child in self._children.values()]
        known = [one for one in found if one is not None]
        if len(known) < len(found):
            return None
        return Memory(sum(one.pss_mb for one in known), sum(one.peak_mb for one in known))

    async def close(self) -> None:
        """End every process."""
        for child in self._children.values():
            await child.close()

    async def _ask(self, role: Role, ask: PlainAsk) -> PlainAnswer:
        return await self._children[self._adapters[role]].ask(ask, PlainAnswer)
