"""Decisions that change under other rules, in a recorded session or for a mission set.

A decision that the log cannot settle is a gap. A mission set has no recorded plans: each mission's
situation is simulated without a model, and single orders that are possible in it are rehearsed once
and checked by both rule sets.
"""

import asyncio
import random
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Literal

from pa_console.mission.approval import CheckedPlan, OrderAsRead, inadmissible, request_approval
from pa_console.mission.rehearse import order_moments, rehearse
from pa_console.policy.findings import ORDER_ID, STRUCTURE_ID
from pa_console.policy.moments import moment
from pa_console.policy.monitor import Monitor
from pa_console.policy.rule_checks import check_mission, check_plan
from pa_console.policy.rule_variables import Sightings
from pa_console.policy.rulebook import Rulebook, compile_rule, with_core
from pa_console.schema.command import COMMANDS
from pa_console.schema.evaluation import MissionCase
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import Moment
from pa_console.schema.rule import RulesSeal
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_console.session.mission_trace import MissionTrace
from pa_console.session.state import SessionState
from pa_console.sim.checkpoint import Checkpoint
from pa_console.station.headless import SETUP_SETTLE_S

Findings = tuple[Finding, ...]

FlipKind = Literal["finding", "plan", "decision", "intake", "halt"]
FLIP_KINDS: tuple[FlipKind, ...] = ("intake", "finding", "plan", "decision", "halt")
NONE = "no such rule"


@dataclass(frozen=True)
class ChangedDecision:
    """A decision that changes under other rules; `rules` are the rules that change it.

    finding   the result of one rule's check or orderings for a plan
    plan      approval of a plan: allowed or blocked
    decision  whether the operator's decision was admissible, as it was made
    intake    whether the mission is refused before any model is asked
    halt      whether a running plan is halted for an ordering

    `plan` are the orders in words, empty at intake.
    """

    kind: FlipKind
    mission: str
    attempt: int
    plan: str
    rules: tuple[str, ...]
    was: str
    now: str
    words: str


@dataclass(frozen=True)
class Gap:
    """A decision that cannot be made again from the log, and why; attempt 0 is the intake.

    `rule` is empty when it holds for every rule.
    """

    mission: str
    attempt: int
    rule: str
    reason: str


@dataclass
class SessionEffect:
    """The effect of a rule set on one session; `compared` counts findings."""

    session: str = ""
    missions: int = 0
    plans: int = 0
    compared: int = 0
    flips: list[ChangedDecision] = field(default_factory=list[ChangedDecision])
    gaps: list[Gap] = field(default_factory=list[Gap])


def by_rule(findings: Iterable[Finding]) -> dict[str, Finding]:
    """Return `findings` by their rules' ids."""
    return {finding.rule_id: finding for finding in findings}


def blocking(findings: Iterable[Finding]) -> list[Finding]:
    """Return the findings that block a plan."""
    return [finding for finding in findings if finding.blocking]


def differ(first: Finding | None, second: Finding | None) -> bool:
    """Return whether two findings of a rule differ in meaning: broken, blocking or an error.

    A missing rule counts as not broken.
    """
    return _meaning(first) != _meaning(second)


def status_in_words(found: Finding | None) -> str:
    """Return a finding's status in words, with the priority of a broken rule."""
    if found is None:
        return NONE
    return f"{found.status} ({found.priority})" if found.broken else found.status


def in_words(findings: Iterable[Finding]) -> str:
    """Return findings with their rules and messages."""
    return "; ".join(f"{found.rule_id}: {found.message}" for found in findings)


def orders_of(plan: Plan) -> str:
    """Return a plan's orders in words."""
    return ", ".join(f"{a.agent} {a.command}" for a in plan.actions) or "no orders"


def intake_flips(mission: str, was: list[Finding], now: list[Finding]) -> list[ChangedDecision]:
    """Return whether a mission is refused at once, by the findings that block it, if it changes."""
    if bool(was) == bool(now):
        return []
    states = ("refused", "taken") if was else ("taken", "refused")
    why = tuple(finding.rule_id for finding in was or now)
    return [ChangedDecision("intake", mission, 0, "", why, *states, in_words(was or now))]


