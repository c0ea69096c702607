"""Steps 8 and 9 for a plan in steps: each step is executed and verified before the next is sent.

A waiting step is examined again when its turn comes. If an action fails or cannot be verified, the
actions that depend on it are never sent, and an event names them.
"""

import asyncio
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import accumulate

from pa_console.mission.context import MissionContext, MissionResult
from pa_console.mission.decide import ApprovedPlan
from pa_console.mission.execute import ApprovedStep, Execution
from pa_console.mission.outcome import Results
from pa_console.mission.plan import safeguards
from pa_console.mission.report import PlanFacts, ReportFacts
from pa_console.mission.verify import verify
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Mission, MissionStatus, Verification
from pa_console.schema.plan import Plan


@dataclass
class StepByStep:
    """The execution of an `approved` plan in steps, which is recorded in `facts` for the report."""

    context: MissionContext
    execution: Execution
    approved: ApprovedPlan
    task: Mission
    results: Results
    facts: ReportFacts
    goes_on: asyncio.Event
    """Set while the next step may be sent; cleared while an operator has paused the plan."""
    done: int = 0
    """The number of steps from the first on that telemetry has verified without a gap."""
    _held: frozenset[int] = frozenset()

    @property
    def _plan(self) -> Plan:
        return self.approved.planned.best.examination.plan

    @property
    def orders_done(self) -> int:
        """The number of the order's steps that are done; one may be several steps of the plan."""
        steps = self.approved.planned.steps
        counts = accumulate(len(step.best.examination.plan.steps) for step in steps)
        return sum(count <= self.done for count in counts) if steps else self.done

    async def run(self) -> MissionResult | None:
        """Carry out the plan; return None if all steps are verified, otherwise a result."""
        lacks: list[MissionResult] = []
        for position, numbers in enumerate(self._plan.steps, start=1):
            if due := tuple(number for number in numbers if number not in self._held):
                await self.goes_on.wait()
                lacking = await self._step(position, due)
                lacks += [lacking] if lacking is not None else []
                self.done += not lacks
        self.context.services.gate.finish()
        if not lacks:
            return None
        return MissionResult(lacks[-1].status, "; ".join(result.reason for result in lacks))

    def _left(self, position: int) -> frozenset[int]:
        """Return the numbers of the actions of all steps after the one at `position`."""
        return frozenset(number for step in self._plan.steps[position:] for number in step)

    async def _step(self, position: int, due: tuple[int, ...]) -> MissionResult | None:
        """Check, execute and verify the actions `due`; return a result unless all are verified."""
        context, count = self.context, len(self._plan.steps)
        part = self._plan.part(due)
        facts = PlanFacts(
            self._plan if position == 1 else part,
            self.task.text,
            decision=self.approved.decided.decision,
            unmet=self.approved.planned.best.unmet,
            step=position,
            steps=count,
        )
        examination = await safeguards(context, self.task, part)
        if examination.blocked:
            faults = "; ".join(examination.faults)
            why = f"step {position} of {count} would break a rule now: {faults}"
            self.facts.plans.append(replace(facts, held=why))
            return self._hold(self._left(position - 1), why, "held")
        step = ApprovedStep(
            examination, self.approved.decided.request, due, goes_on=bool(self._left(position))
        )
        self.facts.plans.append(facts)
        facts.halted = ("interrupted before its end",)
        executed = await self.execution.run(step)
        facts.halted = executed.halted
        if executed.halted:
            why = f"step {position} of {count} was halted: {'; '.join(executed.halted)}"
            return self._hold(self._left(position), why, "unverified", facts)
        facts.verification = verification = verify(context, part, executed, position)
        self.results.verifications.append(verification)
        passed = _passed(due, verification)
        context.services.gate.verified(passed)
        if lacking := [number for number in due if number not in passed]:
            after = self._plan.depends_on(lacking) if passed else self._left(position)
            why = f"step {position} of {count} is not verified: {verification.reason}"
            return self._hold(after & self._left(position), why, "unverified", facts)
        if self._left(position) - self._held and (stay_s := _stay_s(step)):
            await self.execution.stay(stay_s)
        return None

    def _hold(
        self,
        numbers: Iterable[int],
        why: str,
        status: MissionStatus,
        facts: PlanFacts | None = None,
    ) -> MissionResult:
        """Exclude the actions `numbers` from execution, and emit an event that names them."""
        new = sorted({*numbers} - self._held)
        self._held |= {*new}
        actions = [self._plan.actions[number - 1] for number in new]
        orders = tuple(f"{action.agent} {action.command}" for action in actions)
        if not orders:
            return MissionResult(status, why)
        self.context.emit(
            ev.StepsHeld(attempt=self.approved.decided.request.attempt, orders=orders, reason=why)
        )
        if facts is not None:
            facts.held = "; ".join(orders)
        return MissionResult(status, f"{why}; not sent: {'; '.join(orders)}")


def _passed(due: tuple[int, ...], seen: Verification) -> frozenset[int]:
    """Return the numbers of the verified actions; none if a gate has lost its known cover."""
    if seen.gates_lost or seen.gates_unknown:
        return frozenset()
    outcomes = zip(due, seen.actions, strict=True)
    return frozenset(number for number, outcome in outcomes if outcome.outcome == "pass")


def _stay_s(step: ApprovedStep) -> float:
    return max(action.stay_s for action in step.examination.plan.actions)
