"""A parser that recognizes standing orders and reads their parts.

The form is *Whenever CONDITION, ORDER*, also with *each time*, *every time*, *if ... ever ...*, or
with the order first. In the order, *it*, *that drone*, *its gate* and *there* refer to the subject
of the condition. The operator is asked about unclear words; none are guessed.

A condition consists of a subject, which may match any of several assets, tracks or gates, and its
state. For example, *a drone at the east gate is below 20 %* is translated to CEL. The grammar
parses from left to right. One unknown word makes the whole condition unreadable.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from pa_console.language.lexicon import word_lists
from pa_console.language.mentions import ASSETS
from pa_console.language.name_linking import link_names
from pa_console.language.references import reader as words
from pa_console.language.references.conversation import Unclear
from pa_console.language.references.reader import (
    Reader,
    WordToken,
    asset_at,
    number_of,
    place_at,
    read_tokens,
)
from pa_console.language.references.scene import ReferenceScene
from pa_console.schema.mission import MOST_STARTS, PLACE, SUBJECT, SubjectKind
from pa_console.schema.world import PLAIN_KINDS, AssetKind

_WORDS = word_lists("standing_orders")
_IS = _WORDS["is"]
_ARTICLES = _WORDS["articles"]
_BELOW = _WORDS["below"]
_ABOVE = _WORDS["above"]
_PERCENT = frozenset(_WORDS["percent"])
_SOMEBODY = frozenset(_WORDS["somebody"])
_COMES = frozenset(_WORDS["comes"])
_STOPS = frozenset(_WORDS["stops"])
_IDENTITIES = {
    "unknown": ("it.identity == 'unknown'", "unknown"),
    "unidentified": ("it.identity == 'unknown'", "unknown"),
    "unauthorized": ("it.identity == 'unauthorized'", "unauthorized"),
    "unauthorised": ("it.identity == 'unauthorized'", "unauthorized"),
    "authorized": ("it.identity == 'authorized'", "authorized"),
    "authorised": ("it.identity == 'authorized'", "authorized"),
    "hostile": ("it.intent == 'hostile'", "hostile"),
}
_FAILS = "it.status == 'failed'", "has failed"
_UNHEARD = "(it.comms == 'lost' || it.stale)", "is not heard"
_STAYS = "it.status != 'leaving'"

EXAMPLES = (
    "a drone is below 20 %", "an asset has failed", "a gate has no guard",
    "an unknown vehicle comes to a gate", "a vehicle ignores a warning",
)  # fmt: skip
"""Examples of conditions."""

_OPENING = re.compile(
    r"\s*(?:(?:please|ok|okay|from now on|as a standing order|standing order)\b[\s,:]*)*"
    r"(?:whenever|each time|every time|any ?time)\b[\s,]*"
    r"(?:(?:you|we) (?:see|notice|hear|find)\b\s*)?(?:that\b\s*)?",
    re.IGNORECASE,
)
_IF_EVER = re.compile(r"\s*(?:please[\s,]+)?if\b(?P<before>[^,]*?)\bever\b", re.IGNORECASE)
_TALK = re.compile(r"\b(?:i|me|my|would|were|could|might)\b", re.IGNORECASE)
"""Words before *ever* that mark mere talk: *if it were up to me nothing would ever*."""
_WITHIN = re.compile(r"\b(?:whenever|each time|every time|if ever)\b", re.IGNORECASE)
_NO_CONDITION = re.compile(
    r"\s*(?:i|i'm|i'd|we|you|he|she|they|people|it suits|possible|convenient|ready"
    r"|it(?:'s| is| gets) (?:ready|convenient|possible|free|time))\b",
    re.IGNORECASE,
)
"""Words after *whenever* that mark mere talk or a polite phrase."""
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

_SUBJECTS = word_lists("standing_subjects")
_PLACES = word_lists("standing_places")
_THERE = _WORDS["there"]
_LEADS = frozenset(_WORDS["leads"])
_STRAY = frozenset(_WORDS["stray"])


@dataclass(frozen=True)
class ReadCondition:
    """A condition: the kind of its subjects, and its form in CEL and in plain words."""

    subject_kind: SubjectKind
    cel: str
    words: str


@dataclass
class _ConditionParts:
    """The parts read so far: the kind of the subject, its words, and the terms in CEL."""

    subject_kind: SubjectKind = "asset"
    noun: str = ""
    location: str = ""
    terms: list[str] = field(default_factory=list[str])


def read_condition(scene: ReferenceScene, tokens: Sequence[WordToken]) -> ReadCondition | None:
    """Return the condition in `tokens`; None if one of the words is not understood."""
    reader = Reader(tokens)
    there_is = bool(reader.take("there is", "there are", "there 's"))
    parts = _subject(scene, reader)
    if parts is None:
        return None
    _place(scene, reader, parts)
    state = "is there" if there_is and parts.subject_kind == "track" and parts.location else ""
    if state:
        parts.terms.append(_STAYS)
    else:
        predicate = {"asset": _of_asset, "gate": _of_gate, "track": _of_track}[parts.subject_kind]
        state = predicate(scene, reader, parts)
    reader.skip(frozenset((",", ".", "!", "again", "now")))
    if not state or not reader.over:
        return None
    return ReadCondition(
        parts.subject_kind, " && ".join(parts.terms), f"{parts.noun}{parts.location} {state}"
    )


# ------------------------------------------------------------------ the subject


def _subject(scene: ReferenceScene, reader: Reader) -> _ConditionParts | None:
    """Read the subject; return None if it is not understood."""
    charge_of = bool(reader.take("the battery of", "the charge of"))
    name = asset_at(scene, reader)
    if name:
        return _ConditionParts("asset", name, terms=[f"id == {_text(name)}"])
    gate = "" if charge_of else place_at(scene, reader)
    if gate:
        return (
            _ConditionParts("gate", gate, terms=[f"id == {_text(gate)}"])
            if gate in scene.gates
            else None
        )
    if reader.take_in(_SOMEBODY):
        return _ConditionParts("track", "somebody")
    article = bool(reader.take(*_ARTICLES))
    return _asset_noun(scene, reader, article=article) or _other_noun(reader)


def _asset_noun(scene: ReferenceScene, reader: Reader, *, article: bool) -> _ConditionParts | None:
    """Read *drone*, *ground vehicle*, *scout* or *asset*; *vehicle* alone is a contact."""
    ground = bool(reader.take("ground"))
    word = reader.word()
    single = word.removesuffix("s")
    if single == "vehicle" and not ground:
        return None
    if single in ASSETS:
        reader.at += 1
        return _ConditionParts("asset", f"an {single}" if single[0] in "aeiou" else f"a {single}")
    team = scene.members(word)
    if not team or not article:
        return None
    reader.at += 1
    kinds: set[AssetKind] = {scene.world.assets[name].kind for name in team}
    whole = {name for name, spec in scene.world.assets.items() if spec.kind in kinds} == set(team)
    if whole and len(kinds) == 1:
        kind = next(iter(kinds))
        plain = "ground vehicle" if kind == "ugv" else PLAIN_KINDS[kind]
        return _ConditionParts("asset", f"a {plain}", terms=[f"it.kind == {_text(kind)}"])
    names = ", ".join(_text(name) for name in scene.in_order(team))
    return _ConditionParts("asset", f"a {single}", terms=[f"id in [{names}]"])


def _other_noun(reader: Reader) -> _ConditionParts | None:
    """Read *gate*, or a contact with its known identity: *unknown vehicle*."""
    if reader.take("gate", "gates", "post", "entrance"):
        return _ConditionParts("gate", "a gate")
    parts = _ConditionParts("track")
    adjectives: list[str] = []
    while word := reader.take_in(_IDENTITIES.keys()):
        cel, plain = _IDENTITIES[word]
        parts.terms.append(cel)
        adjectives.append(plain)
    word = reader.word().removesuffix("s")
    if word not in words.CONTACTS:
        return None
    reader.at += 1
    if kind := words.CONTACTS[word]:
        parts.terms.append(f"it.kind == {_text(kind)}")
    noun = " ".join((*adjectives, kind or "visitor"))
    parts.noun = f"an {noun}" if noun[0] in "aeiou" else f"a {noun}"
    return parts


def _place(scene: ReferenceScene, reader: Reader, parts: _ConditionParts) -> None:
    """Read *at the east gate* after an asset or a track."""
    start = reader.at
    if parts.subject_kind == "gate" or not reader.take_in(words.IN):
        return
    place = place_at(scene, reader)
    if not place or (parts.subject_kind == "track" and place not in scene.gates):
        reader.at = start
        return
    parts.location = f" at {place}"
    quoted = _text(place)
    at = (
        f"(it.post == {quoted} || it.at == {quoted})"
        if parts.subject_kind == "asset"
        else _gate(place)
    )
    parts.terms.append(at)


# ------------------------------------------------------------------ the state of the subject


def _of_asset(scene: ReferenceScene, reader: Reader, parts: _ConditionParts) -> str:
    """Read the state of an asset and return it in words; '' if it is not understood."""
    start = reader.at
    if reader.take("'s") and not reader.take_in(words.CHARGE):
        reader.at = start
    if reader.take("fails", "breaks down", "dies", "breaks", "crashes", "has failed", "goes down"):
        return _with_term(parts, *_FAILS)
    if reader.take("stops answering", "is not heard", "is not heard of", "is no longer heard",
                   "goes off the net", "loses its link", "loses the link"):  # fmt: skip
        return _with_term(parts, *_UNHEARD)
    has = bool(reader.take("has", "have")) and not reader.take("fallen", "dropped", "sunk", "gone")
    if not has:
        reader.take(*_IS)
        reader.take("getting", "running", "down to")
    if charge := _charge(reader, has=has):
        comparison, percent = charge
        sign = "<" if comparison == "below" else ">"
        below = f"is {comparison} {percent:g} % battery"
        return _with_term(parts, f"it.battery_pct {sign} {percent:.1f}", below)
    return "" if has else _state(reader, parts) or _arrives(scene, reader, parts)


def _state(reader: Reader, parts: _ConditionParts) -> str:
    """Read a state of an asset after *is* and return it in words; '' if there is none."""
    if reader.take("low", "flat", "nearly empty", "almost empty", "out of battery"):
        if reader.take("on", "of"):
            reader.take_in(words.CHARGE)
        return _with_term(parts, "it.low_battery", "is low on battery")
    if reader.take_in(words.FAILED) or reader.take("out of order", "out of action"):
        return _with_term(parts, *_FAILS)
    if reader.take_in(words.SILENT):
        return _with_term(parts, *_UNHEARD)
    if reader.take("suspect", "spoofed", "sending suspect telemetry", "suspect telemetry"):
        return _with_term(parts, "it.integrity == 'suspect'", "sends suspect telemetry")
    return ""


def _arrives(scene: ReferenceScene, reader: Reader, parts: _ConditionParts) -> str:
    if parts.location or not reader.take(
        "at", "arrives at", "reaches", "back at", "comes to", "in"
    ):
        return ""
    place = place_at(scene, reader)
    return _with_term(parts, f"it.at == {_text(place)}", f"is at {place}") if place else ""


def _charge(reader: Reader, *, has: bool) -> tuple[str, float] | None:
    """Read *below 20 %* or *less than 20 percent battery left*; return None if there is none."""
    start = reader.at
    below = bool(reader.take(*_BELOW))
    if not below and not reader.take(*_ABOVE):
        return None
    number = reader.word()
    decimal = re.fullmatch(r"\d{1,3}", number)
    percent = float(number) if decimal else float(number_of(number))
    reader.at += 1
    unit = bool(reader.take_in(_PERCENT))
    reader.take("of")
    reader.take("its")
    charge = bool(reader.take_in(words.CHARGE))
    reader.take("left", "remaining")
    if not 0.0 < percent <= 100.0 or not (unit or charge) or (has and not below):
        reader.at = start
        return None
    return ("below" if below else "above"), percent


def _of_gate(_: ReferenceScene, reader: Reader, parts: _ConditionParts) -> str:
    """Read the cover of a gate and return it in words; '' if it is not understood."""
    bare = "!it.covered && size(it.unsure) == 0"
    if reader.take("has no", "has not a", "is without a", "is without", "loses its last",
                   "loses its only", "loses its", "has lost its"):  # fmt: skip
        if reader.take_in(words.GUARDS):
            return _with_term(parts, bare, "has no guard")
        return ""
    if reader.take("has only one", "has fewer than two", "has less than two", "is down to one"):
        if reader.take_in(words.GUARDS):
            return _with_term(parts, "size(it.by) < 2", "has fewer than 2 guards")
        return ""
    reader.take("is left", "is", "'s", "gets", "becomes", "stands", "goes")
    if reader.take_in(words.BARE) or (reader.take("not") and reader.take_in(words.GUARDED)):
        return _with_term(parts, bare, "has no guard")
    return ""


def _of_track(scene: ReferenceScene, reader: Reader, parts: _ConditionParts) -> str:
    """Read the behaviour of a track and return it in words; '' if it is not understood."""
    if reader.take("ignores", "defies", "disregards"):
        reader.take("a", "the", "its", "our")
        ignored = bool(reader.take("warning", "warnings"))
        return _with_term(parts, "it.defiant", "ignores a warning") if ignored else ""
    if reader.take("gets inside", "comes inside", "is inside", "gets in", "comes in", "breaks in",
                   "passes the gate"):  # fmt: skip
        return _with_term(parts, "it.status == 'inside'", "is inside")
    if reader.take("turns up", "shows up"):
        return _comes(scene, reader, parts)
    if reader.take("is", "'s", "turns out", "turns", "becomes", "proves"):
        return _is_track(scene, reader, parts)
    if reader.take_in(_STOPS):
        return _with_term(
            parts, "it.status == 'stopped'", f"stops{_target(scene, reader, parts, 'at')}"
        )
    if reader.take_in(_COMES):
        reader.take("up")
        return _comes(scene, reader, parts)
    return ""


def _comes(scene: ReferenceScene, reader: Reader, parts: _ConditionParts) -> str:
    """Read the destination of a track and return its movement in words."""
    target = _target(scene, reader, parts, "to")
    return _with_term(
        parts, _STAYS, f"comes{target or (' to a gate' if not parts.location else '')}"
    )


def _is_track(scene: ReferenceScene, reader: Reader, parts: _ConditionParts) -> str:
    reader.take("to be")
    reader.take("identified as", "known to be", "found to be")
    if word := reader.take_in(_IDENTITIES.keys()):
        cel, plain = _IDENTITIES[word]
        return _with_term(parts, f"{_STAYS} && {cel}", f"is {plain}")
    if reader.take("approaching", "coming", "seen", "detected", "arriving"):
        reader.take("up")
        return _comes(scene, reader, parts)
    if reader.take("waiting", "parked", "standing", "stopped"):
        return _with_term(
            parts, "it.status == 'stopped'", f"stops{_target(scene, reader, parts, 'at')}"
        )
    target = _target(scene, reader, parts, "at")
    return _with_term(parts, _STAYS, f"is{target}") if target else ""


def _target(scene: ReferenceScene, reader: Reader, parts: _ConditionParts, joint: str) -> str:
    """Read the destination of a contact: *to the east gate*, *at any gate*; return '' if none."""
    start = reader.at
    reader.take("to", "at", "towards", "toward", "for", "in front of", "near", "outside")
    if not parts.location and (place := place_at(scene, reader)) in scene.gates:
        parts.terms.append(_gate(place))
        return f" {joint} {place}"
    if reader.take("a gate", "any gate", "one of the gates", "the gates", "any of the gates",
                   "the checkpoint", "the perimeter"):  # fmt: skip
        return f" {joint} a gate"
    reader.at = start
    return ""


def _with_term(parts: _ConditionParts, cel: str, plain: str) -> str:
    parts.terms.append(cel)
    return plain


def _gate(place: str) -> str:
    return f"it.gate == {_text(place)}"


def _text(text: str) -> str:
    """Return a name as a CEL string; names contain no quotes."""
    return f"'{text}'"


@dataclass(frozen=True)
class ReadStanding:
    """The parts of a standing order; `order` has slots for the subject of the condition."""

    condition: ReadCondition
    order: str
    unasked: bool = False
    most_an_hour: int = MOST_STARTS


def asks_nobody(text: str) -> tuple[str, bool]:
    """Return an order without the words *without asking*, and whether it had them."""
    return _UNASKED.sub("", text), _UNASKED.search(text) is not None


def read_standing(scene: ReferenceScene, text: str) -> ReadStanding | Unclear | None:
    """Return a standing order, a question about it, or None if the text is not one."""
    linked = link_names(scene.world, text)
    command, unasked = asks_nobody(linked)
    limit = _LIMIT.search(command)
    most = MOST_STARTS
    if limit is not None:
        word = limit[1].lower()
        most = int(word) if word.isdecimal() else _TIMES.get(word, 0)
    parts = _parts(_LIMIT.sub("", command))
    if parts is None:
        return None
    if not 1 <= most <= _MOST_LIMIT:
        return Unclear(
            "", f"How many times an hour at most? Give a number from 1 to {_MOST_LIMIT}."
        )
    for condition, order in parts:
        reading = read_condition(scene, read_tokens(condition))
        if reading is not None:
            template = _with_slots(reading.subject_kind, order)
            if isinstance(template, Unclear):
                return template
            return ReadStanding(reading, template, unasked, most)
    return Unclear(
        "",
        "the condition of this standing order is not understood. Write: Whenever CONDITION, ORDER. "
        f"Examples of conditions: {'; '.join(EXAMPLES)}",
    )


def _parts(text: str) -> list[tuple[str, str]] | None:
    """Return the ways to split a standing order into condition and order; None for other texts."""
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
    """Yield the ways to split *CONDITION, ORDER*: at a comma, *then*, a colon or a dash."""
    for separator in re.finditer(r",\s*(?:then\b\s*)?|:\s*|\s+then\s+|\s+[-–—]\s+", text):
        if order := text[separator.end() :].strip():
            yield text[: separator.start()], order


def _with_slots(subject_kind: SubjectKind, order: str) -> str | Unclear:
    """Return an order with slots for the subject and its gate, or a question about it."""
    if "{" in order or "}" in order:
        return Unclear("", "braces have no meaning in an order. What is to be done?")
    tokens = read_tokens(order)
    text, done, at = "", 0, 0
    while at < len(tokens):
        reader = Reader(tokens, at)
        slot = _slot(subject_kind, reader, tokens, at)
        if slot:
            text += order[done : tokens[at].start] + slot
            done = tokens[reader.at - 1].end
        elif tokens[at].word in _STRAY:
            word = tokens[at].written
            return Unclear("", f"What does “{word}” stand for in “{order}”? Say it in other words.")
        at = max(at + 1, reader.at)
    text = " ".join((text + order[done:]).split())
    text = text if tokens and tokens[0].written[:1].isupper() else f"{text[:1].upper()}{text[1:]}"
    return text if text.endswith((".", "!")) else f"{text}."


def _slot(subject_kind: SubjectKind, reader: Reader, tokens: tuple[WordToken, ...], at: int) -> str:
    """Read words that mean the subject or its gate, and return the slot; '' if there are none."""
    if reader.take(*_PLACES.get(subject_kind, ())):
        return PLACE
    if reader.take(*_SUBJECTS[subject_kind]):
        return SUBJECT
    if reader.take(*_THERE):
        slot = SUBJECT if subject_kind == "gate" else PLACE
        led = at > 0 and tokens[at - 1].word in _LEADS
        return slot if led else f"to {slot}"
    return ""
