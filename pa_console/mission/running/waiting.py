"""A plan that waits for the operator and is rehearsed again when the picture changes."""

import asyncio
from collections.abc import Iterable
from dataclasses import replace
from math import dist

from pa_console.mission.context import MissionContext
from pa_console.mission.decide import AdmissibleDecision, Decide, Readings, decide
from pa_console.mission.examine import Examination
from pa_console.mission.plan import Candidate, PlanForDecision, safeguards
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Decision, Mission
from pa_console.schema.plan import Plan
from pa_console.schema.telemetry import Picture

DRIFT_PCT = 3.0
"""The change of an agent's charge that makes a rehearsal outdated, in percentage points."""
DRIFT_M = 10.0
"""The change of an agent's position that makes a rehearsal outdated, in metres."""
AT_ONCE_S, LEAST_S, MOST_S = 2.0, 5.0, 60.0
"""The shortest time between two rehearsals, in seconds: after a sudden change, after a drift of a
new plan's agents, and after a drift once the plan has waited long."""


class _PlanChangedError(Exception):
    """A change of the set of rules that the waiting plan breaks."""

    def __init__(self, examination: Examination) -> None:
        super().__init__("; ".join(examination.broken))
        self.examination = examination


class WaitingPlan:
    """A plan that waits for a decision, and is examined again if the picture changes enough."""

    def __init__(self, context: MissionContext, task: Mission, shown: Candidate) -> None:
        """Begin to wait with the plan `shown` to the operator for `task`."""
        self._context, self._task, self._shown = context, task, shown
        self.examination = shown.examination
        """The last examination of the plan."""
        rehearsal = self.examination.rehearsal
        self._examined_picture = rehearsal.before if rehearsal else context.services.fleet.picture()
        """The picture at the start of the last examination."""
        self._since_s = self._examined_picture.time_s
        self._due = asyncio.Event()

    def see(self, picture: Picture) -> None:
        """Request another examination of the plan if the picture has changed enough."""
        if self._drifted(picture) or self._sudden(picture):
            self._due.set()

    def _sudden(self, picture: Picture) -> bool:
        """Return whether a gate, a track, the weather or the state of an agent has changed."""
        if picture.time_s - self._examined_picture.time_s < AT_ONCE_S:
            return False
        plan = self.examination.plan
        return _stands_on(plan, picture) != _stands_on(plan, self._examined_picture)

    def _drifted(self, picture: Picture) -> bool:
        """Return whether an agent's charge or position has drifted since the last rehearsal.

        Each rehearsal is logged, so the longer a plan waits, the less often a drift counts.
        """
        waited_s = self._examined_picture.time_s - self._since_s
        if picture.time_s - self._examined_picture.time_s < min(LEAST_S + waited_s / 10, MOST_S):
            return False
        for name in set(self.examination.plan.agents):
            now, then = picture.assets.get(name), self._examined_picture.assets.get(name)
            if now is None or then is None:
                continue
            if abs(now.battery_pct - then.battery_pct) >= DRIFT_PCT:
                return True
            if dist(now.position, then.position) >= DRIFT_M:
                return True
        return False

    async def decided(
        self, planned: PlanForDecision, before: Readings, answer: Decide
    ) -> AdmissibleDecision | Examination:
        """Return the decision on the plan, or a newer examination once other rules are broken."""
        try:
            return await decide(self._context, planned, before, lambda: self._answered(answer))
        except _PlanChangedError as changed:
            return changed.examination

    async def _answered(self, answer: Decide) -> Decision:
        """Return the operator's answer; raises _PlanChangedError if the broken rules change."""
        deciding, watching = asyncio.ensure_future(answer()), asyncio.ensure_future(self._watch())
        both = deciding, watching
        try:
            await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)
            if deciding.done():
                return deciding.result()
            raise _PlanChangedError(watching.result())
        finally:
            for task in both:
                task.cancel()
            await asyncio.gather(*both, return_exceptions=True)

    async def _watch(self) -> Examination:
        """Keep the rehearsal up to date; return the examination once the broken rules change."""
        while True:
            await self._due.wait()
            earlier = self.examination
            self._examined_picture = self._context.services.fleet.picture()
            self._due.clear()
            self.examination = newer = await safeguards(self._context, self._task, earlier.plan)
            self._emit_examination(
                newer, same=_statuses(earlier.findings) == _statuses(newer.findings)
            )
            if _broken(earlier.findings) != _broken(newer.findings):
                return newer

    def _emit_examination(self, examination: Examination, *, same: bool) -> None:
        attempt, shown, emit = self._shown.attempt, self._shown, self._context.emit
        if examination.rehearsal is not None:
            emit(
                ev.PlanRehearsed(
                    attempt=attempt,
                    rehearsal=examination.rehearsal,
                    seconds=examination.rehearsal_s,
                )
            )
        if not same:
            emit(
                ev.PlanChecked(
                    attempt=attempt,
                    findings=examination.findings,
                    seconds=examination.checks_s,
                    unmet=shown.unmet,
                    gaps=shown.mentions.gaps,
                )
            )


def examined_again(planned: PlanForDecision, examination: Examination) -> PlanForDecision:
    """Return `planned` with a newer examination of its plan."""
    return replace(planned, best=replace(planned.best, examination=examination))


def _stands_on(plan: Plan, picture: Picture) -> tuple[object, ...]:
    """Return the facts of a picture that may change the consequences of a plan."""
    agents = ((name, picture.assets.get(name)) for name in dict.fromkeys(plan.agents))
    return (
        tuple((n, a and (a.available, a.at, a.post, a.status, a.low_battery)) for n, a in agents),
        tuple((gate, frozenset(cover.by)) for gate, cover in picture.gates.items()),
        tuple(
            (t.id, t.gate, t.status, t.identity, t.intent, t.warned)
            for t in picture.tracks.values()
        ),
        picture.weather,
    )


def _broken(findings: Iterable[Finding]) -> frozenset[str]:
    return frozenset(finding.rule_id for finding in findings if finding.broken)


def _statuses(findings: Iterable[Finding]) -> frozenset[tuple[str, str]]:
    return frozenset((finding.rule_id, finding.status) for finding in findings)
