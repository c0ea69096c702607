"""Lint of a rule's text: names missing in its check, and words that do not retrieve it.

The other words come from the vocabulary of retrieval, so that the method fits any rule.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from re import Pattern

import numpy as np

from pa_console.policy.authoring.lint_search import Doubt as LintSearchDoubt
from pa_console.policy.retrieval.inverted_index import words_of
from pa_console.policy.retrieval.related_words import Groups, Vocabulary, default_vocabulary
from pa_console.policy.retrieval.retriever import Retriever
from pa_console.schema.rule import Rule
from pa_console.schema.world import World

_PART = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")
_LOOKED_UP = re.compile(r"\b(gates|assets)\s*\[\s*['\"](\w+)['\"]\s*\]")

_GENERAL = re.compile(r"(?i)\bassets?\b")
"""A text that has it speaks of kinds that it does not name."""

Doubt = tuple[str, str, str, str]
"""Field, kind, problem, remedy."""


class NameLint:
    """Knows how a world's names are written: `NorthGate` is also "the north gate"."""

    def __init__(self, world: World) -> None:
        self._world = world.name
        self._known = {"gates": tuple(world.gates), "assets": tuple(world.assets)}
        self._named = {name: _spelling(name) for names in self._known.values() for name in names}
        self._kinds = tuple(world.platforms)

    def named(self, rules: Iterable[Rule]) -> frozenset[str]:
        """Return the assets and gates that texts or expressions of `rules` name."""
        whole = "\n".join(f"{rule.text}\n{_expressions(rule)}" for rule in rules)
        return frozenset(name for name, spelling in self._named.items() if spelling.search(whole))

    def doubts(self, rule: Rule) -> Iterator[Doubt]:
        """Yield where text and expressions disagree, and names that the world does not have."""
        code = _expressions(rule)
        if not code:
            return
        field = "check" if rule.check is not None else "order"
        for kind, name in sorted(set(_LOOKED_UP.findall(code))):
            if name not in self._known[kind]:
                known = ", ".join(self._known[kind])
                problem = f"it looks up {name!r} among the {kind} of {self._world!r}: not there"
                yield field, "unknown name", problem, f"name one of {known}, or go through all"
        said = {name for name, spelling in self._named.items() if spelling.search(rule.text)}
        coded = {name for name in self._named if re.search(rf"\b{re.escape(name)}\b", code)}
        if said != coded:
            problem = f"the text names {_list(said)}, the check {_list(coded)}"
            yield field, "text and check disagree", problem, "name the same in both"
        kinds = {kind for kind in self._kinds if re.search(rf"(?i)\b{kind}s?\b", rule.text)}
        coded_kinds = {kind for kind in self._kinds if re.search(rf"['\"]{kind}['\"]", code)}
        if kinds and coded_kinds and not kinds & coded_kinds and not _GENERAL.search(rule.text):
            problem = f"the text is about {_list(kinds)}, the check about {_list(coded_kinds)}"
            yield field, "text and check disagree", problem, "speak of the same kind in both"


def _spelling(name: str) -> Pattern[str]:
    """Return what finds `name` in a sentence; one of a single word must have its capitals."""
    parts = _PART.findall(name)
    joined = r"[\s_-]*".join(map(re.escape, parts)) if parts else re.escape(name)
    return re.compile(rf"\b{joined}\b", re.IGNORECASE if len(parts) > 1 else re.NOFLAG)


def _expressions(rule: Rule) -> str:
    """Return all CEL of `rule`."""
    parts = [rule.applies, rule.check]
    for order in rule.order:
        parts += [order.event, order.other]
    return "\n".join(part for part in parts if part)


def _list(names: set[str]) -> str:
    return ", ".join(sorted(names)) or "none"


FOUND_AMONG = 3
"""The number of rules retrieved for a mission beside the pinned ones (paper, Step 3)."""

FEWEST = 0.5
"""The share of a rule's paraphrases that has to retrieve it."""


class Paraphraser:
    """Makes paraphrases of rules; equal rules give equal paraphrases."""

    def __init__(self, vocabulary: Vocabulary | None = None) -> None:
        """`vocabulary` gives the synonyms; default: the installed one."""
        known = default_vocabulary() if vocabulary is None else vocabulary
        self._groups = Groups(known)
        self._members = tuple(known.groups.values())

    def paraphrases(self, rule: Rule) -> dict[str, str]:
        """Return other words for `rule` by how they were made.

        Its words backwards, every other one left out, half of them or all replaced by synonyms,
        its tags, and the missions of its examples.
        """
        words = [word for word in words_of(rule.text) if word not in self._groups.ignored]
        other = [self._synonym(word, number) for number, word in enumerate(words)]
        texts = {
            "word order": words[::-1],
            "first half left out": words[len(words) // 2 :],
            "every second word": words[::2],
            "every other second word": words[1::2],
            "synonyms for every second word": _mixed(words, other, 0),
            "synonyms for every other second word": _mixed(words, other, 1),
            "tags": words_of(" ".join(rule.tags)),
        }
        made = {name: " ".join(parts) for name, parts in texts.items() if parts}
        missions = dict.fromkeys(e.mission for e in rule.examples if e.mission)
        made |= {f"mission {text!r}": text for text in missions}
        return made

    def _synonym(self, word: str, number: int) -> str:
        """Return another word of the group that `word` fits best, itself if there is none."""
        fit = self._groups.fit(word)
        if not len(fit) or not fit.any():
            return word
        members = [m for m in self._members[int(np.argmax(fit))] if m != word]
        return members[number % len(members)] if members else word


def hard_to_retrieve(
    rules: Sequence[Rule], paraphraser: Paraphraser | None = None
) -> Iterator[LintSearchDoubt]:
    """Yield the rules that less than FEWEST of their paraphrases find among FOUND_AMONG.

    Critical rules are always shown to the models, and so are never hard to retrieve. A rule that
    not even its own text finds needs no paraphrase to tell.
    """
    made = paraphraser or Paraphraser()
    retriever = Retriever(rules)
    for rule in rules:
        if rule.priority == "critical" or not _finds(retriever, rule.text, rule):
            continue
        texts = made.paraphrases(rule)
        lost = [name for name, text in texts.items() if not _finds(retriever, text, rule)]
        found = len(texts) - len(lost)
        if found < FEWEST * len(texts):
            problem = (
                f"only {found} of {len(texts)} paraphrases find it, not: {', '.join(lost[:3])}"
                f"{f' and {len(lost) - 3} more' if len(lost) > 3 else ''}"
            )
            remedy = "give it tags that operators use, or words of its own"
            yield LintSearchDoubt(rule, "text", "hard to retrieve", problem, remedy)


def _finds(retriever: Retriever, text: str, rule: Rule) -> bool:
    return rule.id in {hit.rule_id for hit in retriever.retrieve(text, FOUND_AMONG)}


def _mixed(words: Sequence[str], other: Sequence[str], odd: int) -> list[str]:
    """Return `words` with every second one taken from `other`."""
    return [
        b if number % 2 == odd else a
        for number, (a, b) in enumerate(zip(words, other, strict=True))
    ]
