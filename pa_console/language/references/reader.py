"""A tokenizer for orders, and a reader that parsers move along its tokens.

The module also has the word lists of descriptions, and functions that read the names of assets and
places. Clitics are separate tokens: `isn't` is read as *is*, *not*, and `Drone_T01's` as the name,
*'s*.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

from pa_console.language.lexicon import find_verbs, word_lists
from pa_console.language.name_linking import NUMBERS
from pa_console.language.references.scene import ReferenceScene

_TOKEN = re.compile(r"[^\W_](?:[\w-]*\w)?|['’](?:s|re|ve|d|ll|m)\b|n['’]t\b|[^\w\s]")
_NOT = re.compile(r"(?<=[a-z])n['’]t\b", re.IGNORECASE)
_SAME = {"n't": "not", "’s": "'s", "’re": "'re", "can't": "can", "noone": "nobody"}

_WORDS = word_lists("descriptions")
DEFINITE = frozenset(_WORDS["definite"])
INDEFINITE = frozenset(_WORDS["indefinite"])
FREE_CHOICE = frozenset(_WORDS["free_choice"])
EVERY_ONE = _WORDS["every_one"]
EVERY = frozenset(_WORDS["every"])
ANYBODY = frozenset(_WORDS["anybody"])
EVERYBODY = frozenset(_WORDS["everybody"])
NEAR = frozenset(_WORDS["near"])
FAR = frozenset(_WORDS["far"])
FULLER = frozenset(_WORDS["fuller"])
EMPTIER = frozenset(_WORDS["emptier"])
MOST = FULLER | frozenset(_WORDS["most"])
LEAST = EMPTIER | frozenset(_WORDS["least"])
CHARGE = frozenset(_WORDS["charge"])
BARE = frozenset(_WORDS["bare"])
GUARDS = frozenset(_WORDS["guards"])
GUARDING = frozenset(
    word
    for stem in ("guard", "cover", "watch", "protect", "hold", "mann")
    for word in (stem, f"{stem}s", f"{stem}ing", f"{stem}es")
)
GUARDED = frozenset(_WORDS["guarded"])
COPULA = frozenset(_WORDS["copula"])
SAYING = COPULA - {"standing", "sitting"} | {"hovers", "stays"}
"""Words that begin a relative clause without *that* or *who*."""
STANDING = COPULA | {
    *("waiting", "hovers", "hovering", "parked", "posted", "stationed", "hanging", "stays"),
    *("around", "right", "now", "currently", "still", "up", "about", "just", "idling", "parking"),
}
IN = frozenset(_WORDS["in"])
IDLE = frozenset(_WORDS["idle"])
FAILED = frozenset(_WORDS["failed"])
SILENT = frozenset(_WORDS["silent"])
BUT = _WORDS["but"]
SENT = frozenset(_WORDS["sent"])
AFTER_ONE = frozenset(
    (*STANDING, *NEAR, *FAR, *IN, "with", "without", "that", "which", "who", "i", "we", "you")
)
"""Words that may follow *the one* where it stands for a noun."""
CONTACTS: Mapping[str, str] = {
    word: "" if sort == "either" else sort
    for sort, words in word_lists("contacts").items()
    for word in words
}
"""Words for contacts, each with its kind of track; '' if it may be either."""
DETERMINED = frozenset((*DEFINITE, *INDEFINITE, *EVERY, *FREE_CHOICE, "number", "only"))
"""Words after which *one* is not a pronoun."""
LEAVING = frozenset(_WORDS["leaving"])
BESIDE = frozenset(_WORDS["beside"])
"""Words, besides verbs, punctuation and places, that may follow a noun phrase without a noun."""
PUTTING = frozenset(_WORDS["putting"])
COMING = frozenset(_WORDS["coming"])


class WordToken(NamedTuple):
    """A word in lower case and as written, with the range of its characters."""

    word: str
    written: str
    start: int
    end: int


def read_tokens(text: str) -> tuple[WordToken, ...]:
    """Return the words and punctuation marks of `text`."""
    tokens: list[WordToken] = []
    for match in _TOKEN.finditer(text):
        written, start = match[0], match.start()
        cut = re.search(r"n['’]t$", text[start : match.end() + 2], re.IGNORECASE)
        if written.lower().endswith("n") and len(written) > 1 and cut is not None:
            written = written[:-1]
        tokens.append(WordToken(_word(written), written, start, start + len(written)))
        if len(written) < len(match[0]):
            tokens.append(WordToken("not", "n't", start + len(written), match.end() + 2))
    return tuple(_without_halves(tokens))


def _word(written: str) -> str:
    low = written.lower()
    return _SAME.get(low, low)


def _without_halves(tokens: Sequence[WordToken]) -> list[WordToken]:
    """Return the tokens without fragments of contractions such as *isn't*."""
    kept: list[WordToken] = []
    for token in tokens:
        if not kept or token.start >= kept[-1].end:
            kept.append(token)
    return kept


