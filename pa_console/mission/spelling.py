"""Steps 1 and 2: the words of a mission, corrected and checked before any model reads them.

A word is misspelt if it is not in the dictionary, the operators' words, the rules, or the names of
the world. It is replaced by the likeliest word within a few typing slips (a noisy channel model).
Known words stay as they are, so the words of rules never vanish. The original text is kept as well.

A model reads an order into any text. The operator is therefore asked about a text that is not
English, has no words, is program text, or names nothing at the site, and no plan is made for it.
The decision depends only on fixed word lists and the dictionary, and has no fitted parameters.
"""

import json
import math
import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from functools import cache, lru_cache
from typing import NamedTuple

from rapidfuzz import fuzz, process
from rapidfuzz.distance import OSA
from spellchecker import SpellChecker

from pa_console.language.canonical.order import STILL_TASKS
from pa_console.language.clock_words import TIME_UNITS
from pa_console.language.lexicon import find_verbs
from pa_console.language.mentions import find_mentions, speaks_of_site
from pa_console.language.name_linking import KIND_WORDS, NEARLY, WORD, link_names
from pa_console.policy.plain_text import compatible_form, foldings, plain_words
from pa_console.policy.related_words import default_vocabulary
from pa_console.policy.rulebook import Rulebook
from pa_console.resources import data_folder
from pa_console.schema.world import World

SHORT, _LONG = 3, 8
"""The greatest length of a short word, which is near too many others, and the least length of a
long word, which may have two slips."""
_SLIP, _FIRST_LETTER = math.log(0.004), math.log(0.05)
"""The log likelihood of a slip, and the additional one of a slip in a word's first letter."""
_NAMED = 0.13
"""The share of a mission's words that come from the world's names: two of fifteen."""
_TURNING = frozenset(
    ("not", "nor", "non", "yes", "but", "all", "any", "off", "out", "one", "two", "six", "ten")
)
"""Short words that change the meaning of an order. A word is corrected to one of them only if both
have the same set of letters."""
_RARE = 100
"""The number of occurrences in the dictionary's 1.6 billion words up to which a word may belong to
any language."""
_BRITISH = (
    (re.compile(r"(?<=\w\w)is(e[drs]?|ers|ing|ations?)$"), r"iz\1"),
    (re.compile(r"(?<=\w\w)ys(e[drs]?|ers|ing)$"), r"yz\1"),
    (re.compile(r"(?<=\w\w)our(s|ed|ing|ers?|able|ful|less|ites?|hoods?)?$"), r"or\1"),
    (re.compile(r"(?<=\w\w[aeiou])ll(ed|ing|ers?|ations?)$"), r"l\1"),
    (re.compile(r"^(met|cent|lit|theat|fib|calib)re(s|d)?$"), r"\1er\2"),
    (re.compile(r"^(def|off|lic|pret)ence(s|less)?$"), r"\1ense\2"),
)
"""British endings, each with the American ending that the dictionary has."""
_OTHERWISE: Mapping[str, str] = {
    "manoeuvr": "maneuv", "draught": "draft", "plough": "plow", "mould": "mold", "grey": "gray",
    "smoulder": "smolder", "tyre": "tire", "kerb": "curb", "cheque": "check", "storey": "story",
}  # fmt: skip
"""British beginnings of words, each with the American beginning."""

