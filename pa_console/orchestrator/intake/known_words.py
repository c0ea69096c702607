"""The words that are known: of English and of operators, of the rules and of a world's names."""

import math
import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from functools import cache, lru_cache
from typing import NamedTuple

from rapidfuzz import fuzz, process
from rapidfuzz.distance import OSA
from spellchecker import SpellChecker

from pa_console.language.world_names import KIND_WORDS, NEARLY, WORD
from pa_console.policy.retrieval.related_words import default_vocabulary
from pa_console.policy.rulebook import Rulebook
from pa_console.resources import data_folder
from pa_console.schema.world import World

SHORT, _LONG = 3, 8
"""Words of so few letters are near to too much; words of so many may have two slips."""
_SLIP, _FIRST_LETTER = math.log(0.004), math.log(0.05)
"""The likelihood of one slip, and of one in a word's first letter, against none."""
_NAMED = 0.13
"""The share of a mission's words that are of the world's names: two of fifteen."""
_TURNING = frozenset(
    ("not", "nor", "non", "yes", "but", "all", "any", "off", "out", "one", "two", "six", "ten")
)
"""Short words on which the meaning turns: only their own letters, swapped or doubled, are one."""
_RARE = 100
"""A word that is so rare in the dictionary's text, 1.6 billion words, may be of any language."""
_BRITISH = (
    (re.compile(r"(?<=\w\w)is(e[drs]?|ers|ing|ations?)$"), r"iz\1"),
    (re.compile(r"(?<=\w\w)ys(e[drs]?|ers|ing)$"), r"yz\1"),
    (re.compile(r"(?<=\w\w)our(s|ed|ing|ers?|able|ful|less|ites?|hoods?)?$"), r"or\1"),
    (re.compile(r"(?<=\w\w[aeiou])ll(ed|ing|ers?|ations?)$"), r"l\1"),
    (re.compile(r"^(met|cent|lit|theat|fib|calib)re(s|d)?$"), r"\1er\2"),
    (re.compile(r"^(def|off|lic|pret)ence(s|less)?$"), r"\1ense\2"),
)
"""Endings that British English spells otherwise than the dictionary, which is American."""
_OTHERWISE: Mapping[str, str] = {
    "manoeuvr": "maneuv", "draught": "draft", "plough": "plow", "mould": "mold", "grey": "gray",
    "smoulder": "smolder", "tyre": "tire", "kerb": "curb", "cheque": "check", "storey": "story",
}  # fmt: skip
"""Beginnings of words that it spells otherwise."""


class English:
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
        self._rare = 0.5 * _RARE / total
        self._operators = frozenset(ranked)
        self._by_length: defaultdict[int, list[str]] = defaultdict(list)
        for word in self._likely:
            self._by_length[len(word)].append(word)

    def __contains__(self, word: str) -> bool:
        """Return whether `word`, in lower case, is known in American or in British spelling."""
        return word in self._likely or any(form in self._likely for form in _american(word))

    def is_common(self, word: str) -> bool:
        """Return whether `word`, in lower case, is certainly English; the rarest words are not."""
        forms = (word, *_american(word))
        return any(self._likely.get(form, 0.0) > self._rare for form in forms)

    def is_operators(self, word: str) -> bool:
        """Return whether operators use `word`, in lower case."""
        return word in self._operators

    def is_near(self, word: str, names: "NameWords") -> bool:
        """Return whether `word` is nearly one that operators use, or one of the world's `names`."""
        if self.likeliest(word, names, plain=False) is not None:
            return True
        listed = (*names.words, *self._operators)
        near = process.extractOne(word, listed, scorer=fuzz.ratio, score_cutoff=NEARLY)
        return near is not None and len(word) > SHORT

    @lru_cache(maxsize=1024)  # noqa: B019 - there is one for the life of the process
    def likeliest(self, word: str, names: "NameWords", plain: bool) -> str | None:
        """Return what `word` was meant to be, None when nothing is near.

        Unless it is a `plain` word, only names of the world and operators' words are; as for short
        words, which are near to too much.
        """
        slips = 1 if len(word) < _LONG else 2
        lengths = range(max(len(word) - slips, SHORT), len(word) + slips + 1)
        words = [*names.words, *(other for length in lengths for other in self._by_length[length])]
        near = process.extract(word, words, scorer=OSA.distance, score_cutoff=slips, limit=None)
        plain = plain and len(word) > SHORT
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
def english() -> English:
    """Return the English word list; without its file, operators have no words of their own."""
    path = data_folder() / "rules" / "vocabulary" / "operators.txt"
    text = path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""
    lines = (line.strip().lower() for line in text.splitlines())
    listed = (line for line in lines if line and not line.startswith("#"))
    others = (word for group in default_vocabulary().groups.values() for word in group)
    operators = dict.fromkeys((*listed, *others, *KIND_WORDS))
    return English(SpellChecker().word_frequency.dictionary, operators)


class NameWords(NamedTuple):
    """The words that the names of a world are made of, each as often as it is there."""

    words: tuple[str, ...]
    counts: tuple[int, ...]

    def share(self, word: str) -> float:
        """Return how likely a word of a mission is `word` because it is of a name."""
        at = self.words.index(word) if word in self.words else None
        return 0.0 if at is None else _NAMED * self.counts[at] / sum(self.counts)


def name_words(world: World) -> NameWords:
    """Return the words of the names of `world`."""
    return _name_words((*world.frames, *world.zones), (*world.assets,))


@lru_cache(maxsize=8)
def _name_words(places: tuple[str, ...], assets: tuple[str, ...]) -> NameWords:
    """Return the words of the names of places and of assets, these in the plural too.

    A place's words may be typed as one: `stonegate`.
    """
    said = [word.lower() for name in (*places, *assets) for word in WORD.findall(name)]
    said += ["".join(words).lower() for words in map(WORD.findall, places) if len(words) > 1]
    said += [f"{word.lower()}s" for name in assets for word in WORD.findall(name)]
    counts = Counter(word for word in said if len(word) > SHORT - 1 and word.isalpha())
    return NameWords(tuple(counts), tuple(counts.values()))


def _american(word: str) -> Iterator[str]:
    """Yield how `word` is spelt in American English, if it may be British."""
    for british, american in _BRITISH:
        if british.search(word):
            yield british.sub(american, word)
    stem = next((stem for stem in _OTHERWISE if word.startswith(stem)), "")
    if stem:
        yield _OTHERWISE[stem] + word.removeprefix(stem)


@lru_cache(maxsize=4)
def rule_words(rulebook: Rulebook) -> frozenset[str]:
    """Return every word that a rule uses, in its text or its checks."""
    rules = (rule.model_dump_json().lower() for rule in rulebook.rules)
    return frozenset(word for rule in rules for word in re.findall("[a-z]+", rule))