def plan_flips(  # noqa: PLR0917 - one plan and what two sets of rules say of it
    mission: str,
    attempt: int,
    orders: str,
    was: Findings,
    now: Findings,
    doubtful: Collection[str] = (),
) -> list[ChangedDecision]:
    """Return the rules whose findings change, then the plan if its approval changes.

    Rules in `doubtful` are left out. With any of them the plan as a whole is not compared.
    """
    old, new = by_rule(was), by_rule(now)
    flips: list[ChangedDecision] = []
    turned: list[str] = []
    for rule in dict.fromkeys((*old, *new)):
        before, after = old.get(rule), new.get(rule)
        if rule in doubtful or not differ(before, after):
            continue
        turned.append(rule)
        words = next((f.message for f in (after, before) if f is not None and f.message), "")
        states = (status_in_words(before), status_in_words(after))
        flips.append(ChangedDecision("finding", mission, attempt, orders, (rule,), *states, words))
    blocked, blocks = blocking(was), blocking(now)
    if bool(blocked) != bool(blocks) and not doubtful:
        states = ("blocked", "not blocked") if blocked else ("not blocked", "blocked")
        because = tuple(
            rule
            for rule in turned
            if any(found.blocking for found in (old.get(rule), new.get(rule)) if found is not None)
        )
        words = in_words(blocked or blocks)
        flips.append(ChangedDecision("plan", mission, attempt, orders, because, *states, words))
    return flips


def rules_turned(flips: Iterable[ChangedDecision]) -> Iterator[tuple[str, int]]:
    """Yield each rule that changes decisions with their number, largest number first."""
    counts = Counter(rule for flip in flips for rule in flip.rules)
    yield from sorted(counts.items(), key=lambda item: (-item[1], item[0]))


def _meaning(found: Finding | None) -> tuple[bool, bool, bool]:
    if found is None:
        return (False, False, False)
    return (found.broken, found.blocking, found.status == "error")


def effect_on_session(
    events: Iterable[ev.Event], world: World, new: Rulebook, was: Rulebook | None = None
) -> SessionEffect:
    """Return the decisions of a recorded session that `new` rules change.

    The judge's verdicts, the operator's decisions and all later events stay as recorded. `was` are
    the rules of the session: a finding that even they do not reproduce is a gap, not a change;
    without them the broken orderings of a running plan are unknown. Raises the errors of reading
    `events`.
    """
    return _followed(events, _Session(world, new, was, has_old=was is not None))


def decided_again(events: Iterable[ev.Event], world: World, own: Rulebook) -> SessionEffect:
    """Return the decisions of a recorded session that its own rules do not reproduce.

    `own` are the rules at its beginning; later rules are in its log. Raises the errors of reading
    `events`.
    """
    return _followed(events, _Session(world, None, own, has_old=False))