_WORD = re.compile(r"[^\W\d_]+(?:['’][^\W\d_]+)*")
_ENDING = re.compile(r"['’](?:s|re|ve|ll|d|m|t)$")
_CALL_SIGN = re.compile(r"\w*[\d_]\w*")
"""Call signs, numbers, and names of assets and frames, which belong to no language."""
_ALPHABET = frozenset("abcdefghijklmnopqrstuvwxyz")
_MOST_STRANGE = 0.3
"""The weighted share of unknown words from which a text counts as not English."""
_RUN, _HIDDEN = 6, 0.5
"""The number of words in a run, and the weighted share of unknown words in one run from which a
text counts as not English."""
_SLIP_WEIGHT = 0.35
"""The weight of an unknown word that is nearly an operators' word or a name."""
_OTHER_LANGUAGES = frozenset(
    word
    for words in (
        "der das und ist nicht ein eine einen einem dem zum zur mit auf für nach sich wir sie",
        "le la les une et est qui dans pour avec vous nous aux du ce cette je tu au de tout",
        "el los las una para como pero muy lo su se esta este",
        "il gli della alla nel che di non sono questo",
        "os uma ao em você está isso",
        "het een naar niet ik dat ook maar voor zijn er",
        "och att det som på för av med till inte jag og ikke til ska skal",
        "nie się jest jak dla bir ve bu için mi",
        "pe cu și je na že jsem yang dan ke ini itu",
    )
    for word in words.split()
)
"""The commonest words of other languages that English orders do not use.

The lines are, in this order: German; French; Spanish; Italian; Portuguese; Dutch; Scandinavian
languages; Polish and Turkish; Romanian, Czech and Indonesian. Other alphabets need no list.
"""
_CODE = re.compile(
    r"[A-Za-z_][\w.]*\((?!s\))[^()]*\)[\s:;)]*$"
    r"|^\s*(?:SELECT|INSERT|UPDATE|DELETE|CREATE|DROP)\b.+\b(?:FROM|INTO|SET|TABLE)\b"
    r"|<(\w+)[^<>]*>.*</\1>"
    r"|\bhttps?://",
    re.DOTALL,
)

_ENCODED = re.compile(
    r"(?=\S*[a-z])(?=\S*[A-Z])(?=\S*\d)[^\s,;:_\"'()]{32,}"
    r"|(?:%[0-9A-Fa-f]{2,4}|&#?\w{1,8};|\\[ux][0-9A-Fa-f]{2,4}){3,}"
)
"""A long run of letters and digits, as in base64, or letters written as numbers. Such text may hide
an order."""
_DECODE = re.compile(
    r"\b(?:decode|decipher|decrypt|unscramble|rot-?13|base-?64)\b"
    r"|\bread\s+(?:[\w-]+\s+){0,3}?(?:backwards?|in\s+reverse|from\s+(?:the\s+)?right)\b"
)
"""Instructions to decode words, matched in plain words (`policy.plain_text`)."""

_TYPED = re.compile(r"(?<![\w'])(?:[A-Z][a-z]{2,}|[a-z]{3,}|[A-Z]{3,})(?![\w'])")
"""Words that may be misspelt. Names with digits or in camel case, contractions, and words of two
letters are not corrected."""
_FOREIGN = 0.25
"""The share of unknown words without a near word above which a text is not corrected, because it is
not English."""


class English:
    """The words of English and of operators, with the likelihood of each."""

    def __init__(self, counts: Mapping[str, int], operators: Iterable[str]) -> None:
        """Combine the `counts` of words in a large text with the operators' words.

        `operators` begins with the most frequent word.
        """
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
        """Return whether `word`, in lower case, is known in American or British spelling."""
        return word in self._likely or any(form in self._likely for form in _american(word))

    def is_common(self, word: str) -> bool:
        """Return whether `word`, in lower case, is English and not among the rarest words."""
        forms = (word, *_american(word))
        return any(self._likely.get(form, 0.0) > self._rare for form in forms)

    def is_operators(self, word: str) -> bool:
        """Return whether `word`, in lower case, is one of the operators' words."""
        return word in self._operators

    def is_near(self, word: str, names: "NameWords") -> bool:
        """Return whether `word` is nearly an operators' word or one of the world's `names`."""
        if self.likeliest(word, names, plain=False) is not None:
            return True
        listed = (*names.words, *self._operators)
        near = process.extractOne(word, listed, scorer=fuzz.ratio, score_cutoff=NEARLY)
        return near is not None and len(word) > SHORT

    @lru_cache(maxsize=1024)  # noqa: B019 - one instance lives as long as the process
    def likeliest(self, word: str, names: "NameWords", plain: bool) -> str | None:
        """Return the word that was meant by `word`; None if no word is near.

        Only names of the world and operators' words are considered, unless `word` is `plain` and
        not short. Short words are near too many others.
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
    """Return the English word list; a missing file of operators' words counts as empty."""
    path = data_folder() / "rules" / "vocabulary" / "operators.txt"
    text = path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""
    lines = (line.strip().lower() for line in text.splitlines())
    listed = (line for line in lines if line and not line.startswith("#"))
    others = (word for group in default_vocabulary().groups.values() for word in group)
    operators = dict.fromkeys((*listed, *others, *KIND_WORDS, *TIME_UNITS))
    return English(SpellChecker().word_frequency.dictionary, operators)


