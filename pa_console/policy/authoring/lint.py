"""Lint of a rule set that can be loaded: gaps, repetitions, disagreements."""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import combinations
from typing import Literal

from rapidfuzz import fuzz

from pa_console.policy.authoring.examples import MISSION_TEXT
from pa_console.policy.authoring.lint_search import (
    Conflicts,
    Doubt,
    never_applicable,
    search_states,
    shadowed,
)
from pa_console.policy.authoring.lint_states import drawn_states, example_states, small_world
from pa_console.policy.authoring.lint_text import FOUND_AMONG, NameLint, hard_to_retrieve
from pa_console.policy.retrieval.retriever import Retriever
from pa_console.schema.document import Document
from pa_console.schema.rule import Rule, RuleSet
from pa_console.schema.world import World

NEAR = 88.0
"""The likeness, in percent and in any word order, at which texts are nearly the same."""

CONFLICTS_OF = 10
"""The number of drawn states for each situation that is searched for a contradiction."""

Severity = Literal["error", "warning", "note"]
_SEVERITY: Mapping[str, Severity] = {
    "contradiction": "error",
    "cannot decide": "error",
    "unknown name": "error",
    "shadowed": "note",
}


@dataclass(frozen=True)
class LintFinding:
    """One doubt about a rule: where, what, and what to do; `line` is 1-based.

    An error keeps the rule from doing what it is for, a warning may; a note is no fault by itself.
    """

    rule: str
    line: int
    kind: str
    problem: str
    remedy: str
    severity: Severity = "warning"


@dataclass
class Searched:
    """The doubts that searching brought up, and the extent of the search."""

    findings: list[LintFinding] = field(default_factory=list[LintFinding])
    states: int = 0
    examples: int = 0
    situations: int = 0
    plans: int = 0
    seed: int = 0
    world: str = ""

    @property
    def words(self) -> str:
        """The extent of the search, in words."""
        return (
            f"{self.states} states ({self.examples} of examples), {self.situations} situations "
            f"with {self.plans} plans, in a small world after {self.world!r}, seed {self.seed}"
        )


def lint_rules(document: Document, rule_set: RuleSet, world: World) -> list[LintFinding]:
    """Return every doubt about `rule_set`, read from `document`, by the line that it is about.

    `world` says which names are assets and gates. Nothing is run but the retriever.
    """
    names = NameLint(world)
    return _placed(
        document,
        rule_set,
        [
            *(doubt for rule in rule_set.rules for doubt in _examples(rule)),
            *_repetitions(rule_set.rules),
            *(Doubt(rule, *doubt) for rule in rule_set.rules for doubt in names.doubts(rule)),
            *_hard_to_find(rule_set.rules),
        ],
    )


def search_rules(  # noqa: PLR0917 - a rule set, where, and how much is searched
    document: Document,
    rule_set: RuleSet,
    world: World,
    states: int,
    seed: int = 0,
    step: Callable[[], None] = lambda: None,
) -> Searched:
    """Run the rules in the states of their examples, and in as many `states` drawn by `seed`.

    Then say them in other words. `step` is called `search_steps` times. Raises ExpressionError
    for a rule that does not compile.
    """
    rules = rule_set.rules
    small = small_world(world, NameLint(world).named(rules))
    given = list(example_states(rules))
    texts = [MISSION_TEXT, *(rule.text for rule in rules)]
    drawn = drawn_states(small, texts, states, seed)
    search = search_states(rules, (state for part in (given, drawn) for state in part), step)
    conflicts = Conflicts(rules, small, seed)
    doubts = [
        *never_applicable(rules, search),
        *shadowed(rules, search),
        *conflicts.doubts(states // CONFLICTS_OF, step),
        *hard_to_retrieve(rules),
    ]
    return Searched(
        _placed(document, rule_set, doubts),
        search.states,
        len(given),
        conflicts.situations,
        conflicts.plans,
        seed,
        world.name,
    )


def search_steps(rule_set: RuleSet, states: int) -> int:
    """Return how often `search_rules` calls its `step`, for a progress bar."""
    return len(list(example_states(rule_set.rules))) + states + states // CONFLICTS_OF


def _placed(document: Document, rule_set: RuleSet, doubts: list[Doubt]) -> list[LintFinding]:
    """Return `doubts` with their lines, in the order of the file."""
    places = {rule.id: index for index, rule in enumerate(rule_set.rules)}
    found = [
        LintFinding(
            doubt.rule.id,
            document.line(("rules", places[doubt.rule.id], doubt.field)),
            doubt.kind,
            doubt.problem,
            doubt.remedy,
            _SEVERITY.get(doubt.kind, "warning"),
        )
        for doubt in doubts
    ]
    return sorted(found, key=lambda finding: (finding.line, finding.kind))


def _examples(rule: Rule) -> Iterator[Doubt]:
    if not rule.decidable:
        return
    expected = {example.expect for example in rule.examples}
    if not rule.examples:
        remedy = "add examples: a plan that must pass and one that must fail"
        problem = "nothing shows that its check does what it says"
        yield Doubt(rule, "check", "no examples", problem, remedy)
        return
    for expect, problem in (("fail", "breaks it"), ("pass", "complies with it")):
        if expect not in expected:
            remedy = f"add an example with expect: {expect}"
            yield Doubt(rule, "examples", "one-sided examples", f"no example {problem}", remedy)


def _repetitions(rules: tuple[Rule, ...]) -> Iterator[Doubt]:
    """Yield what two rules have in common, at the second of them."""
    for first, second in combinations(rules, 2):
        likeness = _likeness(first.text, second.text)
        if likeness == 100.0:
            remedy = "take one of them out"
            yield Doubt(second, "text", "duplicate", f"its text is that of {first.id}", remedy)
        elif likeness >= NEAR:
            problem = f"its text is {likeness:.0f} % that of {first.id}"
            remedy = "join them, or say how they differ"
            yield Doubt(second, "text", "near-duplicate", problem, remedy)
        for name, part in _PARTS:
            if part(first) and part(first) == part(second):
                problem = f"it decides the same as {first.id}"
                remedy = "take one out, or narrow its guard"
                yield Doubt(second, name, "same check", problem, remedy)


def _hard_to_find(rules: tuple[Rule, ...]) -> Iterator[Doubt]:
    """Yield the rules that a mission in their own words does not bring to the models."""
    retriever = Retriever(rules)
    for rule in rules:
        hits = [hit.rule_id for hit in retriever.retrieve(rule.text, FOUND_AMONG)]
        if rule.id not in hits:
            others = ", ".join(hits[-FOUND_AMONG:])
            problem = f"its own text finds {others} before it"
            remedy = "give it tags, or words of its own"
            yield Doubt(rule, "text", "hard to retrieve", problem, remedy)


def _likeness(a: str, b: str) -> float:
    return fuzz.token_sort_ratio(
        *(" ".join(re.findall(r"\w+", text.casefold())) for text in (a, b))
    )


def _check_of(rule: Rule) -> object:
    """Return guard and check without their white space, None for no check."""
    if rule.check is None:
        return None
    return ["".join(part.split()) for part in (rule.applies or "", rule.check)]


def _order_of(rule: Rule) -> object:
    return [order.model_dump(exclude={"message"}) for order in rule.order]


_PARTS: tuple[tuple[str, Callable[[Rule], object]], ...] = (
    ("check", _check_of),
    ("order", _order_of),
)
