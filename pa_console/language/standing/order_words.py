"""Separates standing orders from orders for now, and reads their parts.

*Whenever CONDITION, ORDER*, also *each time*, *every time*, *if ... ever ...*, or the order first.
In the order, *it*, *that drone*, *its gate* and *there* stand for the subject of the condition.
Unclear words are asked back about; none are guessed.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from pa_console.language.name_linking import link_names
from pa_console.language.references.outcome import Unclear
from pa_console.language.references.reader import Reader, Token, read_tokens
from pa_console.language.references.scene import Scene
from pa_console.language.standing.condition_words import EXAMPLES, ReadCondition, read_condition
from pa_console.schema.standing import MOST_STARTS, PLACE, SUBJECT, SubjectKind

_OPENING = re.compile(
    r"\s*(?:(?:please|ok|okay|from now on|as a standing order|standing order)\b[\s,:]*)*"
    r"(?:whenever|each time|every time|any ?time)\b[\s,]*"
    r"(?:(?:you|we) (?:see|notice|hear|find)\b\s*)?(?:that\b\s*)?",
    re.IGNORECASE,
)
_IF_EVER = re.compile(r"\s*(?:please[\s,]+)?if\b(?P<before>[^,]*?)\bever\b", re.IGNORECASE)
_TALK = re.compile(r"\b(?:i|me|my|would|were|could|might)\b", re.IGNORECASE)
"""The words before an *ever* that is no condition: *if it were up to me nothing would ever*."""
_WITHIN = re.compile(r"\b(?:whenever|each time|every time|if ever)\b", re.IGNORECASE)
_NO_CONDITION = re.compile(
    r"\s*(?:i|i'm|i'd|we|you|he|she|they|people|it suits|possible|convenient|ready"
    r"|it(?:'s| is| gets) (?:ready|convenient|possible|free|time))\b",
    re.IGNORECASE,
)
"""The words after *whenever* in talk and politeness: no fact of a picture."""
_UNASKED = re.compile(
    r",?\s*\bwithout asking(?: (?:me|us|anybody|anyone|first|again|me first))?\b", re.IGNORECASE
)
_LIMIT = re.compile(
    r",?\s*(?:\bbut\b\s*)?\b(?:at most|no more than|not more than) (\w+)(?: times?)?"
    r" (?:an|per|each|every) hour\b",
    re.IGNORECASE,
)
_TIMES = {"once": 1, "one": 1, "two": 2, "twice": 2, "three": 3, "four": 4, "five": 5, "six": 6,
          "ten": 10, "twelve": 12}  # fmt: skip
_MOST_LIMIT = 60

_SUBJECTS: dict[SubjectKind, tuple[str, ...]] = {
    "asset": ("that one", "this one", "that drone", "that robot", "that asset", "that unit",
              "that vehicle", "that ugv", "that uav", "the drone", "the robot", "the asset",
              "the unit", "the ugv", "the uav", "the ground vehicle", "it", "him", "her"),
    "gate": ("that gate", "this gate", "the gate", "that one", "this one", "it"),
    "track": ("that vehicle", "this vehicle", "the vehicle", "that car", "the car", "that person",
              "the person", "the visitor", "that visitor", "the intruder", "that one", "this one",
              "it", "him", "her", "them"),
}  # fmt: skip
_PLACES: dict[SubjectKind, tuple[str, ...]] = {
    "asset": ("its gate", "its post", "its place", "that gate", "the gate"),
    "gate": (),
    "track": ("that gate", "its gate", "the gate"),
}
_THERE = ("over there", "there")
_LEADS = frozenset(("to", "at", "from", "over", "towards"))
_STRAY = frozenset(("its", "it", "him", "her", "them", "their", "they", "there"))


@dataclass(frozen=True)
class ReadStanding:
    """The parts of a standing order as they were read; `order` has slots for the subject."""

    condition: ReadCondition
    order: str
    unasked: bool = False
    most_an_hour: int = MOST_STARTS


def read_standing(scene: Scene, text: str) -> ReadStanding | Unclear | None:
    """Return a standing order, the question about one, or None for a text that is none."""
    linked = link_names(scene.world, text)
    unasked, limit = _UNASKED.search(linked), _LIMIT.search(linked)
    most = MOST_STARTS
    if limit is not None:
        word = limit[1].lower()
        most = int(word) if word.isdigit() else _TIMES.get(word, 0)
    bare = _LIMIT.sub("", _UNASKED.sub("", linked))
    parts = _parts(bare)
    if parts is None:
        return None
    if not 1 <= most <= _MOST_LIMIT:
        return Unclear("", f"How many times an hour at most? A number from 1 to {_MOST_LIMIT}.")
    for condition, order in parts:
        read = read_condition(scene, read_tokens(condition))
        if read is not None:
            written = _with_slots(read.each, order)
            if isinstance(written, Unclear):
                return written
            return ReadStanding(read, written, unasked is not None, most)
    return Unclear(
        "",
        "it is to hold from now on, and what it waits for is not understood. Say it as: Whenever "
        f"CONDITION, ORDER. A condition is, for example: {'; '.join(EXAMPLES)}",
    )


def _parts(text: str) -> list[tuple[str, str]] | None:
    """Return the ways to part a text into condition and order, None for no standing order."""
    opening = _OPENING.match(text)
    if opening is not None:
        rest = text[opening.end() :]
        return None if _NO_CONDITION.match(rest) else [*_first_condition(rest)]
    ever = _IF_EVER.match(text)
    if ever is not None:
        rest = f"{ever['before']} {text[ever.end() :]}".strip()
        talk = _NO_CONDITION.match(rest) or _TALK.search(ever["before"])
        return None if talk else [*_first_condition(rest)]
    within = _WITHIN.search(text)
    if within is None or _NO_CONDITION.match(text[within.end() :].lstrip(" ,")):
        return None
    order = text[: within.start()].strip().rstrip(",").strip()
    return [(text[within.end() :].strip(), order)] if order else []


def _first_condition(text: str) -> Iterator[tuple[str, str]]:
    """Yield the ways to part *CONDITION, ORDER*: at a comma, at *then*, at a colon."""
    for found in re.finditer(r",\s*(?:then\b\s*)?|:\s*|\s+then\s+|\s+[-–—]\s+", text):
        if order := text[found.end() :].strip():
            yield text[: found.start()], order


def _with_slots(each: SubjectKind, order: str) -> str | Unclear:
    """Return an order with slots for the subject and its gate."""
    if "{" in order or "}" in order:
        return Unclear("", "braces mean nothing in an order. What is to be done?")
    tokens = read_tokens(order)
    text, done, at = "", 0, 0
    while at < len(tokens):
        reader = Reader(tokens, at)
        slot = _slot(each, reader, tokens, at)
        if slot:
            text += order[done : tokens[at].start] + slot
            done = tokens[reader.at - 1].end
        elif tokens[at].word in _STRAY:
            said = tokens[at].said
            return Unclear("", f"What does “{said}” stand for in “{order}”? Say it anew.")
        at = max(at + 1, reader.at)
    text = " ".join((text + order[done:]).split())
    text = text if tokens and tokens[0].said[:1].isupper() else f"{text[:1].upper()}{text[1:]}"
    return text if text.endswith((".", "!")) else f"{text}."


def _slot(each: SubjectKind, reader: Reader, tokens: tuple[Token, ...], at: int) -> str:
    """Read words that stand for the subject or its gate; '' where none are here."""
    if reader.take(*_PLACES[each]):
        return PLACE
    if reader.take(*_SUBJECTS[each]):
        return SUBJECT
    if reader.take(*_THERE):
        slot = SUBJECT if each == "gate" else PLACE
        led = at > 0 and tokens[at - 1].word in _LEADS
        return slot if led else f"to {slot}"
    return ""