class NameWords(NamedTuple):
    """The words in the names of a world, each with the number of its occurrences."""

    words: tuple[str, ...]
    counts: tuple[int, ...]

    def share(self, word: str) -> float:
        """Return the likelihood that a word in a mission is `word`, used as part of a name."""
        at = self.words.index(word) if word in self.words else None
        return 0.0 if at is None else _NAMED * self.counts[at] / sum(self.counts)


def name_words(world: World) -> NameWords:
    """Return the words in the names of `world`."""
    return _name_words((*world.frames, *world.zones), (*world.assets,))


@lru_cache(maxsize=8)
def _name_words(places: tuple[str, ...], assets: tuple[str, ...]) -> NameWords:
    """Return the words in the names of places and assets, those of assets also in the plural.

    The words of a place are also returned as one word: `stonegate`.
    """
    words = [word.lower() for name in (*places, *assets) for word in WORD.findall(name)]
    words += ["".join(words).lower() for words in map(WORD.findall, places) if len(words) > 1]
    words += [f"{word.lower()}s" for name in assets for word in WORD.findall(name)]
    counts = Counter(word for word in words if len(word) > SHORT - 1 and word.isalpha())
    return NameWords(tuple(counts), tuple(counts.values()))


def _american(word: str) -> Iterator[str]:
    """Yield the American spellings of `word`, if its spelling may be British."""
    for british, american in _BRITISH:
        if british.search(word):
            yield british.sub(american, word)
    stem = next((stem for stem in _OTHERWISE if word.startswith(stem)), "")
    if stem:
        yield _OTHERWISE[stem] + word.removeprefix(stem)


@lru_cache(maxsize=4)
def rule_words(rulebook: Rulebook) -> frozenset[str]:
    """Return every word that a rule of `rulebook` uses, in its text or in its checks."""
    rules = (rule.model_dump_json().lower() for rule in rulebook.rules)
    return frozenset(word for rule in rules for word in re.findall("[a-z]+", rule))


class _UnknownWords(NamedTuple):
    """The words of a text except names, each with a weight: 0.0 if it is English, 1.0 if not.

    A word that is nearly an operators' word or a name has the weight `_SLIP_WEIGHT`.
    """

    words: tuple[tuple[str, float], ...]

    @property
    def share(self) -> float:
        """The weighted share of unknown words."""
        return sum(weight for _, weight in self.words) / max(len(self.words), 1)

    @property
    def strange(self) -> tuple[str, ...]:
        """The words that are not English, in descending order of their weights."""
        strangest = sorted((word for word in self.words if word[1]), key=lambda word: -word[1])
        return tuple(dict.fromkeys(word for word, _ in strangest))

    @property
    def strangest_run(self) -> "_UnknownWords":
        """The run of `_RUN` words (or all, if fewer) with the largest share of unknown words."""
        starts = range(max(len(self.words) - _RUN, 0) + 1)
        runs = [_UnknownWords(self.words[at : at + _RUN]) for at in starts]
        return max(runs, key=lambda run: run.share)


