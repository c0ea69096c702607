"""Decisions that change under other rules, and the comparison of two rule sets on a mission.

A mission set has no recorded plans. Therefore, the situation of each mission is simulated without a
model. Single orders that are possible in that situation are rehearsed, and each rehearsal is
checked under both rule sets.
"""

import asyncio
import random
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Literal

from pa_console.mission.rehearse import rehearse
from pa_console.policy.monitor import Monitor
from pa_console.policy.rule_checks import check_mission, check_plan
from pa_console.policy.rule_variables import Sightings
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.command import COMMANDS
from pa_console.schema.evaluation import MissionCase
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action, Plan
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from pa_console.station.headless import SETUP_SETTLE_S

EPOCH = datetime(2000, 1, 1, tzinfo=UTC)

Findings = tuple[Finding, ...]

FlipKind = Literal["finding", "plan", "decision", "intake", "halt"]
FLIP_KINDS: tuple[FlipKind, ...] = ("intake", "finding", "plan", "decision", "halt")
NONE = "no such rule"


@dataclass(frozen=True)
class ChangedDecision:
    """A decision that changes under other rules; `rules` are the rules that change it.

    The kinds name the result that changes:

    finding   the finding of a rule for a plan
    plan      whether the plan is blocked
    decision  whether the operator's decision is accepted
    intake    whether a mission is taken or refused before any model runs
    halt      whether a running plan is halted because an ordering is broken

    `plan` has the orders of the plan in words, or is '' at intake.
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
    """A decision that cannot be repeated from the log, and the reason for this.

    Attempt 0 is the intake. `rule` is '' if the reason applies to all rules.
    """

    mission: str
    attempt: int
    rule: str
    reason: str


@dataclass
class SessionEffect:
    """The effect of a rule set on one session; `compared` is the number of findings compared."""

    session: str = ""
    missions: int = 0
    plans: int = 0
    compared: int = 0
    flips: list[ChangedDecision] = field(default_factory=list[ChangedDecision])
    gaps: list[Gap] = field(default_factory=list[Gap])


def by_rule(findings: Iterable[Finding]) -> dict[str, Finding]:
    """Return `findings` by the ids of their rules."""
    return {finding.rule_id: finding for finding in findings}


def blocking(findings: Iterable[Finding]) -> list[Finding]:
    """Return the findings that block a plan."""
    return [finding for finding in findings if finding.blocking]


def differ(first: Finding | None, second: Finding | None) -> bool:
    """Return True if two findings of a rule differ in being broken, blocking or an error.

    A missing finding counts as not broken.
    """
    return _meaning(first) != _meaning(second)


def status_in_words(finding: Finding | None) -> str:
    """Return the status of a finding in words, with the priority if the rule is broken."""
    if finding is None:
        return NONE
    return f"{finding.status} ({finding.priority})" if finding.broken else finding.status


def in_words(findings: Iterable[Finding]) -> str:
    """Return the rules and messages of findings as one text."""
    return "; ".join(f"{finding.rule_id}: {finding.message}" for finding in findings)


def orders_of(plan: Plan) -> str:
    """Return the orders of a plan in words."""
    return ", ".join(f"{a.agent} {a.command}" for a in plan.actions) or "no orders"


def intake_flips(mission: str, was: list[Finding], now: list[Finding]) -> list[ChangedDecision]:
    """Return the change of a mission's intake, if any.

    `was` and `now` are the blocking findings under the earlier and the new rules.
    """
    if bool(was) == bool(now):
        return []
    states = ("refused", "taken") if was else ("taken", "refused")
    why = tuple(finding.rule_id for finding in was or now)
    return [ChangedDecision("intake", mission, 0, "", why, *states, in_words(was or now))]


def plan_flips(  # noqa: PLR0917 - one plan, and its findings under two rule sets
    mission: str,
    attempt: int,
    orders: str,
    was: Findings,
    now: Findings,
    doubtful: Collection[str] = (),
) -> list[ChangedDecision]:
    """Return the changed finding of each rule, then the change of the approval, if any.

    Rules in `doubtful` are left out. The approval is compared only if `doubtful` is empty.
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
            if blocking(
                finding for finding in (old.get(rule), new.get(rule)) if finding is not None
            )
        )
        words = in_words(blocked or blocks)
        flips.append(ChangedDecision("plan", mission, attempt, orders, because, *states, words))
    return flips


def rules_turned(flips: Iterable[ChangedDecision]) -> Iterator[tuple[str, int]]:
    """Yield each rule with the number of decisions that it changes, the highest number first."""
    counts = Counter(rule for flip in flips for rule in flip.rules)
    yield from sorted(counts.items(), key=lambda item: (-item[1], item[0]))


def _meaning(finding: Finding | None) -> tuple[bool, bool, bool]:
    if finding is None:
        return (False, False, False)
    return (finding.broken, finding.blocking, finding.status == "error")


def effect_on_mission(  # noqa: PLR0917 - a mission, both rule sets, and the limits of the trial
    case: MissionCase,
    world: World,
    new: Rulebook,
    was: Rulebook,
    plans: int,
    seed: int,
    tried: Callable[[], None] = lambda: None,
) -> SessionEffect:
    """Return the decisions that change on one mission: on its intake and on some single orders.

    If more than `plans` single orders are possible, `seed` determines which of them are tried.
    `tried` is called after each plan. Raises ValueError if the set-up cannot be simulated.
    """
    effect = SessionEffect(missions=1)
    mission = Mission(id=case.id, text=case.command, created=EPOCH)
    effect.flips += intake_flips(
        case.id, *(blocking(check_mission(book, mission, world)) for book in (was, new))
    )
    sim = Checkpoint(world, seed)
    sightings = _begin(sim, case)
    for number, plan in enumerate(_plans(world, plans, seed), start=1):
        rehearsal = asyncio.run(rehearse(sim, plan))
        old, now = (
            check_plan(
                book,
                plan=plan,
                rehearsal=rehearsal,
                mission=mission,
                world=world,
                monitor=Monitor(book, world, sightings),
            )
            for book in (was, new)
        )
        effect.plans += 1
        effect.compared += len({*by_rule(old), *by_rule(now)})
        effect.flips += plan_flips(case.id, number, orders_of(plan), old, now)
        tried()
    return effect


def _begin(sim: Checkpoint, case: MissionCase) -> Sightings:
    """Simulate the mission's set-up in the same way as an evaluation; return the sightings."""
    seen = Sightings(sim.world)
    seen.look(sim.picture())
    for incident in case.setup:
        sim.inject(incident)
    for _ in range(round(SETUP_SETTLE_S / sim.world.dt_s)):
        sim.step()
        seen.look(sim.picture())
    return seen


def _plans(world: World, most: int, seed: int) -> list[Plan]:
    """Return the plan without orders, and at most `most` plans of one order each."""
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
