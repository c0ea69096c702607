"""Grammars of canonical words: the requests that are possible in a world, and statements about it.

A clause may use only names and places of the picture: an asset is relieved at the place where it
is, a track is at its own gate, and no asset comes from an empty place. Names in the mission's own
words are allowed too, and so are other numbers of a team, because a reading must be able to name
things that do not exist.

A reason begins with the reading, in words without a colon. A statement about a place, an asset, a
track or the free assets begins with the name and a colon. Such statements come from the digest,
which also decides whether the condition of an order holds (`facts.py`). All other words are left to
the model.
"""

import re
from collections.abc import Iterable, Iterator
from re import escape

from pa_console.language.canonical.clauses import (
    ASKED,
    EXCEPT,
    MOST_EXCLUDED,
    NOTHING,
    NOWHERE,
    OTHERS_STAY,
    TEAM,
    TEAM_SLOTS,
    NamePatterns,
    clause_pattern,
)
from pa_console.language.canonical.facts import (
    DigestFacts,
    asset_state,
    conditions,
    evidence,
    holds,
    shown_assets,
    shown_frames,
    standing,
    stands_at,
    tracks_of_digest,
)
from pa_console.language.canonical.order import in_words
from pa_console.language.canonical.reading import parted
from pa_console.language.name_linking import link_names
from pa_console.schema.telemetry import Digest
from pa_console.schema.world import PLAIN_KINDS, World

_UNDER = r"(if [ !#-9;-\[\]-~]+: )?"
_NOW = r"now: [ !#-:<-\[\]-~]+"
"""The expression for the present state of a condition, which the picture decides."""
_PLAIN = r"[a-z]+|[0-9]+|\([A-Z]+-[0-9]+\)"
"""The expression for text without names: a plain word, a number, or a rule in brackets."""
MOST_CLAUSES = 8
_WORD = re.compile(r"[A-Za-z0-9_]+")
_NUMBER = re.compile(r"\d+")

WORD = r"[ !#-9;-\[\]-~]"
"""A printable ASCII character other than a double quote, a backslash or a colon."""
_PART = r"[ !#-+\--9<-\[\]-~]"
"""A character within one part of a reason; commas and semicolons separate the parts."""
_ORDER = r"([A-Zabcdefghj-z0-9_]|i[A-Zabcdeg-z0-9_])[A-Za-z0-9_,; ]*"
"""The expression for a reading without a condition: names, numbers and plain words."""
_WORDS = f"{WORD}{{1,160}}"
ASKED_ONCE = f"{ASKED}({_WORDS}|if {_WORDS}: {_WORDS}, else: {_WORDS}; now: {_WORDS}(: {_WORDS})?)"
"""A regular expression for a reading whose digest no longer exists."""
MOST_PARTS = 24
"""The largest number of parts in a reason, which commas and semicolons separate."""
MOST_PLAIN = 80
"""The largest length of a fact in the model's own words, in characters."""
_UNCONDITIONAL = rf"([ !#-+\--9<-\[\]-hj-~]|i[ !#-+\--9<-\[\]-eg-~]){_PART}{{0,{MOST_PLAIN}}}"
"""The expression for words that do not begin like a condition; a condition may only have names from
the digest."""
MOST_PLANNED = 140
"""The largest length of a plan in a comparison, in characters, so that the rest has enough room."""
_SO = {True: "so", False: "not so", None: "(not )?so"}
_END = r"( \([A-Z]+-[0-9]+\))?( takes over| stays)?"


def exactly(text: str) -> str:
    """Return a regular expression (Rust's syntax, between slashes) that matches only `text`."""
    return escape(text).replace("/", r"\/")


