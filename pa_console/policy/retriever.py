"""Retrieval of the rules that concern a mission (paper, Steps 2 and 3); it enforces nothing."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from rapidfuzz import fuzz, process

from pa_console.policy.related_words import (
    Floats,
    Groups,
    Postings,
    Spelling,
    Vocabulary,
    default_vocabulary,
    ngrams,
    rule_words,
    words_of,
)
from pa_console.schema.rule import Rule, RuleHit

Scores = dict[str, Floats]
"""The parts of a score by name; each has one number per rule, in the order of the rules."""


DECIMALS = 9

K1, B = 1.2, 0.75
OFFSET = 60.0
"""The offset that makes the first places more equal; its value is that of Cormack, Clarke and
Buettcher (SIGIR 2009)."""
_WORD = re.compile(r"\w+")
ALIKE = 0.3
"""The least likeness at which a different spelling counts; its weight is the square of its
likeness."""
RELATED = 0.8
"""The weight of a related word; the same word has weight 1."""
LENGTH = 0.4
"""The penalty for longer rules: 0 is none, 1 is in proportion to their length."""
LEVELS = 10
"""The number of levels of nearness between rules and a word."""
_ROUNDING = 1e-9

DEFAULT_METHOD = "related"


def rounded(scores: Floats) -> Floats:
    """Return `scores` rounded to decimals that are the same on every processor.

    Processors differ in the last digits of a logarithm. Scores are rounded before they are
    compared, so that an order gets the same rules, and its log the same numbers, on every machine.
    """
    return np.round(scores, DECIMALS)


class RuleRanking(Protocol):
    """A ranking of a fixed list of rules: one score per rule, in their order; higher is better."""

    def scores(self, text: str) -> tuple[Floats, Scores]:
        """Return the score of each rule for `text`, and the parts of the scores."""
        ...


def best(scores: Floats, k: int) -> list[int]:
    """Return the places of the `k` highest scores, best first; equal scores keep their order."""
    if k <= 0 or not len(scores):
        return []
    if k < len(scores):
        least = np.partition(scores, len(scores) - k)[len(scores) - k]
        places = np.flatnonzero(scores >= least)
    else:
        places = np.arange(len(scores))
    order = np.argsort(-scores[places], kind="stable")
    return places[order[:k]].tolist()


class Bm25Ranking:
    """BM25: the sum, over the mission's terms, of a term's rarity times its weight in a rule.

    The inverse document frequency is Lucene's, which is never negative. `terms` returns the terms
    of a word; by default the word is the only term. A term counts once, however often the mission
    repeats it.
    """

    def __init__(
        self,
        rules: Sequence[Rule],
        part: str = "words",
        terms: Callable[[str], Iterable[str]] | None = None,
    ) -> None:
        """Index `rules`; `part` is the name of the score's only part."""
        self._part, self._terms = part, terms
        self._postings = Postings([rule_words(rule) for rule in rules], terms)
        mean = float(self._postings.lengths.mean()) if rules else 1.0
        self._damping = K1 * (1.0 - B + B * self._postings.lengths / max(mean, 1.0))

    def scores(self, text: str) -> tuple[Floats, Scores]:
        """Return the BM25 score of each rule."""
        size = self._postings.size
        scores = np.zeros(size)
        for term in self._distinct(text):
            places, counts = self._postings.of(term)
            weight = np.log1p((size - len(places) + 0.5) / (len(places) + 0.5))
            scores[places] += weight * counts * (K1 + 1.0) / (counts + self._damping[places])
        return scores, {self._part: scores}

    def _distinct(self, text: str) -> dict[str, None]:
        words = dict.fromkeys(words_of(text))
        if self._terms is None:
            return words
        return dict.fromkeys(term for word in words for term in self._terms(word))


class FusionRanking:
    """The sum of 1 / (OFFSET + place) over rankings of the same rules; equal scores tie."""

    def __init__(self, rankings: Mapping[str, RuleRanking]) -> None:
        """Fuse `rankings`; their names become the names of the score's parts."""
        self._rankings = dict(rankings)

    def scores(self, text: str) -> tuple[Floats, Scores]:
        """Return the fused score of each rule, and how much each ranking adds to it."""
        parts: Scores = {
            name: 1.0 / (OFFSET + 1.0 + _better(rounded(ranking.scores(text)[0])))
            for name, ranking in self._rankings.items()
        }
        return np.asarray(sum(parts.values()), dtype=np.float64), parts


