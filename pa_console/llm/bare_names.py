"""When a word that a gate's name is made of stands for the gate: `one bird to Quarry`, `at east`.

Such words mean other things as well (`a Ford`, `south of the road`), so what stands around has to
tell: a capital within a sentence, or where somebody is, goes or comes from with nothing behind it.
"""

import re

_CAPITAL = re.compile(r"[A-Z][a-z]+")
_ENDS_SENTENCE = (*'.!?:"“(', "")
_ONE_OF_MANY = frozenset(("a", "an", "another", "any", "some", "every", "mr", "mrs", "ms"))
_WHERE = frozenset(("at", "to", "from", "toward", "towards", "near", "over"))
_GOES_ON = frozenset(
    (
        *("and", "or", "but", "then", "so", "with", "for", "by", "to", "as", "because", "since"),
        *("while", "until", "till", "if", "unless", "who", "is", "has", "please", "pls", "now"),
        *("asap", "today", "tonight", "again", "too", "instead", "immediately"),
    )
)
"""Words before which a place is at its end."""
_NEXT = re.compile(r"\s*([A-Za-z0-9_]*)")


def is_place_alone(text: str, start: int, end: int) -> bool:
    """Whether the word of `text` from `start` to `end` stands for the gate that is called so."""
    before, word = text[:start].rstrip(), text[start:end]
    previous = before.rpartition(" ")[2].strip("\"'(,;").lower()
    if _CAPITAL.fullmatch(word):
        within = before[-1:] not in _ENDS_SENTENCE and not _CAPITAL.fullmatch(_following(text, end))
        if within and previous not in _ONE_OF_MANY:
            return True
    return previous in _WHERE and before[-1:].isalpha() and not describes(text, end)


def describes(text: str, end: int) -> bool:
    """Whether what ends at `end` tells more of the word behind it: `the Quarry drones`."""
    following = _following(text, end).lower()
    return bool(following) and following not in _GOES_ON


def _following(text: str, end: int) -> str:
    """Return the word that stands behind `end` with nothing but blanks between."""
    found = _NEXT.match(text, end)
    return found[1] if found is not None else ""
