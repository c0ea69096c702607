"""Lint of a rule set that can be loaded: gaps, repetitions, disagreements.

Unknown names in a check are found by parsing the check. Rules that are hard to retrieve are found
with paraphrases from the retrieval vocabulary, so that the method works for any rule.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from re import Pattern
from typing import Literal

import numpy as np
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
from pa_console.policy.related_words import Groups, default_vocabulary, words_of
from pa_console.policy.retriever import Retriever
from pa_console.schema.document import Document
from pa_console.schema.rule import Rule, RuleSet
from pa_console.schema.world import World

_PART = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")
_LOOKED_UP = re.compile(r"\b(gates|assets)\s*\[\s*['\"](\w+)['\"]\s*\]")

_GENERAL = re.compile(r"(?i)\bassets?\b")
"""The word by which a text refers to kinds of assets without naming them."""

FOUND_AMONG = 3
"""The number of rules retrieved for a mission in addition to the pinned ones (paper, Step 3)."""

FEWEST = 0.5
"""The least share of a rule's paraphrases that must retrieve the rule."""
NEAR = 88.0
"""The least similarity of near-duplicates, in percent, whatever the order of their words."""

CONFLICTS_OF = 10
"""The number of drawn states for each situation that is searched for contradictions."""


class NameLint:
    """A comparison of names in rules with those of a world; `NorthGate` may be "the north gate"."""

    def __init__(self, world: World) -> None:
        self._world = world.name
        self._in_world = {"gates": tuple(world.gates), "assets": tuple(world.assets)}
        self._named = {name: _spelling(name) for names in self._in_world.values() for name in names}
        self._kinds = tuple(world.platforms)

    def named(self, rules: Iterable[Rule]) -> frozenset[str]:
        """Return the assets and gates that are named in texts or expressions of `rules`."""
        whole = "\n".join(f"{rule.text}\n{_expressions(rule)}" for rule in rules)
        return frozenset(name for name, spelling in self._named.items() if spelling.search(whole))

    def doubts(self, rule: Rule) -> Iterator[Doubt]:
        """Yield disagreements of text and expressions, and names that the world does not have."""
        code = _expressions(rule)
        if not code:
            return
        field = "check" if rule.check is not None else "order"
        for kind, name in sorted(set(_LOOKED_UP.findall(code))):
            if name not in self._in_world[kind]:
                names = ", ".join(self._in_world[kind])
                problem = f"it looks up {name!r}, but {self._world!r} has no such name in {kind}"
                yield Doubt(
                    rule, field, "unknown name", problem, f"use one of {names}, or a loop over all"
                )
        mentioned = {name for name, spelling in self._named.items() if spelling.search(rule.text)}
        coded = {name for name in self._named if re.search(rf"\b{re.escape(name)}\b", code)}
        if mentioned != coded:
            problem = f"the text names {_list(mentioned)}, the check {_list(coded)}"
            yield Doubt(
                rule, field, "text and check disagree", problem, "use the same names in both"
            )
        kinds = {kind for kind in self._kinds if re.search(rf"(?i)\b{kind}s?\b", rule.text)}
        coded_kinds = {kind for kind in self._kinds if re.search(rf"['\"]{kind}['\"]", code)}
        if kinds and coded_kinds and not kinds & coded_kinds and not _GENERAL.search(rule.text):
            problem = f"the text is about {_list(kinds)}, the check about {_list(coded_kinds)}"
            yield Doubt(
                rule, field, "text and check disagree", problem, "use the same kind in both"
            )


def _spelling(name: str) -> Pattern[str]:
    """Return a pattern for `name` in a sentence; a single-word name must have its capitals."""
    parts = _PART.findall(name)
    joined = r"[\s_-]*".join(map(re.escape, parts)) if parts else re.escape(name)
    return re.compile(rf"\b{joined}\b", re.IGNORECASE if len(parts) > 1 else re.NOFLAG)


def _expressions(rule: Rule) -> str:
    """Return all CEL expressions of `rule`."""
    parts = [rule.applies, rule.check]
    for order in rule.order:
        parts += [order.event, order.other]
    return "\n".join(part for part in parts if part)


