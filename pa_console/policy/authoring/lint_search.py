"""Lint by a search of states: rules that never apply, decide nothing, or contradict each other."""

import random
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import NamedTuple

from pa_console.policy.authoring.lint_states import (
    LintSituation,
    SearchState,
    draw_situation,
    mission_of,
    rehearsal_of,
)
from pa_console.policy.monitor import Monitor
from pa_console.policy.rule_checks import check_plan
from pa_console.policy.rulebook import CompiledRule, Rulebook, compile_rule
from pa_console.schema.command import COMMANDS
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rule import PRIORITIES, Rule
from pa_console.schema.world import World

SEEN = 3
"""The number of states in which a rule must be broken before it is reported as shadowed."""

SINGLE = 48
"""The number of single orders that are tried in a situation."""

SEVERAL = 96
"""The number of plans with two to MOST orders that are tried after the single orders."""

MOST = 4

HARD = 8
"""The number of situations without a valid plan after which the search ends."""

LARGEST = 3
"""The largest number of rules in a contradiction."""

REASON = "the track is there; the gate has no cover"


class Doubt(NamedTuple):
    """A doubt about a rule: the field concerned, the problem and the remedy."""

    rule: Rule
    field: str
    kind: str
    problem: str
    remedy: str


@dataclass
class SearchedRule:
    """The results of one rule in the searched states, one bit per state."""

    applied: int = 0
    broken: int = 0
    failed: int = 0
    problem: str = ""


@dataclass
class Search:
    """The findings of every rule in `states` states, by rule id."""

    states: int = 0
    rules: dict[str, SearchedRule] = field(default_factory=dict[str, SearchedRule])


def checkable(rules: Iterable[Rule]) -> tuple[CompiledRule, ...]:
    """Return the rules with a check, compiled without their orderings."""
    return tuple(replace(compile_rule(rule), order=()) for rule in rules if rule.check is not None)


def search_states(
    rules: Iterable[Rule], states: Iterable[SearchState], step: Callable[[], None] = lambda: None
) -> Search:
    """Return the decision of every check in each of `states`; `step` is called after each state."""
    book = Rulebook("searched", "", checkable(rules))
    search = Search(rules={rule.id: SearchedRule() for rule in book.rules})
    for state in states:
        bit = 1 << search.states
        monitor = Monitor(book, state.world, state.sightings)
        for finding in check_plan(
            book,
            plan=state.plan,
            rehearsal=state.rehearsal,
            mission=state.mission,
            world=state.world,
            monitor=monitor,
        ):
            seen = search.rules[finding.rule_id]
            if finding.status == "error":
                seen.failed |= bit
                seen.problem = seen.problem or finding.message
            else:
                seen.applied |= bit if finding.status != "not_applicable" else 0
                seen.broken |= bit if finding.broken else 0
        search.states += 1
        step()
    return search


def never_applicable(rules: Iterable[Rule], search: Search) -> Iterator[Doubt]:
    """Yield the rules whose guard holds in no searched state, and the rules that never decide."""
    for rule in rules:
        seen = search.rules.get(rule.id)
        if seen is None or seen.applied:
            continue
        if seen.failed:
            problem = f"it cannot decide in any of {search.states} states: {seen.problem}"
            yield Doubt(rule, "check", "cannot decide", problem, "correct the expression")
        else:
            problem = f"its guard holds in none of the {search.states} searched states"
            remedy = "correct the guard, or add an example in which the rule applies"
            yield Doubt(rule, "applies", "never applicable", problem, remedy)


