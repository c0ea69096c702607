"""Slips of the keyboard, sounds spelt as heard and short message spelling, words kept readable.

Names with digits or marks, numbers and negations mostly stay as they are; a slip never makes one
word of the world out of another.
"""

import random
import re
from collections.abc import Collection, Mapping

from rapidfuzz.distance import OSA

_TOKEN = re.compile(r"[A-Za-z][A-Za-z0-9_']*")
_MEANT = """
no not never none nobody nothing nor without dont doesnt isnt arent wont cant if else otherwise
unless except only all both one two three four five six seven eight nine ten eleven twelve thirteen
fourteen fifteen sixteen zero alpha bravo charlie delta echo tango low down up free
"""
KEPT = frozenset(_MEANT.split())
"""Words on which the meaning turns; they are spelt as they should be."""
SHORT: Mapping[str, str] = {
    "you": "u", "your": "ur", "are": "r", "please": "pls", "thanks": "thx", "and": "n",
    "with": "w/", "because": "cuz", "right": "rite", "okay": "k", "want": "wanna", "see": "c",
    "people": "ppl", "before": "b4", "going": "goin", "about": "abt", "back": "bk", "check": "chk",
    "message": "msg", "vehicle": "veh", "battery": "batt", "position": "pos", "need": "nd",
    "somebody": "sombdy", "someone": "sm1", "through": "thru", "tonight": "2nite", "what": "wat",
}  # fmt: skip
"""What words are in short messages."""
_SOUNDS = (
    ("ght", "t"), ("ph", "f"), ("ck", "k"), ("ie", "ei"), ("ei", "ie"), ("ea", "ee"), ("ou", "u"),
    ("tion", "shun"), ("ll", "l"), ("tt", "t"), ("ss", "s"), ("mm", "m"), ("cc", "c"), ("pp", "p"),
    ("ce", "se"), ("se", "ce"), ("kn", "n"), ("wh", "w"), ("able", "ible"), ("ent", "ant"),
    ("ance", "ence"), ("y", "i"), ("oo", "u"), ("ai", "ay"), ("er", "ur"), ("c", "k"), ("qu", "kw"),
    ("ould", "ud"), ("ure", "er"), ("igh", "i"), ("au", "aw"), ("x", "ks"), ("le", "el"),
)  # fmt: skip
_ROWS = ("qwertyuiop", "asdfghjkl", "zxcvbnm")
_SHORTEST = 4
_INTACT = 0.97
"""How often a name with digits or marks is left alone when it is its turn to be misspelt."""


def misspell(
    text: str, rng: random.Random, share: float, confusable: Collection[str], sms: bool = False
) -> str:
    """Return `text` with about `share` of its words spelt wrongly.

    `confusable` are the words, in lower case, that must not be mistaken for each other: those of
    places and teams. `sms` also writes common words short.
    """
    words = frozenset(word.lower() for word in confusable)

    def changed(match: re.Match[str]) -> str:
        word = match[0]
        if sms and word.lower() in SHORT and rng.random() < 0.7:
            return SHORT[word.lower()]
        if rng.random() >= share:
            return word
        for _ in range(4):
            slip = _slipped(word, rng)
            if slip != word and _still(word, slip, words):
                return slip
        return word

    return _TOKEN.sub(changed, text)


def _slipped(word: str, rng: random.Random) -> str:
    """Return `word` with one slip, or as it is when it is better left alone."""
    if not word[1:].isalpha() or not word[1:].islower():
        intact = "_" not in word or rng.random() < _INTACT
        return word if intact else word.replace("_", rng.choice(("", " ", "-", "__")), 1)
    if len(word) < _SHORTEST or word.lower() in KEPT:
        return word
    at = rng.randrange(1, len(word) - 1)
    before, letter, after = word[:at], word[at], word[at + 1 :]
    slips = (
        before + after[0] + letter + after[1:],
        before + after,
        before + letter + letter + after,
        before + _neighbour(letter, rng) + after,
        _as_heard(word, rng),
        _as_heard(word, rng),
    )
    return rng.choice(slips)


def _as_heard(word: str, rng: random.Random) -> str:
    """Return `word` with one sound spelt as it might be, or as it is when none fits."""
    fitting = [(heard, spelt) for heard, spelt in _SOUNDS if heard in word[1:]]
    if not fitting:
        return word
    heard, spelt = rng.choice(fitting)
    return word[0] + word[1:].replace(heard, spelt, 1)


def _neighbour(letter: str, rng: random.Random) -> str:
    """Return a letter beside `letter` on the keyboard."""
    for row in _ROWS:
        at = row.find(letter)
        if at >= 0:
            return rng.choice([row[i] for i in (at - 1, at + 1) if 0 <= i < len(row)])
    return letter


def _still(word: str, slip: str, confusable: frozenset[str]) -> bool:
    """Tell whether `slip` is nearer to `word` than to any other of the words that matter."""
    low, made = word.lower(), slip.lower()
    if made in KEPT:
        return False
    away = OSA.distance(low, made)
    others = confusable - {low}
    return all(OSA.distance(made, other, score_cutoff=away + 1) > away for other in others)