def _better(scores: Floats) -> Floats:
    """Return, for each score, the number of higher scores."""
    higher = len(scores) - np.searchsorted(np.sort(scores), scores, side="right")
    return higher.astype(np.float64)


class PaperRanking:
    """The mean of the sequence similarity and the Jaccard similarity of two texts, in [0, 1].

    `fuzzy` is rapidfuzz's `ratio` of the lower-cased texts: twice the longest common subsequence,
    divided by the sum of the lengths. `jaccard` is the number of words in both texts, divided by
    the number of words in either. The paper states that the two are combined, but not how.
    """

    def __init__(self, rules: Sequence[Rule]) -> None:
        """Prepare the texts of `rules`."""
        self._texts = [rule.text.lower() for rule in rules]
        words = [sorted(_words(rule.text)) for rule in rules]
        self._postings = Postings(words)

    def scores(self, text: str) -> tuple[Floats, Scores]:
        """Return the mean of both similarities for each rule, and the two similarities."""
        if not self._texts:
            return np.zeros(0), {}
        ratios = process.cdist([text.lower()], self._texts, scorer=fuzz.ratio, dtype=np.float64)
        fuzzy = np.asarray(ratios[0], dtype=np.float64) / 100.0
        words = _words(text)
        both = np.zeros(self._postings.size)
        for word in words:
            both[self._postings.of(word)[0]] += 1.0
        either = np.maximum(self._postings.lengths + len(words) - both, 1.0)
        jaccard = both / either
        return (fuzzy + jaccard) / 2.0, {"fuzzy": fuzzy, "jaccard": jaccard}


def _words(text: str) -> set[str]:
    return set(_WORD.findall(text.lower()))


class RelatedRanking:
    """The share of a mission's words that a rule covers, by the same or related words.

    The nearness of a rule to a word of the mission is the nearness of its nearest word: 1 for the
    same word, the square of their likeness for a different spelling, and RELATED times the fit of
    both to a group of the vocabulary for a related word. Each nearness is weighted by its rarity:
    the logarithm of the ratio of all rules to the rules that are at least as near. So if many rules
    concern a topic, the few that use the mission's own word rank first. `words` is the score by
    spelling, `related` the score by vocabulary. Longer rules score lower.
    """

    def __init__(self, rules: Sequence[Rule], vocabulary: Vocabulary) -> None:
        """Index `rules` and compare their words with those of `vocabulary`."""
        self._groups = Groups.of(vocabulary)
        words = [
            sorted({word for word in rule_words(rule) if word not in self._groups.ignored})
            for rule in rules
        ]
        self._postings = Postings(words)
        self._spelling = Spelling(list(self._postings.terms))
        self._fits = np.array([self._groups.fit(word) for word in self._spelling.words])
        lengths = self._postings.lengths
        mean = max(float(lengths.mean()), 1.0) if len(rules) else 1.0
        self._held_back = 1.0 - LENGTH + LENGTH * lengths / mean

    def scores(self, text: str) -> tuple[Floats, Scores]:
        """Return the share of `text` that each rule covers, from 0 to about 1."""
        size = self._postings.size
        spelt, related, whole = np.zeros(size), np.zeros(size), 0.0
        for word in dict.fromkeys(words_of(text)):
            if word in self._groups.ignored:
                continue
            same, other = self._nearest(word)
            nearest = np.maximum(same, other)
            level = (nearest * LEVELS + _ROUNDING).astype(np.int64)
            telling = _telling(np.bincount(level, minlength=LEVELS + 1))
            worth = nearest * telling[level]
            spelt += np.where(same >= other, worth, 0.0)
            related += np.where(same >= other, 0.0, worth)
            whole += float(telling[LEVELS])
        scale = self._held_back * max(whole, 1e-9)
        spelt, related = spelt / scale, related / scale
        return spelt + related, {"words": spelt, "related": related}

    def _nearest(self, word: str) -> tuple[Floats, Floats]:
        """Return each rule's nearness to `word`, by spelling and by vocabulary."""
        alike = self._spelling.likeness(word)
        alike = np.where(alike >= ALIKE, alike**2, 0.0)
        fit = self._groups.fit(word)
        groups = np.flatnonzero(fit)
        if len(groups) and len(self._fits):
            akin = RELATED * (self._fits[:, groups] * fit[groups]).max(axis=1)
        else:
            akin = np.zeros(len(alike))
        return self._spread(alike), self._spread(akin)

    def _spread(self, values: Floats) -> Floats:
        """Return, for each rule, the highest of the `values` of its words, or zero."""
        highest = np.zeros(self._postings.size)
        for number in np.flatnonzero(values):
            places = self._postings.at(int(number))[0]
            highest[places] = np.maximum(highest[places], values[number])
        return highest