def _list(names: set[str]) -> str:
    return ", ".join(sorted(names)) or "none"


class Paraphraser:
    """A paraphraser of rules; equal rules get equal paraphrases."""

    def __init__(self) -> None:
        """Take synonyms from the installed vocabulary."""
        vocabulary = default_vocabulary()
        self._groups = Groups.of(vocabulary)
        self._members = tuple(vocabulary.groups.values())

    def paraphrases(self, rule: Rule) -> dict[str, str]:
        """Return paraphrases of `rule`, by the way in which they were made.

        They are its words in reverse, parts of its words, its words with half of them replaced by
        synonyms, its tags, and the missions of its examples.
        """
        words = [word for word in words_of(rule.text) if word not in self._groups.ignored]
        other = [self._synonym(word, number) for number, word in enumerate(words)]
        texts = {
            "word order": words[::-1],
            "first half left out": words[len(words) // 2 :],
            "every second word": words[::2],
            "the other words": words[1::2],
            "synonyms for every second word": _mixed(words, other, 0),
            "synonyms for the other words": _mixed(words, other, 1),
            "tags": words_of(" ".join(rule.tags)),
        }
        made = {name: " ".join(parts) for name, parts in texts.items() if parts}
        missions = dict.fromkeys(e.mission for e in rule.examples if e.mission)
        made |= {f"mission {text!r}": text for text in missions}
        return made

    def _synonym(self, word: str, number: int) -> str:
        """Return another word of the group that `word` fits best, or `word` if there is none."""
        fit = self._groups.fit(word)
        if not len(fit) or not fit.any():
            return word
        members = [m for m in self._members[int(np.argmax(fit))] if m != word]
        return members[number % len(members)] if members else word


def hard_to_retrieve(rules: Sequence[Rule]) -> Iterator[Doubt]:
    """Yield the rules for which the share of paraphrases that retrieve them is below FEWEST.

    A rule is retrieved if it is among the first FOUND_AMONG. Critical rules are left out, because
    the models always see them, and so are rules that the models never see or that not even their
    own text retrieves.
    """
    made = Paraphraser()
    retriever = Retriever(rules)
    for rule in rules:
        if not rule.in_prompts or rule.priority == "critical":
            continue
        if not _finds(retriever, rule.text, rule):
            continue
        texts = made.paraphrases(rule)
        lost = [name for name, text in texts.items() if not _finds(retriever, text, rule)]
        retrieved = len(texts) - len(lost)
        if retrieved < FEWEST * len(texts):
            others = f"{', '.join(lost[:3])}{f' and {len(lost) - 3} more' if len(lost) > 3 else ''}"
            problem = f"{retrieved} of {len(texts)} paraphrases find it; these do not: {others}"
            remedy = "give it tags that operators use, or words of its own"
            yield Doubt(rule, "text", "hard to retrieve", problem, remedy)


def _finds(retriever: Retriever, text: str, rule: Rule) -> bool:
    return rule.id in {hit.rule_id for hit in retriever.retrieve(text, FOUND_AMONG)}


def _mixed(words: Sequence[str], other: Sequence[str], odd: int) -> list[str]:
    """Return `words` with every second word taken from `other`."""
    return [
        b if number % 2 == odd else a
        for number, (a, b) in enumerate(zip(words, other, strict=True))
    ]


Severity = Literal["error", "warning", "note"]
_SEVERITY: Mapping[str, Severity] = {
    "contradiction": "error",
    "cannot decide": "error",
    "unknown name": "error",
    "shadowed": "note",
}


@dataclass(frozen=True)
class LintFinding:
    """A doubt about a rule: its line, the problem and the remedy; `line` is 1-based.

    An error keeps the rule from doing its job; a warning may do so; a note is not a fault in
    itself.
    """

    rule: str
    line: int
    kind: str
    problem: str
    remedy: str
    severity: Severity = "warning"


@dataclass
class SearchDoubts:
    """The doubts that a search found, and the extent of the search."""

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
            f"with {self.plans} plans, in a small copy of {self.world!r}, seed {self.seed}"
        )


