"""Trials of one rule on the plans of a session and on the present situation."""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from pa_console.mission.examine import assume_done
from pa_console.policy.findings import problems
from pa_console.policy.monitor import Monitor
from pa_console.policy.rule_checks import check_plan
from pa_console.policy.rule_variables import Sightings
from pa_console.policy.rulebook import CompiledRule, Rulebook
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_console.session.state import SessionState

CASES_KEPT = 40
"""The number of recent plans that are kept for trials."""

_EPOCH = datetime(2000, 1, 1, tzinfo=UTC)
NOBODY_MOVES = Plan(reason="nobody moves", actions=())


@dataclass(frozen=True)
class TrialCase:
    """A plan for a trial; `findings` are those recorded, which are empty if it was not checked."""

    title: str
    mission: Mission
    plan: Plan
    rehearsal: Rehearsal
    sightings: Sightings
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class Trial:
    """The finding of a rule for a case, and the recorded finding of that rule, if there is one."""

    case: TrialCase
    found: Finding
    before: Finding | None

    @property
    def flips(self) -> bool:
        """True if the rule is broken in only one of the two findings."""
        return self.before is not None and self.before.broken != self.found.broken


class SessionCases:
    """The last CASES_KEPT plans of a session, with everything that their checks need."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._sightings = Sightings(world)
        self._state = SessionState()
        self._kept: deque[TrialCase] = deque(maxlen=CASES_KEPT)
        self._last: tuple[Mission, Plan] | None = None

    def see(self, event: ev.Event, state: SessionState) -> None:
        """Process the next event; `state` already includes it."""
        self._state = state
        if isinstance(event.data, ev.TelemetryReceived):
            self._sightings.look(event.data.picture)
        elif isinstance(event.data, ev.PlanChecked):
            trace = state.missions.get(event.mission or "")
            attempt = trace.find(event.data.attempt) if trace is not None else None
            if trace is None or attempt is None or attempt.plan is None:
                return
            words = [move.command for move in trace.standings.values() if move.command]
            changes = {"text": words[0]} if words else {}
            mission = trace.mission.model_copy(update=changes)
            self._last = mission, attempt.plan
            if attempt.rehearsal is not None:
                self._kept.append(
                    TrialCase(
                        f"{mission.id} #{attempt.number}",
                        mission,
                        attempt.plan,
                        attempt.rehearsal,
                        self._sightings.copy(),
                        attempt.findings,
                    )
                )

    def cases(self) -> tuple[TrialCase, ...]:
        """Return the cases: the present situation first, then all kept plans, the newest first.

        The present situation gives two cases: one without orders, and one with the last plan. That
        plan is assumed to succeed at once, without a rehearsal. It is left out if it cannot start
        now.
        """
        picture = self._state.picture
        now = tuple(self._now(picture)) if picture is not None else ()
        return (*now, *reversed(self._kept))

    def _now(self, picture: Picture) -> Iterator[TrialCase]:
        nothing = Mission(id="now", text="Say what there is.", created=_EPOCH)
        present = self._last[0] if self._last is not None else nothing
        yield self._case("now, no asset moves", present, NOBODY_MOVES, picture)
        if self._last is not None:
            mission_of, plan = self._last
            if not problems(plan, self._world, picture):
                yield self._case(f"now, the last plan ({mission_of.id})", mission_of, plan, picture)

    def _case(self, title: str, mission: Mission, plan: Plan, picture: Picture) -> TrialCase:
        rehearsal = assume_done(picture, self._world, plan)
        return TrialCase(title, mission, plan, rehearsal, self._sightings.copy())


def try_rule(
    entry: CompiledRule, cases: Sequence[TrialCase], world: World, known_as: str = ""
) -> tuple[Trial, ...]:
    """Return a trial of the rule for each case; `known_as` is the id of the rule before the edit.

    Orderings are observed from the start of each plan, not from the start of its mission.
    """
    rulebook = Rulebook("draft", "", (entry,))
    return tuple(_try(rulebook, case, world, known_as or entry.rule.id) for case in cases)


def _try(rulebook: Rulebook, case: TrialCase, world: World, known_as: str) -> Trial:
    (finding,) = check_plan(
        rulebook,
        plan=case.plan,
        rehearsal=case.rehearsal,
        mission=case.mission,
        world=world,
        monitor=Monitor(rulebook, world, case.sightings),
    )
    before = next((earlier for earlier in case.findings if earlier.rule_id == known_as), None)
    return Trial(case, finding, before)
