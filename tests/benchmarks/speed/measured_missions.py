"""Missions and situations of the benchmark for any world, and our way through steps 2 to 6."""

from dataclasses import dataclass
from datetime import UTC, datetime
from time import perf_counter

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.llm.local.engine import Engine
from pa_console.llm.roles.prompts import plan_facts
from pa_console.mission.context import MissionContext, Services
from pa_console.mission.judge import judge
from pa_console.mission.plan import Candidate, PlanningFailure, plan, take
from pa_console.mission.planning.propose import PlanQuestion, ask_for_plan
from pa_console.mission.retrieve import RetrievedRules, retrieve
from pa_console.mission.verify import OutcomeCase, ask_about_outcome
from pa_console.policy.monitor import Monitor
from pa_console.policy.retriever import Retriever
from pa_console.schema.evaluation import Variant
from pa_console.schema.events.event import (
    EventPayload,
    PlanJudged,
    PlanProposed,
    PromptBuilt,
)
from pa_console.schema.finding import Usage
from pa_console.schema.incident import SetBattery, SpawnTrack
from pa_console.schema.mission import Mission, Verification
from pa_console.schema.plan import Action, Plan
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from pa_console.station.assembly import Site
from pa_console.station.headless import SETUP_SETTLE_S
from pa_console.station.live_reading import ReadAhead

TRACK_AT_M = 40.0
LOW_PCT = 12.0


def busy_checkpoint(world: World) -> Checkpoint:
    """Return a checkpoint with an asset low on battery and, given a lane, a vehicle in sight."""
    sim = Checkpoint(world)
    sim.inject(SetBattery(asset=next(iter(world.assets)), percent=LOW_PCT))
    bring_vehicle(sim)
    return sim


def bring_vehicle(sim: Checkpoint) -> str | None:
    """Let an unknown vehicle come up the first lane until sensors have seen it; return its gate."""
    lane = next(iter(sim.world.lanes.values()), None)
    if lane is None:
        return None
    sim.inject(SpawnTrack(gate=lane.gate, distance_m=TRACK_AT_M))
    for _ in range(round(SETUP_SETTLE_S / sim.world.dt_s)):
        sim.step()
    return lane.gate


def gathering(world: World) -> Plan:
    """Send every asset that stands elsewhere to the first gate: a plan with much movement."""
    gate = world.gates[0]
    movers = [name for name, spec in world.assets.items() if spec.post != gate]
    actions = tuple(Action(agent=name, command=f"move_to {gate}") for name in movers[:64])
    return Plan(reason="everybody goes to one gate", actions=actions)


@dataclass(frozen=True)
class Pair:
    """What our way made of one mission: its two prompts, what they cost, and the wall time."""

    planner: PromptBuilt
    judge: PromptBuilt
    judged_rules: tuple[str, ...]
    judged_plan: str
    """What the verdict is about, in words: not every judge's prompt tells it."""
    planning_s: float
    judging_s: float
    seconds: float
    plan_usage: Usage
    verdict_usage: Usage
    usable: int
    """How many of the two answers could be read: 0, 1 or 2."""


@dataclass(frozen=True)
class BenchMission:
    """A mission in a checkpoint of its own, which nobody steps any more."""

    text: str
    sim: Checkpoint


def bench_missions(world: World) -> list[BenchMission]:
    """Return a few different missions for `world`; one is about a vehicle, if there is a lane.

    In each another asset is low on battery: no prompt tells the same picture as the one before.
    """
    gates = world.gates
    texts = [
        f"We need eyes in the air over {gates[0]}, take whatever drone you can spare.",
        f"Put one more vehicle at {gates[-1]} before the shift ends.",
        "How do things stand with the team right now?",
    ]
    sims = [Checkpoint(world) for _ in range(len(texts) + 1)]
    for sim, asset in zip(sims, reversed(world.assets), strict=False):
        sim.inject(SetBattery(asset=asset, percent=LOW_PCT))
        for _ in range(round(SETUP_SETTLE_S / world.dt_s)):
            sim.step()
    *plain, sim = sims
    missions = [BenchMission(text, one) for text, one in zip(texts, plain, strict=True)]
    gate = bring_vehicle(sim)
    if gate is not None:
        text = f"There is something on the road to {gate}: find out who that is."
        missions.append(BenchMission(text, sim))
    return missions


