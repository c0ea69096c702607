"""Finds the rules that concern a mission (paper, Steps 2 and 3); it never decides enforcement."""

import re
from collections.abc import Iterable

from rapidfuzz import fuzz

from pa_console.schema.rule import Rule, RuleHit

METHODS = ("paper",)
DEFAULT_METHOD = "paper"
_TOKEN = re.compile(r"\w+")


class Retriever:
    """Scores rule texts against a mission text by the paper's hybrid of two similarities.

    `fuzzy` is the sequence similarity of the lower-cased texts in [0, 1] (rapidfuzz's `ratio`,
    twice the longest common subsequence over the summed lengths). `jaccard` is the number of
    words in both texts over the number in either. The paper says the two are combined but not
    how: the score is their mean. Equal scores are ordered by rule id.
    """

    def __init__(self, rules: Iterable[Rule], method: str = "paper") -> None:
        """Prepare `rules`; raises ValueError for an unknown method."""
        if method not in METHODS:
            raise ValueError(f"unknown retrieval method {method!r}; known: {', '.join(METHODS)}")
        self.method = method
        self._rules = tuple((rule, rule.text.lower(), _tokens(rule.text)) for rule in rules)

    def retrieve(self, text: str, k: int = 3) -> tuple[RuleHit, ...]:
        """Return the pinned rules, then the `k` others that score best; no rule twice.

        Every Critical rule is pinned: whatever the mission says, the models see it. Raises
        ValueError for a negative `k`.
        """
        if k < 0:
            raise ValueError(f"cannot retrieve {k} rules")
        hits = self.score_all(text)
        pinned = [hit for hit in hits if hit.pinned]
        others = [hit for hit in hits if not hit.pinned]
        return (*pinned, *others[:k])

    def score_all(self, text: str) -> tuple[RuleHit, ...]:
        """Return every rule with its score and both components, best first."""
        lowered, tokens = text.lower(), _tokens(text)
        hits: list[RuleHit] = []
        for rule, rule_lowered, rule_tokens in self._rules:
            fuzzy = fuzz.ratio(lowered, rule_lowered) / 100.0
            jaccard = _jaccard(tokens, rule_tokens)
            hits.append(
                RuleHit(
                    rule_id=rule.id,
                    score=(fuzzy + jaccard) / 2.0,
                    components={"fuzzy": fuzzy, "jaccard": jaccard},
                    pinned=rule.priority == "critical",
                )
            )
        return tuple(sorted(hits, key=lambda hit: (-hit.score, hit.rule_id)))


def _tokens(text: str) -> frozenset[str]:
    return frozenset(_TOKEN.findall(text.lower()))


def _jaccard(first: frozenset[str], second: frozenset[str]) -> float:
    either = len(first | second)
    return len(first & second) / either if either else 0.0