def asked_pattern(world: World, digest: Digest, words: str, *, facts: bool = True) -> str:
    """Return a regular expression (Rust's syntax) for reasons that begin with readable clauses.

    `words` are the words of the mission. If an order has a condition, the clauses for both cases
    must be readable. With `facts`, the deciding facts may follow.
    """
    assets_shown, tracks = shown_assets(world, digest), tracks_of_digest(digest.tracks)
    frames = [*shown_frames(world, digest), *world.zones]
    existing = {*assets_shown, *frames, *(contact.id for contact in tracks)}
    unknown = [*map(exactly, (n for n in _names_in(link_names(world, words)) if n not in existing))]
    assets = _either((*dict.fromkeys(map(_numbered, assets_shown)), *unknown))
    places = _either((*map(exactly, frames), *unknown))
    targets = _either((*(exactly(contact.id) for contact in tracks), *unknown))
    gates = _either((*map(exactly, _gates(world, frames)), *unknown))
    seen = (f"{exactly(track.id)} at ({exactly(track.gate)}|{NOWHERE})" for track in tracks)
    guards = (*_guards(assets_shown, digest, gates), *(f"{name} at {gates}" for name in unknown))
    clause = clause_pattern(
        NamePatterns(
            asset=assets,
            place=places,
            gate=gates,
            team=_teams(digest, unknown),
            track=_either((*seen, *(f"{name} at {gates}" for name in unknown))),
            guard=_either(guards),
        )
    )
    follows = rf"((; |, else: )({clause}|{NOTHING})){{0,{MOST_CLAUSES - 1}}}"
    excluded = rf"{EXCEPT}({assets}|{places})(, ({assets}|{places})){{0,{MOST_EXCLUDED - 1}}}"
    readings = rf"{ASKED}{_UNDER}{clause}{follows}(; {_NOW})?(; {excluded})?(; {OTHERS_STAY})?"
    return rf"{readings}(; {_facts_pattern(assets, places, targets)})?" if facts else readings


def _gates(world: World, frames: Iterable[str]) -> list[str]:
    return [name for name in frames if name in world.frames and world.frames[name].kind == "gate"]


def _guards(assets: Iterable[str], digest: Digest, gates: str) -> Iterator[str]:
    """Yield each asset that can be relieved, with its place, or any gate if that is unknown."""
    for name in assets:
        at = stands_at(digest, name) if name in digest.posts else digest.stood.get(name, "")
        yield f"{exactly(name)} at {exactly(at) if at else gates}"


def _teams(digest: Digest, unknown: Iterable[str]) -> str:
    """Return the regular expression for unnamed assets: their number, kind and origin.

    Kinds that have no assets are included.
    """
    there = (exactly(frame) for frame, names in standing(digest).items() if names)
    slots = {
        **TEAM_SLOTS,
        "count": f"({TEAM_SLOTS['count']})",
        "kind": f"({TEAM_SLOTS['kind']})",
        "origin": _either((*there, *unknown)),
    }
    return TEAM.pattern(slots)


def _facts_pattern(assets: str, places: str, targets: str) -> str:
    """Return the regular expression for the deciding facts.

    Each fact is about a name or is stated in plain words. A fact about a place needs a colon after
    the name; a fact about an asset or a track does not.
    """
    word = f"({_PLAIN}|{assets}|{places}|{targets})"
    about = f"((At )?{places}|{assets}|Free( [a-z]+)?): {word}"
    fact = f"({about}|{assets}|{targets}|{_PLAIN})( {word})*"
    return f"{fact}(, {fact})*"


def _names_in(text: str) -> Iterable[str]:
    """Return the words of `text` that look like names: letters with a digit or an underscore."""
    words = dict.fromkeys(_WORD.findall(text))
    return [word for word in words if re.search(r"[0-9_]", word) and re.search("[A-Za-z]", word)]


def _numbered(name: str) -> str:
    """Return the regular expression for `name` with any number, as for other assets of its team."""
    numbers = [*_NUMBER.finditer(name)]
    if not numbers:
        return exactly(name)
    start, end = numbers[-1].span()
    return rf"{exactly(name[:start])}[0-9]{{{end - start}}}{exactly(name[end:])}"


def _either(ways: Iterable[str]) -> str:
    """Return the regular expression for any of `ways`; if there are none, it matches no text."""
    return f"({'|'.join(ways) or '~~'})"


def asked_now(world: World, digest: Digest, reading: str) -> str:
    """Return the earlier reading `reading`, updated to the picture of `digest`.

    A condition is written with its present state if the digest decides it.
    """
    case, under, then = reading.partition("; now: ")
    for condition in conditions(world, digest) if under else ():
        if case.startswith(f"{ASKED}if {in_words(condition)}: "):
            _, limits = parted(then.split("; "))
            so = _SO[holds(condition, DigestFacts(digest))]
            stands = "; ".join((f"; now: {evidence(condition, digest)}, {so}", *limits))
            return case + stands if so in ("so", "not so") else reading
    return reading


