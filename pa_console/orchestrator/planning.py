"""Steps 2 to 6 of a mission: from its words to a plan that was checked, rehearsed and judged."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from time import perf_counter

from pa_console.llm.judge import Judgement
from pa_console.llm.planner import Proposal
from pa_console.orchestrator.judging import PlanCase, ask_about_plan
from pa_console.orchestrator.question import Question, ask_for_plan
from pa_console.orchestrator.safeguards import Examination, examine
from pa_console.orchestrator.services import Payloads, Services, Stopwatch
from pa_console.policy.monitor import Monitor
from pa_console.schema import event as ev
from pa_console.schema.finding import Usage, Verdict
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Plan, Verb
from pa_console.schema.rule import RuleHit
from pa_console.schema.telemetry import Selection


@dataclass
class Candidate:
    """A plan that went through the safeguards, and the judge's answer once there is one."""

    attempt: int
    examination: Examination
    verdict: Verdict | None = None
    judge_error: str = ""


class Planning:
    """Makes and examines plans for one mission; `best` is the one to decide on.

    `task` is what the next plan is for: the mission itself, or a phase of its workflow.
    """

    def __init__(
        self, services: Services, mission: Mission, stopwatch: Stopwatch, monitor: Monitor
    ) -> None:
        """`monitor` has followed the mission's history so far; it is only read."""
        self._services, self._watch, self._monitor = services, stopwatch, monitor
        self.task = mission
        self._verbs: Sequence[Verb] = ()
        self._hits: tuple[RuleHit, ...] = ()
        self._question: Question | None = None
        self.attempts = 0
        self.best: Candidate | None = None
        self.error = ""
        """Why there is no `best`."""

    @property
    def rule_ids(self) -> tuple[str, ...]:
        """Ids of the rules that were retrieved for the task."""
        return tuple(hit.rule_id for hit in self._hits)

    @property
    def selection(self) -> Selection | None:
        """The part of the picture that the last prompt spoke of; None means all of it."""
        return self._question.digest.selection if self._question is not None else None

    async def retrieve(self, task: Mission, verbs: Sequence[Verb] = ()) -> Payloads:
        """Step 2: the rules that concern the words of `task`, and the pinned ones.

        With `verbs`, the planner is given no other commands for it.
        """
        self.task, self._verbs = task, verbs
        started = perf_counter()
        retriever = self._services.retriever
        self._hits = self._retrieved(task.text)
        seconds = perf_counter() - started
        self._watch.add("retrieval_s", seconds)
        yield ev.RulesRetrieved(method=retriever.method, hits=self._hits, seconds=seconds)

    async def propose(self, reasons: Sequence[str] = (), previous: str = "") -> Payloads:
        """Steps 3 to 6: ask for a plan until nothing blocks it, at most 1 + repairs times.

        `reasons` say what was wrong with the `previous` plan. The least bad plan becomes `best`;
        a mere warning is for the operator to acknowledge.
        """
        self.best, self.error = None, ""
        seen: set[Plan] = set()
        for last in [False] * self._services.variant.repairs + [True]:
            async for payload in self._ask(reasons, previous):
                yield payload
            proposal = self._proposal
            if proposal.plan is None:
                self.error = proposal.error
                if proposal.fatal:
                    return
                reasons = (proposal.error,)
            else:
                async for payload in self._examine(proposal.plan):
                    yield payload
                if self._latest.blocked and not seen:
                    async for payload in self._ask_again():
                        yield payload
                reasons = self._latest.faults
            repeated = proposal.plan in seen
            if not reasons or last or repeated:
                return
            if proposal.plan is not None:
                seen.add(proposal.plan)
            previous = proposal.text
            yield ev.RepairRequested(attempt=self.attempts, reasons=tuple(reasons))

    async def take(self, plan: Plan) -> Payloads:
        """Step 6 for a plan that the operator wrote: it is examined like any other."""
        self.attempts += 1
        self.best = None
        text = plan.model_dump_json()
        yield ev.PlanProposed(attempt=self.attempts, author="operator", text=text, plan=plan)
        async for payload in self._examine(plan):
            yield payload

    async def judge(self) -> Payloads:
        """Step 6: the JudgeLLM's verdict on `best`; a blocked plan needs none."""
        candidate = self.best
        if candidate is None or candidate.examination.blocked or not self._services.variant.judging:
            return
        rehearsal = candidate.examination.rehearsal
        if self._question is None or rehearsal is None:
            return
        found = candidate.examination
        started = perf_counter()
        asked = ask_about_plan(
            self._services.dialect,
            self._services.sim.world,
            self._services.rulebook,
            PlanCase(
                self.task, self._hits, self._question.digest, found.plan, found.findings, rehearsal
            ),
        )
        yield ev.PromptBuilt(
            role="judge",
            attempt=candidate.attempt,
            system=asked.prompt.system,
            user=asked.prompt.user,
            seconds=perf_counter() - started,
        )
        with self._watch.time("judging_s"):
            async for piece in asked.put_to(self._services.judge):
                if isinstance(piece, str):
                    yield ev.TextStreamed(role="judge", attempt=candidate.attempt, text=piece)
                else:
                    candidate.verdict, candidate.judge_error = piece.verdict, piece.error
                    yield _judged(candidate.attempt, piece)

    async def reexamine(self) -> Examination | None:
        """Examine `best` in the present state; None when it may still be executed."""
        if self.best is None:
            return None
        plan = self.best.examination.plan
        fresh = await self._safeguards(plan)
        return fresh if fresh.blocked else None

    async def _ask(self, reasons: Sequence[str], previous: str) -> Payloads:
        """Steps 3 to 5, once."""
        self.attempts += 1
        services = self._services
        rules = [services.rulebook.get(hit.rule_id) for hit in self._hits]
        self._question = asked = ask_for_plan(
            services, self.task, rules, self._verbs, reasons, previous
        )
        self._watch.add("picture_s", asked.picture_s)
        self._watch.add("prompt_s", asked.prompt_s)
        yield ev.PictureDigested(digest=asked.digest, seconds=asked.picture_s)
        yield ev.PromptBuilt(
            role="planner",
            attempt=self.attempts,
            system=asked.prompt.system,
            user=asked.prompt.user,
            seconds=asked.prompt_s,
        )
        with self._watch.time("planning_s"):
            async for piece in services.planner.plan(asked.prompt, asked.grammar):
                if isinstance(piece, str):
                    yield ev.TextStreamed(role="planner", attempt=self.attempts, text=piece)
                else:
                    self._proposal = piece
                    yield _proposed(self.attempts, piece)
        if self.attempts == 1:
            self._watch.add("first_token_s", self._proposal.usage.first_token_s)

    async def _ask_again(self) -> Payloads:
        """Step 5 once more, several answers at once: the first sound one is looked for.

        The model gave them in the order of how often it did. All are told, and examined until one
        nothing blocks.
        """
        asked, count = self._question, self._services.variant.candidates - 1
        if asked is None or count < 1:
            return
        first = self.attempts
        with self._watch.time("planning_s"):
            others, usage = await self._services.planner.several(asked.prompt, asked.grammar, count)
        for proposal in others:
            self.attempts += 1
            given = replace(proposal, usage=usage if self.attempts == first + 1 else Usage())
            yield _proposed(self.attempts, given, instead_of=first)
            if self._latest.blocked and proposal.plan is not None:
                async for payload in self._examine(proposal.plan):
                    yield payload

    async def _examine(self, plan: Plan) -> Payloads:
        found = await self._safeguards(plan)
        self._latest = found
        if found.rehearsal is not None and self._services.variant.rehearsal:
            yield ev.PlanRehearsed(
                attempt=self.attempts, rehearsal=found.rehearsal, seconds=found.rehearsal_s
            )
        yield ev.PlanChecked(attempt=self.attempts, findings=found.findings, seconds=found.checks_s)
        if self.best is None or found.badness < self.best.examination.badness:
            self.best = Candidate(self.attempts, found)

    def _retrieved(self, text: str) -> tuple[RuleHit, ...]:
        """Return the rules for the prompt: pinned ones, best ones, or both, by variant."""
        retriever, variant = self._services.retriever, self._services.variant
        top_k = self._services.top_k if variant.retrieval else 0
        if variant.pinned:
            return retriever.retrieve(text, top_k)
        best = retriever.score_all(text)[:top_k]
        return tuple(hit.model_copy(update={"pinned": False}) for hit in best)

    async def _safeguards(self, plan: Plan) -> Examination:
        services = self._services
        found = await examine(
            plan, self.task, services.sim, services.rulebook, self._monitor, services.variant
        )
        self._watch.add("checks_s", found.checks_s)
        self._watch.add("rehearsal_s", found.rehearsal_s)
        return found


def _proposed(attempt: int, proposal: Proposal, instead_of: int | None = None) -> ev.PlanProposed:
    return ev.PlanProposed(
        attempt=attempt,
        text=proposal.text,
        plan=proposal.plan,
        error=proposal.error,
        usage=proposal.usage,
        instead_of=instead_of,
    )


def _judged(attempt: int, judgement: Judgement) -> ev.PlanJudged:
    return ev.PlanJudged(
        attempt=attempt,
        verdict=judgement.verdict,
        error=judgement.error,
        usage=judgement.usage,
    )
