"""Repeated checks of a recorded session's plans under other rules.

The log holds what a check needs: the plan, the rehearsal with its first picture, and the telemetry
for orderings and sightings.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from pa_console.mission.rehearse import order_moments
from pa_console.policy.check_context import Sightings
from pa_console.policy.core_rules import with_core
from pa_console.policy.findings import ORDER_ID, STRUCTURE_ID
from pa_console.policy.moments import moment
from pa_console.policy.monitor import Monitor
from pa_console.policy.rule_checks import check_mission, check_plan
from pa_console.policy.rulebook import Rulebook, compile_rule
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Mission
from pa_console.schema.rehearsal import Moment
from pa_console.schema.rule import RulesSeal
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_console.session.mission_trace import MissionTrace
from pa_console.session.state import SessionState

Findings = tuple[Finding, ...]


@dataclass(frozen=True)
class Taken:
    """A mission at its intake, with the findings of each rule set for its text alone.

    `recorded` are the findings that refused the mission; empty if it was accepted.
    """

    mission: Mission
    recorded: Findings
    found: tuple[Findings, ...]


@dataclass(frozen=True)
class Checked:
    """A plan as it was checked, with the findings of each rule set now.

    `found` is None if the check cannot be repeated; `reason` says why.
    """

    mission: Mission
    attempt: int
    recorded: Findings
    found: tuple[Findings, ...] | None
    reason: str = ""


@dataclass(frozen=True)
class Running:
    """The orderings that each set of rules finds broken while a plan runs."""

    mission: Mission
    attempt: int
    time_s: float
    found: tuple[Findings, ...]


@dataclass(frozen=True)
class Unrecorded:
    """An examination that the log has too few facts to repeat."""

    mission: Mission
    attempt: int
    reason: str


Again = Taken | Checked | Running | Unrecorded


@dataclass
class _Work:
    """A mission in progress: its rule sets, their monitors and its current task."""

    books: tuple[Rulebook, ...]
    monitors: tuple[Monitor, ...]
    task: Mission
    active: bool = True
    executing: bool = False
    done: set[str] = field(default_factory=set[str])
    taken: bool = False
    verified: bool = False
    halted: bool = False


class Recheck:
    """Check of a session by several rule sets, event by event: the findings of each decision."""

    def __init__(
        self, world: World, others: Sequence[Rulebook], own: Rulebook | None = None
    ) -> None:
        """Start before the first event of a session in `world`.

        Findings are yielded for each rule set of `others` first, then for `own`, the rules with
        which the session began. When the session changes its rules, those in the log replace `own`.
        """
        self.state = SessionState()
        self._world, self._others, self._own = world, tuple(others), own
        self._sightings = Sightings(world)
        self._work: dict[str, _Work] = {}

    def see(self, event: ev.Event) -> Iterator[Again]:
        """Take in the next event of the log."""
        if isinstance(event.data, ev.TelemetryReceived):
            self._sightings.look(event.data.picture)
            yield from self._running(event.data.picture)
        if isinstance(event.data, ev.SessionStarted) and self._own is not None:
            self._own = _as_then(self._own, event.data.rules_seal)
        if isinstance(event.data, ev.RulesReplaced) and self._own is not None:
            self._own = _as_then(_as_told(event.data), event.data.rules_seal)
        self.state.apply(event)
        trace = self.state.missions.get(event.mission or "")
        if trace is not None:
            yield from self._of_mission(trace, event.data)

    def _of_mission(self, trace: MissionTrace, data: ev.EventPayload) -> Iterator[Again]:
        mission = trace.mission
        if isinstance(data, ev.MissionStarted) and mission.id not in self._work:
            self._work[mission.id] = self._begin(mission)
        work = self._work.get(mission.id)
        if work is None:
            return
        match data:
            case ev.MissionStarted():
                work.active = True
            case ev.RulesRetrieved():
                yield from self._taken(mission, work, ())
                work.task = self._task(trace, work)
                work.halted = False
            case ev.PlanChecked(attempt=attempt, findings=findings) if not work.taken:
                yield from self._taken(mission, work, findings)
            case ev.PlanChecked(attempt=attempt, findings=findings):
                yield self._checked(trace, work, attempt, findings)
            case ev.CommandSent() if trace.executing and not work.executing and not work.halted:
                work.executing, work.done = True, set()
            case ev.CommandReplied(reply=reply) if reply.status == "done":
                work.done.add(reply.agent)
            case ev.PlanVoided(attempt=attempt, reason=reason):
                reason = f"it was examined once more before it was carried out ({reason})"
                yield Unrecorded(mission, attempt, f"{reason}; that examination is not recorded")
            case ev.PlanHalted():
                work.executing, work.halted = False, True
            case ev.MissionVerified():
                work.executing, work.verified = False, True
            case ev.MissionPreempted() | ev.MissionFinished():
                work.executing = work.active = False
            case _:
                pass

    def _begin(self, mission: Mission) -> _Work:
        """Return a mission bound to the rules now in force; they apply to it until it ends."""
        books = self._others if self._own is None else (*self._others, self._own)
        monitors = tuple(Monitor(book, self._world, self._sightings) for book in books)
        return _Work(books, monitors, mission)

    def _taken(self, mission: Mission, work: _Work, recorded: Findings) -> Iterator[Again]:
        """Decide once by the mission's words, if the session did."""
        started = self.state.started
        if not work.taken and (started is None or started.variant.checks):
            found = tuple(check_mission(book, mission, self._world) for book in work.books)
            yield Taken(mission, recorded, found)
        work.taken = True

    def _task(self, trace: MissionTrace, work: _Work) -> Mission:
        """Return what the next plan is for: a workflow's phase, what an alarm asks for, or all."""
        for track, move in trace.standings.items():
            if move.command:
                known = self.state.picture.tracks.get(track) if self.state.picture else None
                gate = known.gate if known is not None else trace.mission.gate
                words = {"text": move.command, "subject": track, "gate": gate}
                return trace.mission.model_copy(update=words)
        if work.halted or trace.workflow:
            return work.task
        asked = [a.alarm for a in self.state.alarms if a.alarm.id == trace.mission.alarm]
        if work.verified and asked and asked[0].command:
            return trace.mission.model_copy(update={"text": asked[0].command})
        return trace.mission

    def _checked(
        self, trace: MissionTrace, work: _Work, number: int, recorded: Findings
    ) -> Checked:
        attempt = trace.attempt(number)
        plan, rehearsal = attempt.plan, attempt.rehearsal
        recorded = tuple(finding for finding in recorded if finding.rule_id != ORDER_ID)
        reason = ""
        if any(finding.rule_id == STRUCTURE_ID for finding in recorded):
            reason = "it could not even be started, whatever the rules"
        elif not recorded:
            reason = "the session ran without checks"
        elif plan is None or rehearsal is None:
            reason = "it was not rehearsed in the session"
        if reason or plan is None or rehearsal is None:
            return Checked(trace.mission, number, recorded, None, reason)
        found = tuple(
            check_plan(
                rulebook,
                plan=plan,
                rehearsal=rehearsal,
                mission=work.task,
                world=self._world,
                monitor=monitor,
            )
            for rulebook, monitor in zip(work.books, work.monitors, strict=True)
        )
        return Checked(trace.mission, number, recorded, found)

    def _running(self, picture: Picture) -> Iterator[Running]:
        """Advance the orderings of each active mission; yield the broken ones."""
        for mission_id, work in self._work.items():
            if not work.active:
                continue
            trace = self.state.missions[mission_id]
            now = self._moment(picture, trace, work)
            found = tuple(monitor.observe(now) for monitor in work.monitors)
            if any(found) and work.executing:
                yield Running(trace.mission, trace.executing, picture.time_s, found)

    def _moment(self, picture: Picture, trace: MissionTrace, work: _Work) -> Moment:
        attempt = trace.find(trace.executing) if work.executing else None
        plan = attempt.plan if attempt is not None else None
        orders = order_moments(plan, self._world, work.done) if plan is not None else ()
        return moment(picture, self._world, orders, tuple(order.agent for order in orders))


def _as_told(replaced: ev.RulesReplaced) -> Rulebook:
    """Return the rules that a session changed to; raises ExpressionError if they do not compile."""
    entries = tuple(compile_rule(rule) for rule in replaced.rule_set.rules)
    seal = replaced.rules_seal.model_copy(update={"core": ""})
    return Rulebook(replaced.rules, replaced.rules_sha256, entries, seal=seal)


def _as_then(own: Rulebook, seal: RulesSeal | None) -> Rulebook:
    """Return the rules, with the core rules added if they were in force."""
    return with_core(own) if seal is not None and seal.core else own