class Reader:
    """A cursor over tokens; a method that finds nothing to read leaves the cursor where it is."""

    def __init__(self, tokens: Sequence[WordToken], at: int = 0) -> None:
        self.tokens, self.at = tokens, at

    def word(self, ahead: int = 0) -> str:
        """Return the word `ahead` of the cursor; '' beyond either end."""
        index = self.at + ahead
        return self.tokens[index].word if 0 <= index < len(self.tokens) else ""

    def written(self) -> str:
        """Return the word at the cursor as written; '' at the end."""
        return self.tokens[self.at].written if self.at < len(self.tokens) else ""

    @property
    def over(self) -> bool:
        """True if no token is left."""
        return self.at >= len(self.tokens)

    def take(self, *ways: str) -> str:
        """Read the first of the phrases `ways` that matches at the cursor; return it, or ''."""
        for way in ways:
            words = way.split()
            if all(self.word(n) == word for n, word in enumerate(words)):
                self.at += len(words)
                return way
        return ""

    def take_in(self, words: Collection[str]) -> str:
        """Read the word at the cursor if it is among `words`; return it, or ''."""
        word = self.word()
        if word and word in words:
            self.at += 1
            return word
        return ""

    def skip(self, words: Collection[str]) -> None:
        """Skip the next words while they are among `words`."""
        while self.take_in(words):
            pass


def place_at(scene: ReferenceScene, reader: Reader) -> str:
    """Read the name of a frame, or a word for the base; return the frame, or ''."""
    start = reader.at
    reader.take("the", "our")
    word = reader.word()
    frame = scene.frames_by_word.get(word, "")
    if not frame and word in ("base", "home"):
        frame = scene.world.base
    if not frame and word not in ("", "gate"):
        frame = scene.names.gate_with(word) or ""
        if frame and reader.word(1) in ("side", "end", "corner"):
            frame = ""
    if not frame:
        reader.at = start
        return ""
    reader.at += 1
    if frame in scene.gates:
        reader.take("gate")
    return frame


def asset_at(scene: ReferenceScene, reader: Reader) -> str:
    """Read the name of an asset; return it, or ''."""
    name = scene.assets_by_word.get(reader.written().lower(), "")
    if name:
        reader.at += 1
    return name


def stands_alone(scene: ReferenceScene, reader: Reader, ahead: int = 0) -> bool:
    """Return whether no noun is `ahead`: the word is a verb, a stop, a place or the like."""
    word = reader.word(ahead)
    if not word or not word[0].isalnum() or word in BESIDE:
        return True
    if any(verb.plain or word.endswith("s") for verb in find_verbs(word)):
        return True
    return bool(place_at(scene, Reader(reader.tokens, reader.at + ahead)))


def number_of(word: str) -> int:
    """Return the number that `word` stands for; -1 if it is not a number."""
    if word.isdecimal():
        return int(word)
    return NUMBERS.index(word) if word in NUMBERS else -1