def _followed(events: Iterable[ev.Event], session: "_Session") -> SessionEffect:
    for event in events:
        session.see(event)
    return session.found


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
    """A recorded session whose decisions are made again and compared, event by event.

    The log holds what a check needs: the plan, the rehearsal with its first picture, and the
    telemetry for orderings and sightings.
    """

    def __init__(
        self, world: World, new: Rulebook | None, own: Rulebook | None, *, has_old: bool
    ) -> None:
        """Start before the first event of a session in `world`.

        Decisions are made by `new` first, then by `own`, the rules with which the session began.
        When the session changes its rules, those in the log replace `own`.
        """
        self.found = SessionEffect()
        self._state = SessionState()
        self._world, self._new, self._own, self._has_old = world, new, own, has_old
        self._sightings = Sightings(world)
        self._work: dict[str, _Work] = {}
        self._checked: dict[tuple[str, int], Findings] = {}
        self._halts: set[tuple[str, int, str]] = set()

    def see(self, event: ev.Event) -> None:
        """Take in the next event of the log."""
        data = event.data
        if isinstance(data, ev.TelemetryReceived):
            self._sightings.look(data.picture)
            self._observe(data.picture)
        if isinstance(data, ev.SessionStarted):
            self.found.session = data.session
            if self._own is not None:
                self._own = _as_then(self._own, data.rules_seal)
        if isinstance(data, ev.RulesReplaced) and self._own is not None:
            self._own = _as_then(_as_told(data), data.rules_seal)
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
                reason = f"it was examined once more before it was carried out ({reason})"
                self._gap(mission, attempt, f"{reason}; that examination is not recorded")
            case ev.PlanHalted():
                work.executing, work.halted = False, True
            case ev.MissionVerified():
                work.executing, work.verified = False, True
            case ev.MissionPreempted() | ev.MissionFinished():
                work.executing = work.active = False
            case _:
                pass

    def _gap(self, mission: Mission, attempt: int, reason: str, rule: str = "") -> None:
        self.found.gaps.append(Gap(mission.id, attempt, rule, reason))

    def _begin(self, mission: Mission) -> _Work:
        """Return a mission bound to the rules now in force; they apply to it until it ends."""
        books = tuple(book for book in (self._new, self._own) if book is not None)
        monitors = tuple(Monitor(book, self._world, self._sightings) for book in books)
        return _Work(books, monitors, mission)

    def _taken(self, mission: Mission, work: _Work, recorded: Findings) -> None:
        """Compare whether the mission is refused before any model is asked, if the session did.

        `recorded` are the findings that refused the mission; empty if it was accepted.
        """
        started = self._state.started
        if not work.taken and (started is None or started.variant.checks):
            found = tuple(check_mission(book, mission, self._world) for book in work.books)
            self.found.missions += 1
            was, new = blocking(recorded), blocking(found[0])
            if self._has_old and bool(blocking(found[1])) != bool(was):
                self._gap(
                    mission, 0, "whether it is refused comes out otherwise under the same rules"
                )
            else:
                self.found.flips += intake_flips(mission.id, was, new)
        work.taken = True

    def _task(self, trace: MissionTrace, work: _Work) -> Mission:
        """Return what the next plan is for: a workflow's phase, what an alarm asks for, or all."""
        for track, move in trace.standings.items():
            if move.command:
                known = self._state.picture.tracks.get(track) if self._state.picture else None
                gate = known.gate if known is not None else trace.mission.gate
                words = {"text": move.command, "subject": track, "gate": gate}
                return trace.mission.model_copy(update=words)
        if work.halted or trace.workflow:
            return work.task
        asked = [a.alarm for a in self._state.alarms if a.alarm.id == trace.mission.alarm]
        if work.verified and asked and asked[0].command:
            return trace.mission.model_copy(update={"text": asked[0].command})
        return trace.mission

    def _plan(self, trace: MissionTrace, work: _Work, number: int, recorded: Findings) -> None:
        """Compare rule by rule, then whether the plan may be approved."""
        mission, attempt = trace.mission, trace.attempt(number)
        plan, rehearsal = attempt.plan, attempt.rehearsal
        recorded = tuple(finding for finding in recorded if finding.rule_id != ORDER_ID)
        reason = ""
        if any(finding.rule_id == STRUCTURE_ID for finding in recorded):
            reason = "it could not even be started, whatever the rules"
        elif not recorded:
            reason = "the session ran without checks"
        elif plan is None or rehearsal is None:
            reason = "it was not rehearsed in the session"
        elif len(plan.steps) > 1:
            reason = "its steps were checked one by one, and their pictures are not recorded"
        if reason or plan is None or rehearsal is None:
            self._gap(mission, number, reason)
            return
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
        old, repeated = by_rule(recorded), by_rule(found[1] if self._has_old else recorded)
        self.found.plans += 1
        self.found.compared += len({*old, *by_rule(found[0])})
        doubtful = [
            rule
            for rule in dict.fromkeys((*old, *repeated))
            if differ(old.get(rule), repeated.get(rule))
        ]
        for rule in doubtful:
            was, now = status_in_words(old.get(rule)), status_in_words(repeated.get(rule))
            reason = f"recorded is {was!r}, but under the same rules it comes out as {now!r}"
            self._gap(mission, number, reason, rule)
        self.found.flips += plan_flips(
            mission.id, number, orders_of(plan), recorded, found[0], doubtful
        )
        if not doubtful:
            self._checked[mission.id, number] = found[0]

    def _decided(self, mission: str, made: ev.DecisionMade) -> None:
        """Compare whether the operator's decision was admissible, the verdict as it was."""
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
                attempt.judge_error or "it was not asked, as the plan was blocked",
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
        self.found.flips.append(flip)

    def _observe(self, picture: Picture) -> None:
        """Advance the orderings of each active mission and compare the broken ones."""
        for mission_id, work in self._work.items():
            if not work.active:
                continue
            trace = self._state.missions[mission_id]
            now = self._moment(picture, trace, work)
            found = tuple(monitor.observe(now) for monitor in work.monitors)
            if any(found) and work.executing and self._has_old:
                self._running(trace, picture.time_s, found)

    def _moment(self, picture: Picture, trace: MissionTrace, work: _Work) -> Moment:
        attempt = trace.find(trace.executing) if work.executing else None
        plan = attempt.plan if attempt is not None else None
        orders = order_moments(plan, self._world, work.done) if plan is not None else ()
        return moment(picture, self._world, orders, tuple(order.agent for order in orders))

    def _running(self, trace: MissionTrace, time_s: float, found: tuple[Findings, ...]) -> None:
        """Compare which orderings halt the running plan with those of the rules it ran with."""
        mission, attempt = trace.mission.id, trace.executing
        new, was = (by_rule(blocking(findings)) for findings in found)
        for rule in dict.fromkeys((*was, *new)):
            key = (mission, attempt, rule)
            if (rule in was) == (rule in new) or key in self._halts:
                continue
            self._halts.add(key)
            orders = self._new.get(rule).order if self._new is not None and rule in new else ()
            if rule in new and all(order.each == "gate" for order in orders):
                continue  # premises and alarms see to gates
            broken = f"halted at {time_s:.1f} s"
            was_told, now_told = ("went on", broken) if rule in new else (broken, "goes on")
            words = in_words([new.get(rule) or was[rule]])
            ran = trace.find(attempt)
            done = orders_of(ran.plan) if ran is not None and ran.plan else ""
            flip = ChangedDecision(
                "halt", mission, attempt, done, (rule,), was_told, now_told, words
            )
            self.found.flips.append(flip)


