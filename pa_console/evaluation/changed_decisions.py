"""Decisions that change under other rules, in recorded sessions and at the missions of a set.

A decision that the log cannot settle is a gap. A mission set has no recorded plans: each mission's
situation is simulated, and single orders that are possible in it are rehearsed once and checked by
both rule sets, without any model.
"""

import asyncio
import random
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Literal

from pa_console.evaluation.recheck import (
    Again,
    Checked,
    Findings,
    Recheck,
    Running,
    Taken,
    Unrecorded,
)
from pa_console.mission.approval import CheckedPlan, OrderAsRead, inadmissible, request_approval
from pa_console.mission.rehearse import rehearse
from pa_console.policy.check_context import Sightings
from pa_console.policy.monitor import Monitor
from pa_console.policy.rule_checks import check_mission, check_plan
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.command import COMMANDS
from pa_console.schema.evaluation import MissionCase
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action, Plan
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from pa_console.station.headless import SETUP_SETTLE_S

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
        flips.append(
            ChangedDecision(
                "finding",
                mission,
                attempt,
                orders,
                (rule,),
                status_in_words(before),
                status_in_words(after),
                words,
            )
        )
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
    counts: dict[str, int] = {}
    for flip in flips:
        for rule in flip.rules:
            counts[rule] = counts.get(rule, 0) + 1
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
    return _follow(events, Recheck(world, (new,), was), new, has_old=was is not None)


def decided_again(events: Iterable[ev.Event], world: World, own: Rulebook) -> SessionEffect:
    """Return the decisions of a recorded session that its own rules do not reproduce.

    `own` are the rules at its beginning; later rules are in its log. Raises the errors of reading
    `events`.
    """
    return _follow(events, Recheck(world, (), own), own, has_old=False)


def _follow(
    events: Iterable[ev.Event], again: Recheck, rules: Rulebook, *, has_old: bool
) -> SessionEffect:
    effect = _Session(again, rules, has_old)
    for event in events:
        effect.see(event)
    return effect.found


class _Session:
    """Comparison of recorded decisions with those of other rules, event by event."""

    def __init__(self, again: Recheck, new: Rulebook, has_old: bool) -> None:
        self.found = SessionEffect()
        self._again, self._new, self._has_old = again, new, has_old
        self._checked: dict[tuple[str, int], Findings] = {}
        self._halts: set[tuple[str, int, str]] = set()

    def see(self, event: ev.Event) -> None:
        for result in self._again.see(event):
            self._compare(result)
        data = event.data
        if isinstance(data, ev.SessionStarted):
            self.found.session = data.session
        elif isinstance(data, ev.DecisionMade) and event.mission:
            self._decided(event.mission, data)

    def _compare(self, result: Again) -> None:
        match result:
            case Taken(mission, recorded, found):
                self.found.missions += 1
                self._taken(mission.id, recorded, found)
            case Checked(mission, attempt, _, None, reason):
                self.found.gaps.append(Gap(mission.id, attempt, "", reason))
            case Checked(mission, attempt, recorded, found) if found is not None:
                self._plan(mission.id, attempt, recorded, found)
            case Running():
                self._running(result)
            case Unrecorded(mission, attempt, reason):
                self.found.gaps.append(Gap(mission.id, attempt, "", reason))
            case _:
                pass

    def _taken(self, mission: str, recorded: Findings, found: tuple[Findings, ...]) -> None:
        """Compare whether the mission is refused before any model is asked."""
        was, new = blocking(recorded), blocking(found[0])
        if self._has_old and bool(blocking(found[1])) != bool(was):
            reason = "whether it is refused comes out otherwise under the same rules"
            self.found.gaps.append(Gap(mission, 0, "", reason))
        elif bool(was) != bool(new):
            states = ("refused", "taken") if was else ("taken", "refused")
            why = tuple(finding.rule_id for finding in was or new)
            flip = ChangedDecision("intake", mission, 0, "", why, *states, in_words(was or new))
            self.found.flips.append(flip)

    def _plan(
        self, mission: str, attempt: int, recorded: Findings, found: tuple[Findings, ...]
    ) -> None:
        """Compare rule by rule, then whether the plan may be approved."""
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
            self.found.gaps.append(Gap(mission, attempt, rule, reason))
        self.found.flips += plan_flips(
            mission, attempt, self._orders(mission, attempt), recorded, found[0], doubtful
        )
        if not doubtful:
            self._checked[mission, attempt] = found[0]

    def _decided(self, mission: str, made: ev.DecisionMade) -> None:
        """Compare whether the operator's decision was admissible, the verdict as it was."""
        findings = self._checked.get((mission, made.attempt))
        started = self._again.state.started
        attempt = self._again.state.missions[mission].find(made.attempt)
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

    def _running(self, running: Running) -> None:
        """Compare which orderings halt the running plan with those of the rules it ran with."""
        if not self._has_old:
            return
        mission, attempt = running.mission.id, running.attempt
        new, was = (by_rule(blocking(findings)) for findings in running.found)
        for rule in dict.fromkeys((*was, *new)):
            key = (mission, attempt, rule)
            if (rule in was) == (rule in new) or key in self._halts:
                continue
            self._halts.add(key)
            orders = self._new.get(rule).order if rule in new else ()
            if rule in new and all(order.each == "gate" for order in orders):
                continue  # premises and alarms see to gates
            broken = f"halted at {running.time_s:.1f} s"
            was_told, now_told = ("went on", broken) if rule in new else (broken, "goes on")
            words = in_words([new.get(rule) or was[rule]])
            done = self._orders(mission, attempt)
            flip = ChangedDecision(
                "halt", mission, attempt, done, (rule,), was_told, now_told, words
            )
            self.found.flips.append(flip)

    def _orders(self, mission: str, number: int) -> str:
        attempt = self._again.state.missions[mission].find(number)
        return orders_of(attempt.plan) if attempt is not None and attempt.plan else ""


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
    intake = [blocking(check_mission(book, mission, world)) for book in (was, new)]
    if bool(intake[0]) != bool(intake[1]):
        states = ("refused", "taken") if intake[0] else ("taken", "refused")
        found = intake[0] or intake[1]
        why = tuple(finding.rule_id for finding in found)
        effect.flips.append(
            ChangedDecision("intake", case.id, 0, "", why, *states, in_words(found))
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
