"""Finds rules that never apply, and rules that decide nothing of their own, by searching states."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from pa_console.policy.checks import check_plan
from pa_console.policy.lint_states import State
from pa_console.policy.monitor import Monitor
from pa_console.policy.rulebook import CompiledRule, Rulebook, compile_rule
from pa_console.schema.rule import PRIORITIES, Rule

SEEN = 3
"""In how many states a rule must be broken before anything is said of who else is."""


class Doubt(NamedTuple):
    """What is doubtful about a rule, at which field of it, and what to do."""

    rule: Rule
    field: str
    kind: str
    problem: str
    remedy: str


@dataclass
class Seen:
    """What came of one rule in the searched states; each state is a bit."""

    applied: int = 0
    broken: int = 0
    failed: int = 0
    problem: str = ""


@dataclass
class Search:
    """Every rule's findings in `states` states, by the rule's id."""

    states: int = 0
    rules: dict[str, Seen] = field(default_factory=dict[str, Seen])


def checkable(rules: Iterable[Rule]) -> tuple[CompiledRule, ...]:
    """Return the rules that have a check, compiled, without their orderings."""
    return tuple(replace(compile_rule(rule), order=()) for rule in rules if rule.check is not None)


def search_states(
    rules: Iterable[Rule], states: Iterable[State], step: Callable[[], None] = lambda: None
) -> Search:
    """Return what every check decides in each of `states`; `step` is called after each."""
    book = Rulebook("searched", "", checkable(rules))
    search = Search(rules={rule.id: Seen() for rule in book.rules})
    for state in states:
        bit = 1 << search.states
        monitor = Monitor(book, state.world, state.sightings)
        for found in check_plan(
            book,
            plan=state.plan,
            rehearsal=state.rehearsal,
            mission=state.mission,
            world=state.world,
            monitor=monitor,
        ):
            seen = search.rules[found.rule_id]
            if found.status == "error":
                seen.failed |= bit
                seen.problem = seen.problem or found.message
            else:
                seen.applied |= bit if found.status != "not_applicable" else 0
                seen.broken |= bit if found.broken else 0
        search.states += 1
        step()
    return search


def never_applicable(rules: Iterable[Rule], search: Search) -> Iterator[Doubt]:
    """Yield the rules whose guard holds in no searched state, and those that never decide."""
    for rule in rules:
        seen = search.rules.get(rule.id)
        if seen is None or seen.applied:
            continue
        if seen.failed:
            problem = f"it cannot decide in any of {search.states} states: {seen.problem}"
            yield Doubt(rule, "check", "cannot decide", problem, "mend the expression")
        else:
            problem = f"its guard holds in none of {search.states} states that were searched"
            remedy = "mend the guard, or add an example in which it applies"
            yield Doubt(rule, "applies", "never applicable", problem, remedy)


def shadowed(rules: tuple[Rule, ...], search: Search) -> Iterator[Doubt]:
    """Yield the rules that are broken only where one at least as strict is broken too.

    Of two that are always broken together, the later one is named, unless their expressions are
    the same: that is seen by reading them.
    """
    for place, rule in enumerate(rules):
        seen = search.rules.get(rule.id)
        if seen is None or rule.order or seen.broken.bit_count() < SEEN:
            continue
        for other_place, other in enumerate(rules):
            by = search.rules.get(other.id)
            if by is None or other is rule or not _as_strict(other, rule):
                continue
            if (rule.applies, rule.check) == (other.applies, other.check):
                continue
            same = by.broken == seen.broken and _as_strict(rule, other)
            if seen.broken & ~by.broken or (same and other_place > place):
                continue
            count = seen.broken.bit_count()
            also = "the two always together" if same else f"{other.id} in others too"
            problem = f"whenever it is broken ({count} states), so is {other.id}; {also}"
            remedy = "take it out, narrow the other, or keep it for its own message"
            yield Doubt(rule, "check", "shadowed", problem, remedy)
            break


def _as_strict(rule: Rule, other: Rule) -> bool:
    return PRIORITIES.index(rule.priority) <= PRIORITIES.index(other.priority)