def question_back(typed: str, read: str, world: World, rulebook: Rulebook) -> str:
    """Return the question about a text that is not an order; '' if it may be one.

    `typed` is the original text, and `read` the corrected text. While the question is open, the
    text must not move any asset.
    """
    unknown = _words(typed, world, rulebook)
    if not unknown.words and not find_mentions(world, typed):
        return "there are no words in it. What is to be done, by whom and where?"
    run = unknown.strangest_run
    hidden = len(run.words) == _RUN and run.share >= _HIDDEN
    if hidden or unknown.share >= _MOST_STRANGE:
        strange = ", ".join(unknown.strange)
        return f"not known in English: {strange}. What is to be done, in English?"
    shown = compatible_form(_without_names(typed, world))
    if (encoded := _ENCODED.search(shown)) is not None:
        return f"nobody can read {encoded[0][:20]}... in it. What is to be done, in words?"
    words = plain_words(typed)
    if any(_DECODE.search(reading) for reading in (words, *foldings(words))):
        return "a part of it has to be decoded. What is to be done, in words?"
    if _is_code(typed):
        return "it reads as program text. What is to be done, in words?"
    if not speaks_of_site(world, link_names(world, read)) and not _moves_nobody(read):
        return "it names nobody and nothing of this site. What is to be done, by whom and where?"
    return ""


def _words(text: str, world: World, rulebook: Rulebook) -> _UnknownWords:
    dictionary, names = english(), name_words(world)
    known_words, weighted = rule_words(rulebook).union(names.words), list[tuple[str, float]]()
    for word in _WORD.findall(_CALL_SIGN.sub(" ", _without_names(text, world))):
        low = word.lower().replace("’", "'")
        base, strange = _ENDING.sub("", low), 0.0
        if dictionary.is_operators(base) or base in known_words:
            pass
        elif low in _OTHER_LANGUAGES:
            strange = 1.0
        elif not (base in _ALPHABET or dictionary.is_common(base) or dictionary.is_common(low)):
            near = len(base) >= SHORT and base.isascii() and dictionary.is_near(base, names)
            strange = _SLIP_WEIGHT if near else 1.0
        weighted.append((word, strange))
    return _UnknownWords(tuple(weighted))


def _without_names(text: str, world: World) -> str:
    for name in (*world.frames, *world.zones, *world.assets):
        text = text.replace(name, " ")
    return text


def _is_code(text: str) -> bool:
    if _CODE.search(text):
        return True
    if text.lstrip()[:1] not in ("{", "["):
        return False
    try:
        json.loads(text)
    except (ValueError, RecursionError):
        return False
    return True


def _moves_nobody(text: str) -> bool:
    """Return whether a text without names may be an order that needs no name, such as *freeze*."""
    return any(verb.means & STILL_TASKS for verb in find_verbs(text))


def read_words(text: str, world: World, rulebook: Rulebook) -> str:
    """Return an operator's words with misspellings corrected, if the words are English."""
    strange = _words(text, world, rulebook).share >= _MOST_STRANGE
    return text if strange else respell(text, world, rulebook)


def respell(text: str, world: World, rulebook: Rulebook) -> str:
    """Return `text` with misspelt words corrected; a text in another language is unchanged."""
    dictionary, names = english(), name_words(world)
    known_words = rule_words(rulebook).union(names.words)
    shouted = text.isupper()
    typed = [match for match in _TYPED.finditer(text) if shouted or not match[0].isupper()]
    unknown = [
        match
        for match in typed
        if not (match[0].lower() in known_words or match[0].lower() in dictionary)
    ]
    corrections = [_correction(match, names, dictionary) for match in unknown]
    if corrections.count(None) > max(_FOREIGN * len(corrections), 1):
        return text
    parts, done = list[str](), 0
    for match, word in zip(unknown, corrections, strict=True):
        parts += [text[done : match.start()], word or match[0]]
        done = match.end()
    return "".join((*parts, text[done:]))


def prepare() -> None:
    """Load the dictionary in advance, so that no mission has to wait for it."""
    english()


def _correction(typed: re.Match[str], names: NameWords, dictionary: English) -> str | None:
    """Return the word that was meant by `typed`, in the same case; None if no word is near."""
    word = typed[0]
    before = typed.string[: typed.start()].rstrip(" \"'(")
    capital = word[0].isupper() and not word.isupper()
    named = capital and before and before[-1] not in ".!?:"
    best = dictionary.likeliest(word.lower(), names, plain=not named)
    if best is not None and word[0].isupper():
        return best.capitalize() if capital else best.upper()
    return best