def _telling(counts: NDArray[np.int64]) -> Floats:
    """Return the weight of each level of nearness from the number of rules at it; never below 0."""
    as_near = np.cumsum(counts[::-1])[::-1]
    rules = as_near[0]
    return np.log1p((rules - as_near + 0.5) / (as_near + 0.5))


_MAKERS: dict[str, Callable[[Sequence[Rule], Vocabulary], RuleRanking]] = {
    "paper": lambda rules, _: PaperRanking(rules),
    "bm25": lambda rules, _: Bm25Ranking(rules),
    "ngrams": lambda rules, _: Bm25Ranking(rules, "ngrams", ngrams),
    "fusion": lambda rules, _: FusionRanking(
        {"bm25": Bm25Ranking(rules), "ngrams": Bm25Ranking(rules, "ngrams", ngrams)}
    ),
    "related": RelatedRanking,
}
METHODS = tuple(_MAKERS)


class Retriever:
    """A retriever that scores rules for a mission text by one of METHODS and picks the best.

    Rules are sorted by id, so that equal scores come in the order of the ids and not of the rule
    file. Rules that are not shown to models are left out, and do not influence any result or score.
    """

    def __init__(
        self,
        rules: Iterable[Rule],
        method: str = DEFAULT_METHOD,
        vocabulary: Vocabulary | None = None,
    ) -> None:
        """Index `rules`; raises ValueError for an unknown method.

        `vocabulary` is used by the method `related`; the default is the installed one.
        """
        if method not in _MAKERS:
            raise ValueError(f"unknown retrieval method {method!r}; known: {', '.join(METHODS)}")
        self.method = method
        ordered = sorted((rule for rule in rules if rule.in_prompts), key=lambda rule: rule.id)
        self._ids = [rule.id for rule in ordered]
        self._pinned = np.array([rule.priority == "critical" for rule in ordered], dtype=bool)
        self._vocabulary = default_vocabulary() if vocabulary is None else vocabulary
        self._ranking = _MAKERS[method](ordered, self._vocabulary)

    def over(self, rules: Iterable[Rule]) -> "Retriever":
        """Return a retriever with the same method and vocabulary for other rules."""
        return Retriever(rules, self.method, self._vocabulary)

    def retrieve(self, text: str, k: int = 3) -> tuple[RuleHit, ...]:
        """Return the pinned rules, then the `k` others with the best scores; no rule twice.

        Every Critical rule is pinned: the models see it whatever the mission is. Raises ValueError
        for a negative `k`.
        """
        if k < 0:
            raise ValueError(f"cannot retrieve {k} rules")
        scores, parts = self._scores(text)
        chosen: list[int] = []
        for places, number in (
            (np.flatnonzero(self._pinned), len(self._ids)),
            (np.flatnonzero(~self._pinned), k),
        ):
            chosen += [int(places[place]) for place in best(scores[places], number)]
        return tuple(self._hit(place, scores, parts) for place in chosen)

    def rank(self, text: str, k: int) -> tuple[str, ...]:
        """Return the ids of the `k` rules with the best scores, pinned or not, best first."""
        return tuple(self._ids[place] for place in best(self._scores(text)[0], k))

    def score_all(self, text: str) -> tuple[RuleHit, ...]:
        """Return every rule with its score and the parts of its score, best first."""
        scores, parts = self._scores(text)
        places = best(scores, len(self._ids))
        return tuple(self._hit(place, scores, parts) for place in places)

    def _scores(self, text: str) -> tuple[Floats, Scores]:
        """Return the scores and their parts, rounded before they are compared."""
        scores, parts = self._ranking.scores(text)
        return rounded(scores), {name: rounded(values) for name, values in parts.items()}

    def _hit(self, place: int, scores: Floats, parts: Scores) -> RuleHit:
        return RuleHit(
            rule_id=self._ids[place],
            score=float(scores[place]),
            components={name: float(values[place]) for name, values in parts.items()},
            pinned=bool(self._pinned[place]),
        )
