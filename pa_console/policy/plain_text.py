"""The words of a mission as a person would read them, in any spelling, for checks of words.

Invisible characters are removed and compatibility forms resolved before anything reads a mission.
The other foldings are for checks only. They replace letters of other scripts that look Latin,
accents, digits and signs in place of letters, repeated or separated letters, and markup around
words. A folding is never shown to a model or a person; it is one more way in which a check reads
the text.
"""

import re
import unicodedata
from collections.abc import Iterator

_QUOTES = str.maketrans({"’": "'", "‘": "'", "“": '"', "”": '"', "–": "-", "—": "-"})
_HIDDEN = re.compile(
    "[\u034f\u115f\u1160\u17b4\u17b5\u180b-\u180f\u3164\ufe00-\ufe0f\uffa0\U000e0100-\U000e01ef]"
)
"""The characters that a screen may not show, besides format characters (Cf)."""

_LOOKS: dict[str, str] = {
    "a": "аαᴀɑ∀ꭺ", "b": "вЬβʙƅ", "c": "сϲᴄⅽ", "d": "ԁᴅđɖ", "e": "еєεᴇҽ", "f": "ƒꜰϝ", "g": "ɡɢց",
    "h": "һнʜհħ", "i": "іιɩɪıїίӏ", "j": "јϳᴊ", "k": "кκᴋⲕ", "l": "ⅼʟłɫ", "m": "мᴍʍ", "n": "пηոɴи",
    "o": "оοօᴏøσ", "p": "рρᴘ", "q": "ԛզǫ", "r": "гʀɾя", "s": "ѕꜱʂ", "t": "тτᴛŧ", "u": "υսᴜцʋ",
    "v": "νѵᴠ", "w": "ԝωᴡшա", "x": "хχ×", "y": "уγʏყ", "z": "ᴢʐƶ", "ss": "ß", "ae": "æ", "oe": "œ",
}  # fmt: skip
_LATIN = str.maketrans({sign: latin for latin, signs in _LOOKS.items() for sign in signs})
_LETTERS = [(0x1F130, 0x1F149), (0x1F150, 0x1F169), (0x1F170, 0x1F189), (0x1F1E6, 0x1F1FF)]
"""Letters in squares, circles and flags; each range runs from A to Z."""
_SIGNS = {"0": "o", "3": "e", "4": "a", "5": "s", "7": "t", "8": "b", "@": "a", "$": "s", "€": "e"}
_ONES = "1!|"
"""The characters that may stand for an i or an l."""
_WRITTEN = re.compile(r"[a-z0-9@$€!|]+")
_NUMBERED = re.compile(r"[a-z]+\d+|\d+(?:[a-z]|st|nd|rd|th|am|pm|km|min|sec|x\d*)[.!]*|[a-z]+!+")
"""Ordinary mixtures of letters and digits: `uav4`, `2nd`, `30m`, `stop!`."""
_APART = re.compile(r"(?<![^\W_])[^\W_](?:[\s.*_/·-]+[^\W_](?![^\W_])){2,}")
_SIGNS_BETWEEN = re.compile(r"(?<![^\W_])[^\W_](?:[.*_/·-]+[^\W_](?![^\W_])){2,}")
"""Letters separated by signs but not by spaces; they are joined first, one word at a time."""
_DRAWN = re.compile(r"([a-z])\1{2,}")
_JUNK = re.compile(r"(?<![^\W_])(?:([^\W_])\1{3,}|[^\W_]{40,})(?![^\W_])\s*")
"""Strings that are not words: one letter repeated, or more letters than any word has."""
_MARKUP = re.compile(r"[<>()\[\]{}`~#^\\]+|(?<![^\W_])[_*]+|[_*]+(?![^\W_])")
"""Signs that mark up a text: `__stop__`, `<stop>`. Within a name they are not markup."""
_WITHIN = re.compile(r"(?<=[a-z])[-*·/.+~_]+(?=[a-z])(?!t\d)")
"""Signs within words, except in the names of assets."""
_SPLIT = re.compile(r"(?<=[a-z])[-*·](?=[a-z])")

_PARTS = 3
"""The largest number of parts into which a searched word may be split."""

