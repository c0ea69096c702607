"""Decisions that change under other rules, and decisions that the log cannot settle."""

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Literal

from pa_console.schema.finding import Finding
from pa_console.schema.plan import Plan

FlipKind = Literal["finding", "plan", "decision", "intake", "halt"]
FLIP_KINDS: tuple[FlipKind, ...] = ("intake", "finding", "plan", "decision", "halt")
Findings = tuple[Finding, ...]
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
