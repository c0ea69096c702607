"""Step 1: misspelt words of a mission are put right before anything reads it.

A word is misspelt when no dictionary, no operator, no rule and no name of the world knows it; it is
read as the likeliest word that few slips of the hand make it of (a noisy channel). Words that are
known stay as they are, so a rule's words never vanish, and what was typed is kept beside.
"""

import math
import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from functools import cache, lru_cache
from typing import NamedTuple

from rapidfuzz import process
from rapidfuzz.distance import OSA
from spellchecker import SpellChecker

from pa_console.orders.world_names import KIND_WORDS, WORD
from pa_console.policy.retrieval.related_words import default_vocabulary
from pa_console.policy.rulebook import Rulebook
from pa_console.resources import data_folder
from pa_console.schema.world import World

_TYPED = re.compile(r"(?<![\w'])(?:[A-Z][a-z]{2,}|[a-z]{3,}|[A-Z]{3,})(?![\w'])")
"""What may be misspelt: no name in digits or camel case, no contraction, nothing of two letters."""
_SHORT, _LONG = 3, 8
"""Words of so few letters are near to too much; words of so many may have two slips."""
_FOREIGN = 0.25
"""When nothing is near to more than this share of the unknown words, they are not English."""
_SLIP, _FIRST_LETTER = math.log(0.004), math.log(0.05)
"""How likely one slip is, and that it is in a word's first letter, against none."""
_NAMED = 0.13
"""The share of a mission's words that are of the world's names: two of fifteen."""
_TURNING = frozenset(
    ("not", "nor", "non", "yes", "but", "all", "any", "off", "out", "one", "two", "six", "ten")
)
"""Short words on which the meaning turns: only their own letters, swapped or doubled, are one."""


def respell(text: str, world: World, rulebook: Rulebook) -> str:
    """Return `text` with its misspelt words put right; text in another language is left alone."""
    english, names = _english(), _names((*world.frames, *world.zones), (*world.assets,))
    known = _words(rulebook).union(names.words)
    shouted = text.isupper()
    found = [match for match in _TYPED.finditer(text) if shouted or not match[0].isupper()]
    unknown = [
        match for match in found if not (match[0].lower() in known or match[0].lower() in english)
    ]
    meant = [_meant(match, names, english) for match in unknown]
    if meant.count(None) > max(_FOREIGN * len(meant), 1):
        return text
    parts, done = list[str](), 0
    for match, word in zip(unknown, meant, strict=True):
        parts += [text[done : match.start()], word or match[0]]
        done = match.end()
    return "".join((*parts, text[done:]))


def prepare() -> None:
    """Load the dictionary, which takes a moment, so that no mission waits for it."""
    _english()


def _meant(typed: re.Match[str], names: "_Names", english: "_English") -> str | None:
    """Return what was meant by the `typed` word in its own case, None when nothing is near."""
    word = typed[0]
    before = typed.string[: typed.start()].rstrip(" \"'(")
    capital = word[0].isupper() and not word.isupper()
    named = capital and before and before[-1] not in ".!?:"
    best = english.likeliest(word.lower(), names, plain=not named)
    if best is not None and word[0].isupper():
        return best.capitalize() if capital else best.upper()
    return best


class _English:
    """The words of English and of operators, with how likely each is."""

    def __init__(self, counts: Mapping[str, int], operators: Iterable[str]) -> None:
        """`counts` are those of a large text, `operators` their words, most frequent first."""
        total = sum(counts.values())
        self._likely: defaultdict[str, float] = defaultdict(float)
        for word, count in counts.items():
            self._likely[word] += 0.5 * count / total
        ranked = {word: 1.0 / (rank + 10) for rank, word in enumerate(operators)}
        whole = sum(ranked.values())
        for word, share in ranked.items():
            self._likely[word] += 0.5 * share / whole
        self._operators = frozenset(ranked)
        self._by_length: defaultdict[int, list[str]] = defaultdict(list)
        for word in self._likely:
            self._by_length[len(word)].append(word)

    def __contains__(self, word: str) -> bool:
        return word in self._likely

    @lru_cache(maxsize=1024)  # noqa: B019 - there is one for the life of the process
    def likeliest(self, word: str, names: "_Names", plain: bool) -> str | None:
        """Return what `word` was meant to be, None when nothing is near.

        Unless it is a `plain` word, only names of the world and operators' words are; as for short
        words, which are near to too much.
        """
        slips = 1 if len(word) < _LONG else 2
        lengths = range(max(len(word) - slips, _SHORT), len(word) + slips + 1)
        words = [*names.words, *(other for length in lengths for other in self._by_length[length])]
        near = process.extract(word, words, scorer=OSA.distance, score_cutoff=slips, limit=None)
        plain = plain and len(word) > _SHORT
        likely = {
            other: math.log(self._likely[other] + names.share(other))
            + distance * _SLIP
            + (_FIRST_LETTER if other[0] != word[0] else 0.0)
            for other, distance, _ in near
            if (plain or other in names.words or other in self._operators)
            and (other not in _TURNING or {*other} == {*word})
        }
        return max(likely, key=lambda other: likely[other], default=None)


@cache
def _english() -> _English:
    """Return what is known of English; without its file, operators have no words of their own."""
    path = data_folder() / "rules" / "vocabulary" / "operators.txt"
    text = path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""
    lines = (line.strip().lower() for line in text.splitlines())
    listed = (line for line in lines if line and not line.startswith("#"))
    others = (word for group in default_vocabulary().groups.values() for word in group)
    operators = dict.fromkeys((*listed, *others, *KIND_WORDS))
    return _English(SpellChecker().word_frequency.dictionary, operators)


class _Names(NamedTuple):
    """The words that the names of a world are made of, each as often as it is there."""

    words: tuple[str, ...]
    counts: tuple[int, ...]

    def share(self, word: str) -> float:
        """Return how likely a word of a mission is `word` because it is of a name."""
        at = self.words.index(word) if word in self.words else None
        return 0.0 if at is None else _NAMED * self.counts[at] / sum(self.counts)


@lru_cache(maxsize=8)
def _names(places: tuple[str, ...], assets: tuple[str, ...]) -> _Names:
    """Return the words of the names of places and of assets, these in the plural too.

    A place's words may be typed as one: `stonegate`.
    """
    said = [word.lower() for name in (*places, *assets) for word in WORD.findall(name)]
    said += ["".join(words).lower() for words in map(WORD.findall, places) if len(words) > 1]
    said += [f"{word.lower()}s" for name in assets for word in WORD.findall(name)]
    counts = Counter(word for word in said if len(word) > _SHORT - 1 and word.isalpha())
    return _Names(tuple(counts), tuple(counts.values()))


def _words(rulebook: Rulebook) -> frozenset[str]:
    """Return every word that a rule uses, in its text or its checks."""
    return _rule_words(tuple(rule.model_dump_json() for rule in rulebook.rules))


@lru_cache(maxsize=4)
def _rule_words(rules: tuple[str, ...]) -> frozenset[str]:
    return frozenset(word for rule in rules for word in re.findall("[a-z]+", rule.lower()))
