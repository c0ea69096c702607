"""Steps 2 to 6 of a mission: from its words to a plan that was checked, rehearsed and judged."""

from collections.abc import Sequence

from pa_console.orchestrator.mission.services import Payloads, Services, Stopwatch
from pa_console.orchestrator.planning.candidate import Candidate, fulfilment_of
from pa_console.orchestrator.planning.judging import PlanCase, judge_plan
from pa_console.orchestrator.planning.proposal import Proposing
from pa_console.orchestrator.planning.safeguards import Examination, examine
from pa_console.orders.mention_check import NOTHING_SAID, MentionCheck, check_mentions
from pa_console.orders.reading import Reading, asked_words, read_asked, read_reason
from pa_console.policy.ordering.monitor import Monitor
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Plan, Verb
from pa_console.schema.telemetry import Selection

MOST_SERVED = 6
"""Plans of which the console gives the commands, at most, where the ones before are blocked."""


class Planning:
    """Makes and examines plans for one mission; `best` is the one to decide on."""

    def __init__(
        self, services: Services, mission: Mission, stopwatch: Stopwatch, monitor: Monitor
    ) -> None:
        """`monitor` has followed the mission's history so far; it is only read."""
        self._services, self._watch, self._monitor = services, stopwatch, monitor
        self._proposing = Proposing(services, mission, stopwatch)
        self._reading: Reading | None = None
        self.best: Candidate | None = None
        self.error = ""
        """Why there is no `best`."""

    @property
    def task(self) -> Mission:
        """What the next plan is for: the mission itself, or a phase of its workflow."""
        return self._proposing.task

    @property
    def attempts(self) -> int:
        """Plans so far: answers of the planner and plans of the operator."""
        return self._proposing.attempts

    @property
    def rule_ids(self) -> tuple[str, ...]:
        """Ids of the rules that were retrieved for the task."""
        return tuple(hit.rule_id for hit in self._proposing.hits)

    @property
    def selection(self) -> Selection | None:
        """The part of the picture that the last prompt spoke of; None means all of it."""
        return self._proposing.selection

    @property
    def said(self) -> str:
        """What was asked: as the operator says, or else the planner; '' without that."""
        return self._proposing.said

    @property
    def chosen(self) -> str:
        """What the operator says that the task asks; '' where the planner was to read it."""
        return self._proposing.chosen

    @property
    def sure(self) -> float | None:
        """How sure planner and judge of `best` were of what was asked; None: they did not tell."""
        if self.best is None:
            return None
        told = self._told(self.best)
        return min((sure for sure in told if sure is not None), default=None)

    @property
    def agreed(self) -> float | None:
        """The same, None where not both of them have read the order for themselves.

        It is less where the words of the order and its reading do not match.
        """
        if self.best is None or None in self._told(self.best):
            return None
        return ev.told_confidence(self.sure, self.best.mentions.gaps)

    async def retrieve(self, task: Mission, verbs: Sequence[Verb] = ()) -> Payloads:
        """Step 2: the rules that concern the words of `task`, and the pinned ones.

        With `verbs`, the planner is given no other commands for it.
        """
        async for payload in self._proposing.retrieve(task, verbs):
            yield payload

    async def propose(self, reasons: Sequence[str] = (), previous: str = "") -> Payloads:
        """Steps 3 to 6: ask for a plan until nothing blocks it, at most 1 + repairs times.

        `reasons` say what was wrong with the `previous` plan. The least bad plan becomes `best`;
        a mere warning is for the operator to acknowledge.
        """
        self.best, self.error, self._reading = None, "", None
        seen: set[Plan] = set()
        for last in [False] * self._services.variant.repairs + [True]:
            async for payload in self._proposing.ask(reasons, previous):
                yield payload
            proposal = self._proposing.latest
            answer = proposal.text
            if proposal.plan is None:
                self.error = proposal.error
                if proposal.fatal:
                    return
                reasons = (proposal.error,)
            else:
                if self._services.variant.fitting:
                    self._reading = self._reading or self._read(proposal.plan)
                async for payload in self._examine(self.attempts, proposal.plan):
                    yield payload
                sent_back = self._latest
                if not self._sound and not seen:
                    async for payload in self._first_sound():
                        yield payload
                if self.best is not None and self.best.attempt > sent_back.attempt:
                    sent_back = self.best
                reasons = () if self._admissible else sent_back.examination.faults
                answer = sent_back.examination.plan.answer
            repeated = proposal.plan in seen
            if not reasons or last or repeated:
                return
            if proposal.plan is not None:
                seen.add(proposal.plan)
            previous = answer
            yield ev.RepairRequested(attempt=self.attempts, reasons=tuple(reasons))

    async def plan_for(self, asked: str) -> Payloads:
        """Steps 3 to 6 for what the operator says was `asked`."""
        self._proposing.chosen = asked
        async for payload in self.propose():
            yield payload

    async def other_readings(self, count: int) -> list[str]:
        """Return what else the planner might have said was asked, of `count` ways to say it."""
        return await self._proposing.other_readings(count)

    async def take(self, plan: Plan) -> Payloads:
        """Step 6 for a plan that the operator wrote: it is examined like any other."""
        self.best = self._reading = None
        async for payload in self._proposing.take(plan):
            yield payload
        async for payload in self._examine(self.attempts, plan, own=True):
            yield payload

    async def judge(self) -> Payloads:
        """Step 6: the JudgeLLM's verdict on `best`; a blocked plan needs none.

        A trained judge reads the order for itself. Where it objects and its reading is the likelier
        one, a plan that serves that becomes `best`, if nothing blocks it and the judge passes it.
        """
        async for payload in self._judge():
            yield payload
        first = self.best
        sure = self._proposing.confidence.get(first.attempt) if first is not None else None
        asked = first.second_reading(sure) if first is not None else ""
        if not asked or not self._services.variant.second_reading:
            return
        self._reading = read_asked(asked)
        async for payload in self._ask_who(asked, as_judged=True):
            yield payload
        if self.best is not first:
            async for payload in self._judge():
                yield payload
        if self.best is not None and self.best.objected:
            self.best = first

    async def reexamine(self) -> Examination | None:
        """Examine `best` in the present state; None when it may still be executed."""
        if self.best is None:
            return None
        plan = self.best.examination.plan
        fresh = await self._safeguards(plan)
        return fresh if fresh.blocked else None

    @property
    def _admissible(self) -> bool:
        """Whether nothing blocks `best`."""
        return self.best is not None and not self.best.examination.blocked

    @property
    def _sound(self) -> bool:
        """Whether `best` is what the planner says was asked, and nothing blocks it."""
        return self.best is not None and not any(self.best.badness[:2])

    async def _first_sound(self) -> Payloads:
        """Examine the planner's other answers until one is sound; the best of them becomes `best`.

        Where the console can read what its first answer says was asked, the others say the same of
        it; with none of them sound, it is given the commands and says who has them.
        """
        reading = self._reading if self._reading is not None and self._reading.readable else None
        async for payload in self._proposing.ask_for_others(as_asked=reading is not None):
            yield payload
        while not self._sound and self._proposing.others:
            async for payload in self._examine(*self._proposing.others.pop(0)):
                yield payload
        if reading is not None and not self._sound:
            async for payload in self._ask_who(self._proposing.said):
                yield payload

    async def _ask_who(self, asked: str, *, as_judged: bool = False) -> Payloads:
        """Examine plans for what was `asked` of which the console gives the commands.

        They serve less and less of it, until nothing blocks one. A sound one becomes `best`, where
        that is a plan for another reading too.
        """
        for slots in await self._proposing.served(asked, MOST_SERVED):
            async for payload in self._proposing.ask_who(asked, slots, as_judged=as_judged):
                yield payload
            for other in self._proposing.others or ():
                async for payload in self._examine(*other):
                    yield payload
                if not any(self._latest.badness[:2]):
                    self.best = self._latest
                if not self._latest.examination.blocked:
                    return

    async def _judge(self) -> Payloads:
        candidate, question = self.best, self._proposing.question
        if candidate is None or candidate.examination.blocked or not self._services.variant.judging:
            return
        found = candidate.examination
        if question is None or found.rehearsal is None:
            return
        case = PlanCase(
            self.task,
            self._proposing.hits,
            question.digest,
            found.plan,
            found.findings,
            found.rehearsal,
            question.asked,
        )
        async for payload in judge_plan(self._services, self._watch, case, candidate):
            yield payload

    def _read(self, plan: Plan) -> Reading | None:
        """Return what was asked, as far as the console can read it."""
        if self._proposing.question is not None and self._proposing.question.asked:
            return read_asked(self._proposing.question.asked)
        return read_reason(plan.reason)

    def _told(self, shown: Candidate) -> tuple[float | None, float | None]:
        return self._proposing.confidence.get(shown.attempt), shown.judge_confidence

    async def _examine(self, attempt: int, plan: Plan, *, own: bool = False) -> Payloads:
        """Examine `plan`; what an operator's `own` is for is not read from the order."""
        found = await self._safeguards(plan)
        fits = fulfilment_of(found, self._reading, self._services.fleet.world)
        read = not own and not self.chosen
        mentions = self._mentions(found, fits.unmet) if read else NOTHING_SAID
        self._latest = candidate = Candidate(attempt, found, fits.gaps, fits.unmet, mentions)
        if found.rehearsal is not None and self._services.variant.rehearsal:
            yield ev.PlanRehearsed(
                attempt=attempt, rehearsal=found.rehearsal, seconds=found.rehearsal_s
            )
        yield ev.PlanChecked(
            attempt=attempt,
            findings=found.findings,
            seconds=found.checks_s,
            unmet=fits.unmet,
            gaps=mentions.gaps,
        )
        if self.best is None or candidate.badness < self.best.badness:
            self.best = candidate

    def _mentions(self, found: Examination, unmet: Sequence[str]) -> MentionCheck:
        """Compare the words of the task with what the plan says was asked."""
        fleet, plan = self._services.fleet, found.plan
        before = found.rehearsal.before if found.rehearsal is not None else fleet.picture()
        asked = asked_words(plan.reason).rstrip("; ")
        return check_mentions(fleet.world, before, self.task.text, asked, plan, unmet)

    async def _safeguards(self, plan: Plan) -> Examination:
        services = self._services
        found = await examine(
            plan, self.task, services.fleet, services.rulebook, self._monitor, services.variant
        )
        self._watch.add("checks_s", found.checks_s)
        self._watch.add("rehearsal_s", found.rehearsal_s)
        return found
