"""Finds checks that contradict each other: situations of a small world that no plan satisfies."""

import random
from collections.abc import Callable, Iterator, Sequence
from itertools import combinations

from pa_console.policy.checks import check_plan
from pa_console.policy.lint_search import Doubt, checkable
from pa_console.policy.lint_states import draw_situation, mission_of
from pa_console.policy.lint_world import Situation, rehearsal_of
from pa_console.policy.monitor import Monitor
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.plan import COMMANDS, Action, Plan
from pa_console.schema.rule import Rule
from pa_console.schema.world import World

SINGLE = 48
"""How many single orders are tried, drawn from all."""

SEVERAL = 96
"""How many plans of two to MOST orders are drawn besides."""

MOST = 4

HARD = 8
"""After so many situations without a sound plan, no more are searched."""

LARGEST = 3
"""How many rules a contradiction may be between."""

REASON = "the track is there; the gate has no cover"
Broken = frozenset[str]


class Conflicts:
    """Searches situations for one in which every plan breaks a rule that nobody may override."""

    def __init__(self, rules: Sequence[Rule], world: World, seed: int) -> None:
        """Critical and High checks that a plan can satisfy at all are looked at."""
        entries = [e for e in checkable(rules) if not e.about_mission_only and e.rule.enforced]
        self._book = Rulebook("enforced", "", tuple(entries))
        self._world, self._dice = world, random.Random(seed)
        self._mission = mission_of("Secure the checkpoint.")
        self.situations = self.plans = 0
        """How many were searched."""

    def doubts(self, count: int, step: Callable[[], None] = lambda: None) -> Iterator[Doubt]:
        """Search up to `count` situations, the ordinary one first; `step` is called after each."""
        told: set[tuple[str, ...]] = set()
        hard = 0
        for number in range(count):
            situation = draw_situation(self._world, self._dice) if number else Situation()
            self.situations += 1
            broken = self._every_plan(situation) if hard < HARD else []
            step()
            if not broken:
                continue
            hard += 1
            rules = _fewest(self._book, broken)
            if rules and rules not in told:
                told.add(rules)
                yield self._doubt(rules, situation, len(broken))

    def _every_plan(self, situation: Situation) -> list[Broken]:
        """Return what each plan that was tried breaks; empty as soon as one breaks nothing."""
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
        self, situation: Situation, orders: Sequence[Action]
    ) -> Iterator[tuple[Action, ...]]:
        """Yield plans that do the same, or the same two things, wherever a track is."""
        places = dict.fromkeys(str(facts["gate"]) for facts in situation.tracks.values())
        verbs = sorted({order.verb for order in orders if order.target is not None})
        for wanted in (*((verb,) for verb in verbs), *combinations(verbs, 2)):
            plan: dict[str, Action] = {}
            for place in places:
                for verb in wanted:
                    able = (o for o in orders if o.verb == verb and o.target == place)
                    chosen = next((o for o in able if o.agent not in plan), None)
                    if chosen is not None:
                        plan[chosen.agent] = chosen
            yield tuple(plan.values())

    def _broken(self, situation: Situation, plan: Plan) -> Broken:
        self.plans += 1
        findings = check_plan(
            self._book,
            plan=plan,
            rehearsal=rehearsal_of(self._world, situation, plan),
            mission=self._mission,
            world=self._world,
            monitor=Monitor(self._book, self._world),
        )
        return frozenset(found.rule_id for found in findings if found.status == "violates")

    def _orders(self, situation: Situation) -> list[Action]:
        """Return every order that can be given, shuffled; those to where tracks are come first.

        Whoever is not available comes last.
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
            every,
            key=lambda order: (not usable[order.agent].available, order.target not in places),
        )

    def _doubt(self, rules: tuple[str, ...], situation: Situation, plans: int) -> Doubt:
        last = next(entry.rule for entry in reversed(self._book.compiled) if entry.rule.id in rules)
        where = f"none of {plans} plans, holding among them, where: {situation.words}"
        if len(rules) == 1:
            problem = f"it is satisfied by {where}"
            remedy = "let its guard leave out what no plan can mend"
            return Doubt(last, "check", "unsatisfiable", problem, remedy)
        others = " and ".join(name for name in rules if name != last.id)
        problem = f"together with {others} it is satisfied by {where}"
        return Doubt(
            last, "check", "contradiction", problem, "let one of them give way in its guard"
        )


def _fewest(book: Rulebook, broken: Sequence[Broken]) -> tuple[str, ...]:
    """Return the fewest rules of which every plan breaks one, first in file order; () for more."""
    named = frozenset[str]().union(*broken)
    known = [rule.id for rule in book.rules if rule.id in named]
    for size in range(1, LARGEST + 1):
        for rules in combinations(known, size):
            if all(not plan.isdisjoint(rules) for plan in broken):
                return rules
    return ()
