"""Finds what is doubtful in a rule set that can be loaded: gaps, repetitions, disagreements."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import combinations

from rapidfuzz import fuzz

from pa_console.policy.lint_names import NameLint
from pa_console.policy.retriever import Retriever
from pa_console.schema.document import Document
from pa_console.schema.rule import Rule, RuleSet
from pa_console.schema.world import World

NEAR = 88.0
"""From what likeness on, in percent whatever the order of words, texts are nearly the same."""

FOUND_AMONG = 3
"""How many rules are retrieved for a mission beside the pinned ones (paper, Step 3)."""


@dataclass(frozen=True)
class LintFinding:
    """One doubt about a rule: where, what, and what to do; `line` is 1-based."""

    rule: str
    line: int
    kind: str
    problem: str
    remedy: str


def lint_rules(document: Document, rule_set: RuleSet, world: World) -> list[LintFinding]:
    """Return every doubt about `rule_set`, read from `document`, by the line that it is about.

    `world` says which names are assets and gates. Nothing is run but the retriever.
    """
    places = {rule.id: index for index, rule in enumerate(rule_set.rules)}

    def at(rule: Rule, field: str, kind: str, problem: str, remedy: str) -> LintFinding:
        line = document.line(("rules", places[rule.id], field))
        return LintFinding(rule.id, line, kind, problem, remedy)

    names = NameLint(world)
    found = [
        *(at(*doubt) for rule in rule_set.rules for doubt in _examples(rule)),
        *(at(*doubt) for doubt in _repetitions(rule_set.rules)),
        *(at(rule, *doubt) for rule in rule_set.rules for doubt in names.doubts(rule)),
        *(at(*doubt) for doubt in _hard_to_find(rule_set.rules)),
    ]
    return sorted(found, key=lambda finding: (finding.line, finding.kind))


_Doubt = tuple[Rule, str, str, str, str]


def _examples(rule: Rule) -> Iterator[_Doubt]:
    if not rule.decidable:
        return
    expected = {example.expect for example in rule.examples}
    if not rule.examples:
        remedy = "add examples: a plan that must pass and one that must fail"
        yield rule, "check", "no examples", "nothing shows that its check does what it says", remedy
        return
    for expect, problem in (("fail", "breaks it"), ("pass", "complies with it")):
        if expect not in expected:
            remedy = f"add an example with expect: {expect}"
            yield rule, "examples", "one-sided examples", f"no example {problem}", remedy


def _repetitions(rules: tuple[Rule, ...]) -> Iterator[_Doubt]:
    """Yield what two rules have in common, at the second of them."""
    for first, second in combinations(rules, 2):
        likeness = _likeness(first.text, second.text)
        if likeness == 100.0:
            remedy = "take one of them out"
            yield second, "text", "duplicate", f"its text is that of {first.id}", remedy
        elif likeness >= NEAR:
            problem = f"its text is {likeness:.0f} % that of {first.id}"
            yield second, "text", "near-duplicate", problem, "join them, or say how they differ"
        for field, part in _PARTS:
            if part(first) and part(first) == part(second):
                problem = f"it decides the same as {first.id}"
                yield second, field, "same check", problem, "take one out, or narrow its guard"


def _hard_to_find(rules: tuple[Rule, ...]) -> Iterator[_Doubt]:
    """Yield the rules that a mission in their own words does not bring to the models."""
    retriever = Retriever(rules)
    for rule in rules:
        hits = [hit.rule_id for hit in retriever.retrieve(rule.text, FOUND_AMONG)]
        if rule.id not in hits:
            others = ", ".join(hits[-FOUND_AMONG:])
            problem = f"its own text finds {others} before it"
            yield rule, "text", "hard to retrieve", problem, "give it tags, or words of its own"


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
