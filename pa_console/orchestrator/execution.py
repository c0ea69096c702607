"""Step 7 of a mission: dispatch, follow to the end, verify by telemetry, judge the outcome."""

from time import perf_counter

from pa_console.llm.grammar import judge_grammar
from pa_console.llm.prompts import outcome_prompt
from pa_console.orchestrator.digest import digest_picture
from pa_console.orchestrator.dispatch import Dispatch
from pa_console.orchestrator.feed import StepFeed
from pa_console.orchestrator.rehearsal import device_commands
from pa_console.orchestrator.safeguards import Examination
from pa_console.orchestrator.services import Payloads, Services, Stopwatch
from pa_console.orchestrator.verification import verify_plan
from pa_console.schema import event as ev
from pa_console.schema.command import DeviceCommand
from pa_console.schema.mission import Mission, Verification

MARGIN_S = 20.0
SETTLE_S = 1.0


class Execution:
    """Carries out one approved plan; `verification` is what telemetry said of it."""

    def __init__(
        self, services: Services, mission: Mission, stopwatch: Stopwatch, feed: StepFeed
    ) -> None:
        self._services, self._mission, self._watch = services, mission, stopwatch
        self._feed = feed
        self._dispatch: Dispatch | None = None
        self.verification: Verification | None = None

    @property
    def under_way(self) -> tuple[str, ...]:
        """The agents that are still carrying out a command of the plan."""
        return self._dispatch.open_agents if self._dispatch is not None else ()

    async def run(self, approved: Examination, attempt: int) -> Payloads:
        """Step 7: send every command, follow it to its end, then compare with telemetry."""
        sim = self._services.sim
        before = sim.picture()
        limit_s = MARGIN_S
        if approved.rehearsal is not None:
            limit_s += 2 * approved.rehearsal.timeline.duration_s
        commands = device_commands(approved.plan, f"{self._mission.id}.{attempt}")
        start = sim.time_s
        with self._feed.follow() as steps:
            self._dispatch = Dispatch(commands, sim.tick, sim.world.dt_s, limit_s)
            with self._watch.time("dispatch_s"):
                for command in commands:
                    sim.send(command)
                    yield ev.CommandSent(command=command)
            settle = round(SETTLE_S / sim.world.dt_s)
            async for tick, replies in steps:
                for reply in self._dispatch.advance(tick, replies):
                    yield ev.CommandReplied(reply=reply)
                if self._dispatch.finished:
                    settle -= 1
                    if settle <= 0:
                        break
        self._watch.add("execution_s", sim.time_s - start)
        started = perf_counter()
        self.verification = verify_plan(
            approved.plan, sim.world, before, sim.picture(), self._dispatch.final
        )
        yield ev.MissionVerified(verification=self.verification, seconds=perf_counter() - started)

    async def judge_outcome(self, approved: Examination) -> Payloads:
        """Step 7: the JudgeLLM says from telemetry whether the mission was accomplished."""
        if self.verification is None:
            return
        sim = self._services.sim
        digest = digest_picture(sim.picture(), sim.world)
        prompt = outcome_prompt(sim.world, digest, self._mission, approved.plan, self.verification)
        with self._watch.time("outcome_s"):
            async for piece in self._services.judge.judge(prompt, judge_grammar([])):
                if not isinstance(piece, str):
                    yield ev.OutcomeJudged(
                        verdict=piece.verdict, error=piece.error, usage=piece.usage
                    )

    def halt(self, number: int) -> tuple[DeviceCommand, ...]:
        """Tell every agent still under way to hold; return the commands sent."""
        commands = tuple(
            DeviceCommand(
                command_id=f"{self._mission.id}.halt{number}.{index}", agent=agent, verb="hold"
            )
            for index, agent in enumerate(self.under_way, start=1)
        )
        for command in commands:
            self._services.sim.send(command)
        return commands