def shadowed(rules: tuple[Rule, ...], search: Search) -> Iterator[Doubt]:
    """Yield each rule that is only broken in states where a rule at least as strict is broken too.

    If two rules are always broken together, the later rule is reported. Rules with the same
    expressions are not reported here, because `lint_rules` reports them.
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
            also = "both always are" if same else f"{other.id} also in others"
            problem = f"whenever it is broken ({count} states), so is {other.id}; {also}"
            remedy = "remove it, narrow the other, or keep it for its message"
            yield Doubt(rule, "check", "shadowed", problem, remedy)
            break


def _as_strict(rule: Rule, other: Rule) -> bool:
    return PRIORITIES.index(rule.priority) <= PRIORITIES.index(other.priority)


Broken = frozenset[str]


class Conflicts:
    """A search for situations in which every plan breaks a rule that cannot be overridden."""

    def __init__(self, rules: Sequence[Rule], world: World, seed: int) -> None:
        """Select the Critical and High checks that a plan can satisfy."""
        entries = [e for e in checkable(rules) if not e.about_mission_only and e.rule.enforced]
        self._book = Rulebook("enforced", "", tuple(entries))
        self._world, self._dice = world, random.Random(seed)
        self._mission = mission_of("Secure the checkpoint.")
        self.situations = self.plans = 0
        """The numbers of situations and plans that were searched."""

    def doubts(self, count: int, step: Callable[[], None] = lambda: None) -> Iterator[Doubt]:
        """Search up to `count` situations, the ordinary one first; call `step` after each."""
        reported: set[tuple[str, ...]] = set()
        hard = 0
        for number in range(count):
            situation = draw_situation(self._world, self._dice) if number else LintSituation()
            self.situations += 1
            broken = self._every_plan(situation) if hard < HARD else []
            step()
            if not broken:
                continue
            hard += 1
            rules = _fewest(self._book, broken)
            if rules and rules not in reported:
                reported.add(rules)
                yield self._doubt(rules, situation, len(broken))

    def _every_plan(self, situation: LintSituation) -> list[Broken]:
        """Return the rules that each tried plan breaks; empty as soon as one plan breaks none."""
        tried: dict[tuple[Action, ...], Broken] = {}

        def sound(*orders: Action) -> bool:
            if orders not in tried:
                tried[orders] = self._broken(situation, Plan(reason=REASON, actions=orders))
            return not tried[orders]

        if sound() or sound(*(Action(agent=name, command="hold") for name in self._world.assets)):
            return []
        orders = self._orders(situation)
        if any(sound(order) for order in orders[:SINGLE]):
            return []
        if any(sound(*plan) for plan in self._together(situation, orders)):
            return []
        several = (
            self._dice.sample(orders, min(len(orders), self._dice.randint(2, MOST)))
            for _ in range(SEVERAL)
        )
        return [] if any(sound(*plan) for plan in several) else list(tried.values())

    def _together(
        self, situation: LintSituation, orders: Sequence[Action]
    ) -> Iterator[tuple[Action, ...]]:
        """Yield plans with the same one or two commands for every place with a track."""
        places = dict.fromkeys(str(facts["gate"]) for facts in situation.tracks.values())
        verbs = sorted({order.verb for order in orders if order.target is not None})
        for allowed in (*((verb,) for verb in verbs), *combinations(verbs, 2)):
            plan: dict[str, Action] = {}
            for place in places:
                for verb in allowed:
                    able = (o for o in orders if o.verb == verb and o.target == place)
                    chosen = next((o for o in able if o.agent not in plan), None)
                    if chosen is not None:
                        plan[chosen.agent] = chosen
            yield tuple(plan.values())

    def _broken(self, situation: LintSituation, plan: Plan) -> Broken:
        self.plans += 1
        findings = check_plan(
            self._book,
            plan=plan,
            rehearsal=rehearsal_of(self._world, situation, plan),
            mission=self._mission,
            world=self._world,
            monitor=Monitor(self._book, self._world),
        )
        return frozenset(finding.rule_id for finding in findings if finding.status == "violates")

    def _orders(self, situation: LintSituation) -> list[Action]:
        """Return every possible order, shuffled; orders to places with tracks come first.

        Orders to unavailable assets come last.
        """
        idle = rehearsal_of(self._world, situation, Plan(reason=REASON, actions=()))
        usable = idle.before.assets
        places = {str(facts["gate"]) for facts in situation.tracks.values()}
        every = [
            Action(agent=agent, command=f"{verb} {frame}".strip())
            for agent, spec in self._world.assets.items()
            for verb, kinds in COMMANDS.items()
            if spec.kind in kinds.kinds
            for frame in (self._world.frames if kinds.takes_frame else ("",))
        ]
        self._dice.shuffle(every)
        return sorted(
            every, key=lambda order: (not usable[order.agent].available, order.target not in places)
        )

    def _doubt(self, rules: tuple[str, ...], situation: LintSituation, plans: int) -> Doubt:
        last = next(entry.rule for entry in reversed(self._book.compiled) if entry.rule.id in rules)
        where = f"none of {plans} plans, not even a hold, in this situation: {situation.words}"
        if len(rules) == 1:
            problem = f"it is satisfied by {where}"
            remedy = "let its guard leave out situations that no plan can resolve"
            return Doubt(last, "check", "unsatisfiable", problem, remedy)
        others = " and ".join(name for name in rules if name != last.id)
        problem = f"together with {others}, it is satisfied by {where}"
        return Doubt(last, "check", "contradiction", problem, "narrow the guard of one of them")


def _fewest(book: Rulebook, broken: Sequence[Broken]) -> tuple[str, ...]:
    """Return the smallest set of rules that no plan satisfies, in file order; () if too large."""
    named = frozenset[str]().union(*broken)
    candidates = [rule.id for rule in book.rules if rule.id in named]
    for size in range(1, LARGEST + 1):
        for rules in combinations(candidates, size):
            if all(not plan.isdisjoint(rules) for plan in broken):
                return rules
    return ()
