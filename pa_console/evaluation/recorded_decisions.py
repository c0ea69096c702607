"""The decisions of a recorded session, repeated under other rules or under the same rules.

The log has everything that a check needs: the plan, the rehearsal with its first picture, and the
telemetry for orderings and sightings. A decision that cannot be repeated from the log is a gap.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

from pa_console.evaluation.changed_decisions import (
    ChangedDecision,
    Findings,
    Gap,
    SessionEffect,
    blocking,
    by_rule,
    differ,
    in_words,
    intake_flips,
    orders_of,
    plan_flips,
    status_in_words,
)
from pa_console.mission.approval import CheckedPlan, OrderAsRead, inadmissible, request_approval
from pa_console.mission.rehearse import order_moments
from pa_console.policy.findings import ORDER_ID, STRUCTURE_ID
from pa_console.policy.moments import moment
from pa_console.policy.monitor import Monitor
from pa_console.policy.rule_checks import check_mission, check_plan
from pa_console.policy.rule_variables import Sightings
from pa_console.policy.rulebook import Rulebook, compile_rule, with_core
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Mission
from pa_console.schema.rehearsal import Moment
from pa_console.schema.rule import RulesSeal
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_console.session.mission_trace import MissionTrace
from pa_console.session.state import SessionState


def effect_on_session(
    events: Iterable[ev.Event], world: World, new: Rulebook, was: Rulebook | None = None
) -> SessionEffect:
    """Return the decisions of a recorded session that change under the rules `new`.

    The judge's verdicts, the operator's decisions and all later events stay as recorded. `was` are
    the rules of the session. A finding that they do not reproduce is a gap, not a change. Without
    `was`, broken orderings of a running plan are not compared. Errors in reading `events` are
    passed on.
    """
    return _Session(world, new, was).follow(events)


def decided_again(events: Iterable[ev.Event], world: World, own: Rulebook) -> SessionEffect:
    """Return the decisions of a recorded session that its own rules do not reproduce.

    `own` are the rules at the start of the session; later rules are in its log. Errors in reading
    `events` are passed on.
    """
    return _Session(world, None, own).follow(events)


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


class _Session:
    """A recorded session whose decisions are repeated and compared, event by event."""

    def __init__(self, world: World, new: Rulebook | None, own: Rulebook | None) -> None:
        """Start before the first event of a session in `world`.

        Decisions are repeated under `new`, and under `own`, the rules at the start of the session.
        If the session changes its rules, the rules in the log replace `own`.
        """
        self._effect = SessionEffect()
        self._state = SessionState()
        self._world, self._new, self._own = world, new, own
        self._has_old = new is not None and own is not None
        self._sightings = Sightings(world)
        self._work: dict[str, _Work] = {}
        self._checked: dict[tuple[str, int], Findings] = {}
        self._halts: set[tuple[str, int, str]] = set()

    def follow(self, events: Iterable[ev.Event]) -> SessionEffect:
        """Return the effect of the rules over all events of the log."""
        for event in events:
            self._see(event)
        return self._effect

    def _see(self, event: ev.Event) -> None:
        data = event.data
        if isinstance(data, ev.TelemetryReceived):
            self._sightings.look(data.picture)
            self._observe(data.picture)
        if isinstance(data, ev.SessionStarted):
            self._effect.session = data.session
            if self._own is not None:
                self._own = _with_core_of(data.rules_seal, self._own)
        if isinstance(data, ev.RulesReplaced) and self._own is not None:
            self._own = _with_core_of(data.rules_seal, _rules_of(data))
        self._state.apply(event)
        trace = self._state.missions.get(event.mission or "")
        if trace is not None:
            self._see_mission(trace, data)
        if isinstance(data, ev.DecisionMade) and event.mission:
            self._decided(event.mission, data)

    def _see_mission(self, trace: MissionTrace, data: ev.EventPayload) -> None:
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
                self._taken(mission, work, ())
                work.task = self._task(trace, work)
                work.halted = False
            case ev.PlanChecked(findings=findings) if not work.taken:
                self._taken(mission, work, findings)
            case ev.PlanChecked(attempt=attempt, findings=findings):
                self._plan(trace, work, attempt, findings)
            case ev.CommandSent() if trace.executing and not work.executing and not work.halted:
                work.executing, work.done = True, set()
            case ev.CommandReplied(reply=reply) if reply.status == "done":
                work.done.add(reply.agent)
            case ev.PlanVoided(attempt=attempt, reason=reason):
                reason = f"the plan was checked again before it was carried out ({reason})"
                self._gap(mission, attempt, f"{reason}; the second check is not recorded")
            case ev.PlanHalted():
                work.executing, work.halted = False, True
            case ev.MissionVerified():
                work.executing, work.verified = False, True
            case ev.MissionPreempted() | ev.MissionFinished():
                work.executing = work.active = False
            case _:
                pass

    def _gap(self, mission: Mission, attempt: int, reason: str, rule: str = "") -> None:
        self._effect.gaps.append(Gap(mission.id, attempt, rule, reason))

    def _begin(self, mission: Mission) -> _Work:
        """Return the work of a mission; the rules in force now apply until the mission ends."""
        books = tuple(book for book in (self._new, self._own) if book is not None)
        monitors = tuple(Monitor(book, self._world, self._sightings) for book in books)
        return _Work(books, monitors, mission)

    def _taken(self, mission: Mission, work: _Work, recorded: Findings) -> None:
        """Compare the intake of a mission once, if the session ran with checks.

        `recorded` has the findings for which the mission was refused; it is empty if it was taken.
        """
        started = self._state.started
        if not work.taken and (started is None or started.variant.checks):
            findings = tuple(check_mission(book, mission, self._world) for book in work.books)
            self._effect.missions += 1
            was, new = blocking(recorded), blocking(findings[0])
            if self._has_old and bool(blocking(findings[1])) != bool(was):
                self._gap(mission, 0, "the recorded intake is not reproduced under the same rules")
            else:
                self._effect.flips += intake_flips(mission.id, was, new)
        work.taken = True

    def _task(self, trace: MissionTrace, work: _Work) -> Mission:
        """Return the task of the next plan: a workflow's phase, an alarm's command or an order."""
        for track, move in trace.standings.items():
            if move.command:
                contact = self._state.picture.tracks.get(track) if self._state.picture else None
                gate = contact.gate if contact is not None else trace.mission.gate
                words = {"text": move.command, "subject": track, "gate": gate}
                return trace.mission.model_copy(update=words)
        if work.halted or trace.workflow:
            return work.task
        alarms = [a.alarm for a in self._state.alarms if a.alarm.id == trace.mission.alarm]
        if work.verified and alarms and alarms[0].command:
            return trace.mission.model_copy(update={"text": alarms[0].command})
        return trace.mission

    def _plan(self, trace: MissionTrace, work: _Work, number: int, recorded: Findings) -> None:
        """Compare the findings of a plan rule by rule, then the approval of the plan."""
        mission, attempt = trace.mission, trace.attempt(number)
        plan, rehearsal = attempt.plan, attempt.rehearsal
        recorded = tuple(finding for finding in recorded if finding.rule_id != ORDER_ID)
        reason = ""
        if any(finding.rule_id == STRUCTURE_ID for finding in recorded):
            reason = "the plan could not be started under any rules"
        elif not recorded:
            reason = "the session ran without checks"
        elif plan is None or rehearsal is None:
            reason = "the plan was not rehearsed in the session"
        elif len(plan.steps) > 1:
            reason = "the plan's steps were checked one by one, and their pictures are not recorded"
        if reason or plan is None or rehearsal is None:
            self._gap(mission, number, reason)
            return
        checked = tuple(
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
        old, repeated = by_rule(recorded), by_rule(checked[1] if self._has_old else recorded)
        self._effect.plans += 1
        self._effect.compared += len({*old, *by_rule(checked[0])})
        doubtful = [
            rule
            for rule in dict.fromkeys((*old, *repeated))
            if differ(old.get(rule), repeated.get(rule))
        ]
        for rule in doubtful:
            was, now = status_in_words(old.get(rule)), status_in_words(repeated.get(rule))
            reason = f"the recorded finding is {was!r}, but the same rules now give {now!r}"
            self._gap(mission, number, reason, rule)
        self._effect.flips += plan_flips(
            mission.id, number, orders_of(plan), recorded, checked[0], doubtful
        )
        if not doubtful:
            self._checked[mission.id, number] = checked[0]

    def _decided(self, mission: str, made: ev.DecisionMade) -> None:
        """Compare whether the operator's decision is admissible, given the recorded verdict."""
        findings = self._checked.get((mission, made.attempt))
        started = self._state.started
        attempt = self._state.missions[mission].find(made.attempt)
        if findings is None or attempt is None or attempt.plan is None or started is None:
            return
        readings = (made.decision.asked,) if made.decision.kind == "choose" else ()
        request = request_approval(
            made.decision.request_id,
            made.attempt,
            CheckedPlan(
                attempt.plan,
                findings,
                attempt.verdict,
                attempt.judge_error or "the judge was not asked, because the plan was blocked",
            ),
            OrderAsRead(readings=readings),
            judging=started.variant.judging,
        )
        problem = inadmissible(request, made.decision)
        if bool(problem) != made.accepted:
            return
        old, new = by_rule(attempt.findings), by_rule(findings)
        why = tuple(r for r in dict.fromkeys((*old, *new)) if differ(old.get(r), new.get(r)))
        states = ("accepted", "refused") if made.accepted else ("refused", "accepted")
        was, now = (f"{made.decision.kind} {state}" for state in states)
        orders, words = orders_of(attempt.plan), problem or made.detail
        flip = ChangedDecision("decision", mission, made.attempt, orders, why, was, now, words)
        self._effect.flips.append(flip)

    def _observe(self, picture: Picture) -> None:
        """Advance the orderings of each active mission, and compare which of them are broken."""
        for mission_id, work in self._work.items():
            if not work.active:
                continue
            trace = self._state.missions[mission_id]
            now = self._moment(picture, trace, work)
            findings = tuple(monitor.observe(now) for monitor in work.monitors)
            if any(findings) and work.executing and self._has_old:
                self._running(trace, picture.time_s, findings)

    def _moment(self, picture: Picture, trace: MissionTrace, work: _Work) -> Moment:
        attempt = trace.find(trace.executing) if work.executing else None
        plan = attempt.plan if attempt is not None else None
        orders = order_moments(plan, self._world, work.done) if plan is not None else ()
        return moment(picture, self._world, orders, tuple(order.agent for order in orders))

    def _running(
        self, trace: MissionTrace, time_s: float, broken_by_book: tuple[Findings, ...]
    ) -> None:
        """Compare which orderings halt the running plan under each of the two rule sets."""
        mission, attempt = trace.mission.id, trace.executing
        new, was = (by_rule(blocking(findings)) for findings in broken_by_book)
        for rule in dict.fromkeys((*was, *new)):
            key = (mission, attempt, rule)
            if (rule in was) == (rule in new) or key in self._halts:
                continue
            self._halts.add(key)
            orders = self._new.get(rule).order if self._new is not None and rule in new else ()
            if rule in new and all(order.each == "gate" for order in orders):
                continue  # premises and alarms handle orderings for gates, so these do not halt
            broken = f"halted at {time_s:.1f} s"
            was_told, now_told = ("went on", broken) if rule in new else (broken, "goes on")
            words = in_words([new.get(rule) or was[rule]])
            ran = trace.find(attempt)
            done = orders_of(ran.plan) if ran is not None and ran.plan else ""
            flip = ChangedDecision(
                "halt", mission, attempt, done, (rule,), was_told, now_told, words
            )
            self._effect.flips.append(flip)


def _rules_of(replaced: ev.RulesReplaced) -> Rulebook:
    """Return the new rules of a session; raises ExpressionError if they do not compile."""
    entries = tuple(compile_rule(rule) for rule in replaced.rule_set.rules)
    seal = replaced.rules_seal.model_copy(update={"core": ""})
    return Rulebook(replaced.rules, replaced.rules_sha256, entries, seal=seal)


def _with_core_of(seal: RulesSeal | None, own: Rulebook) -> Rulebook:
    """Return the rules `own`, with the core added if it was in force."""
    return with_core(own) if seal is not None and seal.core else own