class OurWay:
    """Retrieves, digests, plans, checks, rehearses and judges with the model of `engine`.

    Nothing is repaired: one plan, one verdict. When there is no plan that the judge could be
    asked about, the verdict is on a harmless one, so that every mission costs two calls.
    """

    def __init__(self, site: Site, engine: Engine) -> None:
        self._site, self._engine = site, engine
        self._retriever = Retriever(site.rulebook.rules)

    async def run(self, mission: BenchMission, *, read_ahead: bool = False) -> Pair:
        """Return what became of `mission`; raises ValueError when the judge could not be asked.

        With `read_ahead`, time runs from when the model has read the picture and all words but the
        last one, as it has in the console for an operator who typed the mission.
        """
        services, events = self._services(mission.sim), list[EventPayload]()
        monitor = Monitor(self._site.rulebook, self._site.world)
        task = _task(mission)
        context = MissionContext(services, task, events.append, monitor)
        if read_ahead:
            await ReadAhead(services).read_now(mission.text)
        started = perf_counter()
        best = await self._best(context)
        seconds = perf_counter() - started
        watch = context.stopwatch
        prompts = {event.role: event for event in events if isinstance(event, PromptBuilt)}
        proposed = next(e for e in events if isinstance(e, PlanProposed) and e.author == "planner")
        judged = next((event for event in events if isinstance(event, PlanJudged)), None)
        if judged is None or "judge" not in prompts:
            raise ValueError(
                f"{self._site.world.name}: not even a report can be judged under these rules; "
                f"measure another world, or other parts with --only"
            )
        opinions = judged.verdict.rules if judged.verdict is not None else ()
        return Pair(
            planner=prompts["planner"],
            judge=prompts["judge"],
            judged_rules=tuple(opinion.rule_id for opinion in opinions),
            judged_plan=plan_facts(self._site.world, best.examination.plan),
            planning_s=watch.seconds["planning_s"],
            judging_s=watch.seconds["judging_s"],
            seconds=seconds,
            plan_usage=proposed.usage,
            verdict_usage=judged.usage,
            usable=(proposed.plan is not None) + (judged.verdict is not None),
        )

    def question(self, mission: BenchMission) -> PlanQuestion:
        """Return what the planner is asked."""
        hits = self._retriever.retrieve(mission.text)
        return ask_for_plan(self._services(mission.sim), RetrievedRules(_task(mission), hits))

    async def ask_the_rest(self, mission: BenchMission) -> None:
        """Ask what else a mission may need: other plans at once, and a verdict on the outcome."""
        services, question = self._services(mission.sim), self.question(mission)
        count = services.variant.candidates - 1
        await services.planner.several(question.prompt, question.grammar, count)
        done = Verification(outcome="pass", actions=())
        picture = mission.sim.picture()
        case = OutcomeCase(_task(mission), picture, picture, None, _report(self._site.world), done)
        await services.judge.judge(
            ask_about_outcome(services.prompt_format, self._site.world, case)
        )

    def _services(self, sim: Checkpoint) -> Services:
        variant = Variant(repairs=0, workflows=False)
        return Services.open(
            SimulatedFleet(sim),
            self._site.rulebook,
            self._engine,
            variant,
            retriever=self._retriever,
        )

    async def _best(self, context: MissionContext) -> Candidate:
        """Return the plan that comes of steps 2 to 6, a report where the planner's is blocked."""
        planned = await plan(context, retrieve(context, context.mission))
        if isinstance(planned, PlanningFailure) or planned.best.examination.blocked:
            planned = await take(context, planned.answered, _report(self._site.world))
        return (await judge(context, planned)).best


def _task(mission: BenchMission) -> Mission:
    return Mission(id="bench", text=mission.text, created=datetime.now(UTC))


def _report(world: World) -> Plan:
    agent = next(iter(world.assets))
    return Plan(reason="a report", actions=(Action(agent=agent, command="report"),))
