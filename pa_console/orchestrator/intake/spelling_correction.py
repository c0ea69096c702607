"""Step 1: misspelt words of a mission are put right before anything reads it.

A word is misspelt when no dictionary, no operator, no rule and no name of the world knows it; it is
read as the likeliest word that few slips of the hand make it of (a noisy channel). Words that are
known stay as they are, so a rule's words never vanish, and what was typed is kept beside.
"""

import re

from pa_console.orchestrator.intake.known_words import (
    English,
    NameWords,
    english,
    name_words,
    rule_words,
)
from pa_console.orchestrator.intake.order_language import is_english
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.world import World

_TYPED = re.compile(r"(?<![\w'])(?:[A-Z][a-z]{2,}|[a-z]{3,}|[A-Z]{3,})(?![\w'])")
"""Words that may be misspelt: no name in digits or camel case, no contraction, nothing of two
letters."""
_FOREIGN = 0.25
"""When nothing is near to more than this share of the unknown words, they are not English."""


def read_words(text: str, world: World, rulebook: Rulebook) -> str:
    """Return an operator's words with misspellings put right, if they are English."""
    return respell(text, world, rulebook) if is_english(text, world, rulebook) else text


def respell(text: str, world: World, rulebook: Rulebook) -> str:
    """Return `text` with its misspelt words put right; text in another language is left alone."""
    dictionary, names = english(), name_words(world)
    known = rule_words(rulebook).union(names.words)
    shouted = text.isupper()
    found = [match for match in _TYPED.finditer(text) if shouted or not match[0].isupper()]
    unknown = [
        match
        for match in found
        if not (match[0].lower() in known or match[0].lower() in dictionary)
    ]
    meant = [_meant(match, names, dictionary) for match in unknown]
    if meant.count(None) > max(_FOREIGN * len(meant), 1):
        return text
    parts, done = list[str](), 0
    for match, word in zip(unknown, meant, strict=True):
        parts += [text[done : match.start()], word or match[0]]
        done = match.end()
    return "".join((*parts, text[done:]))


def prepare() -> None:
    """Load the dictionary, which takes a moment, so that no mission waits for it."""
    english()


def _meant(typed: re.Match[str], names: NameWords, dictionary: English) -> str | None:
    """Return the intended word for `typed`, in its own case; None when nothing is near."""
    word = typed[0]
    before = typed.string[: typed.start()].rstrip(" \"'(")
    capital = word[0].isupper() and not word.isupper()
    named = capital and before and before[-1] not in ".!?:"
    best = dictionary.likeliest(word.lower(), names, plain=not named)
    if best is not None and word[0].isupper():
        return best.capitalize() if capital else best.upper()
    return best