def _as_told(replaced: ev.RulesReplaced) -> Rulebook:
    """Return the rules that a session changed to; raises ExpressionError if they do not compile."""
    entries = tuple(compile_rule(rule) for rule in replaced.rule_set.rules)
    seal = replaced.rules_seal.model_copy(update={"core": ""})
    return Rulebook(replaced.rules, replaced.rules_sha256, entries, seal=seal)


def _as_then(own: Rulebook, seal: RulesSeal | None) -> Rulebook:
    """Return the rules, with the core rules added if they were in force."""
    return with_core(own) if seal is not None and seal.core else own


EPOCH = datetime(2000, 1, 1, tzinfo=UTC)


def effect_on_mission(  # noqa: PLR0917 - a mission, both sets of rules, and how much is tried
    case: MissionCase,
    world: World,
    new: Rulebook,
    was: Rulebook,
    plans: int,
    seed: int,
    tried: Callable[[], None] = lambda: None,
) -> SessionEffect:
    """Return the changed decisions of one mission: its intake and `plans` single orders.

    `seed` draws the orders; `tried` is called after each plan. Raises ValueError for a set-up that
    cannot be simulated.
    """
    effect = SessionEffect(missions=1)
    mission = Mission(id=case.id, text=case.command, created=EPOCH)
    effect.flips += intake_flips(
        case.id, *(blocking(check_mission(book, mission, world)) for book in (was, new))
    )
    sim = Checkpoint(world, seed)
    sightings = _begin(sim, case)
    for number, plan in enumerate(_plans(world, plans, seed), start=1):
        old, now = asyncio.run(_checked(sim, plan, mission, (was, new), sightings))
        effect.plans += 1
        effect.compared += len({*by_rule(old), *by_rule(now)})
        effect.flips += plan_flips(case.id, number, orders_of(plan), old, now)
        tried()
    return effect


async def _checked(
    sim: Checkpoint, plan: Plan, mission: Mission, books: tuple[Rulebook, ...], seen: Sightings
) -> tuple[Findings, ...]:
    rehearsal = await rehearse(sim, plan)
    return tuple(
        check_plan(
            book,
            plan=plan,
            rehearsal=rehearsal,
            mission=mission,
            world=sim.world,
            monitor=Monitor(book, sim.world, seen),
        )
        for book in books
    )


def _begin(sim: Checkpoint, case: MissionCase) -> Sightings:
    """Simulate the mission's set-up as an evaluation does; return the sightings."""
    seen = Sightings(sim.world)
    seen.look(sim.picture())
    for incident in case.setup:
        sim.inject(incident)
    for _ in range(round(SETUP_SETTLE_S / sim.world.dt_s)):
        sim.step()
        seen.look(sim.picture())
    return seen


def _plans(world: World, most: int, seed: int) -> list[Plan]:
    """Return the plan without orders, and at most `most` others of one order each."""
    orders = [
        Action(agent=agent, command=f"{verb} {frame}" if spec.takes_frame else verb)
        for agent, asset in world.assets.items()
        for verb, spec in COMMANDS.items()
        if asset.kind in spec.kinds
        for frame in (world.frames if spec.takes_frame else ("",))
    ]
    if len(orders) > most:
        chosen = sorted(random.Random(seed).sample(range(len(orders)), most))
        orders = [orders[place] for place in chosen]
    reason = "tried to see what the rules say of it"
    return [Plan(reason=reason, actions=actions) for actions in ((), *((o,) for o in orders))]