def grounded_reason(world: World, digest: Digest, words: str, reading: str = "") -> tuple[str, ...]:
    """Return the regular expressions (Rust's syntax) that a reason must match, all of them.

    They allow statements that `digest` supports, and clauses about existing things or about names
    in the mission's `words`. If `reading` is given, the reason has to begin with it.
    """
    plain = _not_beginning(" only ")
    part = f" {_either(_stated(world, digest))}{_END}|{plain}"
    begins = exactly(reading) if reading else _reading_pattern(world, digest, _UNCONDITIONAL)
    stated = f"{begins}([;,]({part})){{0,{MOST_PARTS}}}"
    return stated, asked_pattern(world, digest, words)


def grounded_asked(world: World, digest: Digest, words: str, reading: str = "") -> tuple[str, ...]:
    """Return the regular expressions that a judge's reading must match, all of them.

    The reading is in words like those of an order. It cannot state facts of the picture, because
    its clauses have no colons, brackets or rule ids.
    """
    if reading:
        return (exactly(reading),)
    return _reading_pattern(world, digest, _ORDER), asked_pattern(world, digest, words, facts=False)


def _reading_pattern(world: World, digest: Digest, unconditional: str) -> str:
    """Return the expression for a reading; `digest` decides its conditions."""
    under = (
        f"{escape(in_words(condition))}: {WORD}+, else: {WORD}+; "
        f"now: {escape(evidence(condition, digest))}, {_SO[holds(condition, DigestFacts(digest))]}"
        for condition in conditions(world, digest)
    )
    return f"{ASKED}({unconditional}|if {_either(under)})"


def _stated(world: World, digest: Digest) -> Iterator[str]:
    """Yield the possible statements about assets, places, tracks and free assets."""
    yield "only watch"
    for name in shown_assets(world, digest):
        state = asset_state(digest, name) if name in digest.posts else "down"
        ways = [state, state.partition(",")[0]]
        ways += [f"alone at {gate}" for gate, sole in digest.sole_cover.items() if sole == name]
        ways += ["poor link"] * (name in digest.degraded_comms)
        ways += [digest.posts.get(name, "").partition(" ")[2]] * (name in digest.posts)
        yield f"{name}: {_either(dict.fromkeys(ways))}"
    yield "[A-Za-z0-9_]+: no such asset"
    stand = {frame: list[str]() for frame in shown_frames(world, digest)} | standing(digest)
    for frame, there in stand.items():
        who = [*there, f"{len(there)} assets"] if there else ["nobody"]
        yield f"{frame}: {_either(who)}"
        yield from (f"only {name} is there" for name in there if len(there) == 1)
    tracks = tracks_of_digest(digest.tracks)
    for frame in stand:
        here = [contact for contact in tracks if contact.gate == frame]
        ways = [f"{contact.id} {contact.kind}, {contact.step}" for contact in here]
        ways += ["no track"] * (not any(contact.here for contact in here))
        yield f"At {frame}: {_either(ways)}"
    for kind, names in digest.free.items():
        yield f"Free {PLAIN_KINDS[kind]}: ({_some_of(names)}none( to look first)?)"
    every = [name for names in digest.free.values() for name in names]
    yield f"Free: ({_some_of(every)}none)"


def _not_beginning(start: str) -> str:
    """Return the expression for a fact in the model's words that does not begin with `start`."""
    rest = f"{_PART}{{0,{MOST_PLAIN}}}"
    ways = (f"{start[:n]}([{_PART[1:-1]}&&[^{char}]]{rest})?" for n, char in enumerate(start))
    return _either(ways)


def _some_of(names: Iterable[str]) -> str:
    """Return the expression for one or more of `names`, followed by a bar; '' without names."""
    choices = tuple(names)
    if not choices:
        return ""
    counts = (f"{number} assets" for number in range(2, len(choices) + 1))
    return f"(only )?{_either((*choices, *counts))}|"