def lint_rules(document: Document, rule_set: RuleSet, world: World) -> list[LintFinding]:
    """Return every doubt about `rule_set`, read from `document`, sorted by line.

    `world` has the names of assets and gates. Only the retriever is run.
    """
    names = NameLint(world)
    return _placed(
        document,
        rule_set,
        [
            *(doubt for rule in rule_set.rules for doubt in _examples(rule)),
            *_repetitions(rule_set.rules),
            *(doubt for rule in rule_set.rules for doubt in names.doubts(rule)),
            *_hard_to_find(rule_set.rules),
        ],
    )


def search_rules(  # noqa: PLR0917 - a rule set, its world and the search
    document: Document,
    rule_set: RuleSet,
    world: World,
    states: int,
    seed: int = 0,
    step: Callable[[], None] = lambda: None,
) -> SearchDoubts:
    """Return the doubts from a search of the examples' states and `states` drawn states.

    Equal values of `seed` draw equal states. The rules are also paraphrased. `step` is called as
    many times as `search_steps` returns. Raises ExpressionError for a rule that does not compile.
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
    return SearchDoubts(
        _placed(document, rule_set, doubts),
        search.states,
        len(given),
        conflicts.situations,
        conflicts.plans,
        seed,
        world.name,
    )


def search_steps(rule_set: RuleSet, states: int) -> int:
    """Return the number of times that `search_rules` calls `step`, for a progress bar."""
    return len(list(example_states(rule_set.rules))) + states + states // CONFLICTS_OF


def _placed(document: Document, rule_set: RuleSet, doubts: list[Doubt]) -> list[LintFinding]:
    """Return `doubts` with their lines, in the order of the file."""
    places = {rule.id: index for index, rule in enumerate(rule_set.rules)}
    placed = [
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
    return sorted(placed, key=lambda finding: (finding.line, finding.kind))


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
    """Yield the repetitions between two rules, as doubts about the second one."""
    for first, second in combinations(rules, 2):
        likeness = _likeness(first.text, second.text)
        if likeness == 100.0:
            remedy = "remove one of them"
            yield Doubt(second, "text", "duplicate", f"its text equals that of {first.id}", remedy)
        elif likeness >= NEAR:
            problem = f"its text is {likeness:.0f} % the same as that of {first.id}"
            remedy = "merge them, or show how they differ"
            yield Doubt(second, "text", "near-duplicate", problem, remedy)
        for name, part in _PARTS:
            if part(first) and part(first) == part(second):
                problem = f"it decides exactly as {first.id} does"
                remedy = "remove one, or narrow its guard"
                yield Doubt(second, name, "same check", problem, remedy)


def _hard_to_find(rules: tuple[Rule, ...]) -> Iterator[Doubt]:
    """Yield the rules that are hard to retrieve.

    Such a rule is not among the first FOUND_AMONG retrieved for a mission worded exactly like it.
    """
    retriever = Retriever(rules)
    for rule in (rule for rule in rules if rule.in_prompts):
        hits = [hit.rule_id for hit in retriever.retrieve(rule.text, FOUND_AMONG)]
        if rule.id not in hits:
            others = ", ".join(hits[-FOUND_AMONG:])
            problem = f"its own text retrieves {others} before it"
            remedy = "give it tags, or words of its own"
            yield Doubt(rule, "text", "hard to retrieve", problem, remedy)


def _likeness(a: str, b: str) -> float:
    return fuzz.token_sort_ratio(
        *(" ".join(re.findall(r"\w+", text.casefold())) for text in (a, b))
    )


def _check_of(rule: Rule) -> object:
    """Return the guard and the check without white space; None without a check."""
    if rule.check is None:
        return None
    return ["".join(part.split()) for part in (rule.applies or "", rule.check)]


def _order_of(rule: Rule) -> object:
    return [order.model_dump(exclude={"message"}) for order in rule.order]


_PARTS: tuple[tuple[str, Callable[[Rule], object]], ...] = (
    ("check", _check_of),
    ("order", _order_of),
)