_SOUGHT = frozenset(
    (
        *("shoot", "shooting", "kill", "killing", "attack", "destroy", "eliminate", "neutralise"),
        *("neutralize", "assassinate", "murder", "open", "fire", "ramming", "crush", "flatten"),
        *("ignore", "override", "bypass", "disregard", "violate", "circumvent", "suspend"),
        *("disable", "forget", "rules", "rule", "engagement", "policy", "policies", "safety"),
        *("safeguards", "safeguard", "constraints", "restrictions", "trap", "corner", "surround"),
        *("encircle", "confine", "enclose", "imprison", "detain", "lock", "follow", "shadow"),
        *("chase", "pursue", "stalk", "tail", "hunt", "hound", "wherever", "person", "people"),
        *("driver", "intruder", "intruders", "stranger", "suspect", "visitor", "visitors"),
        *("crowd", "woman", "everybody", "everyone", "anybody", "anyone", "family", "children"),
        *("protesters", "civilians", "trespasser", "trespassers", "truck", "vehicle", "gates"),
        *("over", "down", "into", "inside", "robot", "robots", "drone", "drones", "units", "team"),
    )
)
"""The words that rules search for in a mission. They are also found if they are split, or if digits
stand for their letters."""

_STROKES = str.maketrans(_SIGNS | dict.fromkeys(("i", "l", *_ONES), "1"))


def compatible_form(text: str) -> str:
    """Return `text` in compatibility form (NFKC), without invisible characters."""
    form = unicodedata.normalize("NFKC", text)
    shown = "".join(sign for sign in form if unicodedata.category(sign) != "Cf")
    return _HIDDEN.sub("", shown)


def plain_words(text: str) -> str:
    """Return `text` as patterns expect it: lower case, plain quotes, single spaces."""
    return " ".join(compatible_form(text).translate(_QUOTES).lower().split())


def foldings(words: str) -> Iterator[str]:
    """Yield the other ways to read the plain `words`, usually none."""
    seen = {words}
    latin = _in_latin(words)
    bare = " ".join(_MARKUP.sub(" ", _JUNK.sub("", latin)).split())
    for text in (latin, bare, *_as_letters(bare)):
        for variant in (text, *_together(text)):
            if variant not in seen:
                seen.add(variant)
                yield variant


def _in_latin(words: str) -> str:
    """Return `words` with lookalike letters replaced by Latin ones, and without accents."""
    if words.isascii():
        return words
    flat = "".join(map(_letter, words))
    marked = unicodedata.normalize("NFKD", flat)
    bare = "".join(sign for sign in marked if unicodedata.category(sign) != "Mn")
    return bare.translate(_LATIN).lower()


def _letter(sign: str) -> str:
    for first, last in _LETTERS:
        if first <= ord(sign) <= last:
            return chr(ord("a") + ord(sign) - first)
    return sign


def _as_letters(words: str) -> Iterator[str]:
    """Yield `words` with digits and signs in words read as letters; 1 may be an i or an l."""
    for letter in "il":
        signs = str.maketrans(_SIGNS | dict.fromkeys(_ONES, letter))

        def read(match: re.Match[str], signs: dict[int, str] = signs) -> str:
            word = match[0]
            if word.isalpha() or word.isdigit():
                return word
            letters = _SPELT.get(_in_strokes(word), word.translate(signs))
            plain = _NUMBERED.fullmatch(word) and letters not in _SOUGHT
            return word if plain else letters

        yield _WRITTEN.sub(read, words)


def _together(words: str) -> Iterator[str]:
    """Yield `words` with separated or repeated letters joined into words."""
    joined = words
    for apart in (_SIGNS_BETWEEN, _APART):
        joined = apart.sub(lambda match: re.sub(r"[\W_]+", "", match[0]), joined)
    joined = re.sub(r"\bopen(ing)?fire", r"open\1 fire", joined)
    yield joined
    yield _SPLIT.sub("", joined)
    yield _rejoined(joined)
    whole = _WITHIN.sub("", joined)
    for drawn in (r"\1\1", r"\1"):
        yield _DRAWN.sub(drawn, joined)
        yield _rejoined(_DRAWN.sub(drawn, whole))


def _in_strokes(word: str) -> str:
    """Return `word` with every i, l and lookalike of either replaced by the same character."""
    return word.translate(_STROKES)


_SPELT = {_in_strokes(word): word for word in sorted(_SOUGHT)}
"""The searched words by their strokes, so that `k111` is found as `kill`."""


def _rejoined(words: str) -> str:
    """Return `words` with split words joined again: `sh oot`, `sur ro und`."""
    parts, at = words.split(" "), 0
    while at + 1 < len(parts):
        for end in range(at + 2, min(at + _PARTS, len(parts)) + 1):
            joined = re.sub(r"\W+(?=\w)", "", "".join(parts[at:end]))
            bare = joined.rstrip(".,;:!?")
            if word := _SPELT.get(_in_strokes(bare)):
                parts[at:end] = [word + joined[len(bare) :]]
                break
        at += 1
    return " ".join(parts)
