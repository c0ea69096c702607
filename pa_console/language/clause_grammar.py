"""Canonical words as grammars: what can be asked in a world, and what can be stated of it.

Assets, frames, zones and tracks go by the names that the picture has for them, and stand where it
says: an asset is relieved where it is, a track is at its own gate, and nobody comes from where
nobody is. A name that stands in the mission's own words is let through, and so is another number of
a team: that something is not there must be sayable.

A reason begins with what was asked, in words without a colon; what is stated of a place, an asset,
a track or of who is free has its name before a colon. Such statements are taken from the digest,
and whether the condition of an order is so is decided by it (`facts.py`). All else is left to
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
    standing,
    stands_at,
    told_assets,
    told_frames,
    tracks_of_digest,
)
from pa_console.language.canonical.order import in_words
from pa_console.language.canonical.reading import parted
from pa_console.language.name_linking import link_names
from pa_console.schema.telemetry import Digest
from pa_console.schema.world import PLAIN_KINDS, World

_UNDER = r"(if [ !#-9;-\[\]-~]+: )?"
_NOW = r"now: [ !#-:<-\[\]-~]+"
"""The state of a condition, which the picture decides."""
_PLAIN = r"[a-z]+|[0-9]+|\([A-Z]+-[0-9]+\)"
"""Text without names: plain words, numbers, a rule in brackets."""
MOST_CLAUSES = 8
_WORD = re.compile(r"[A-Za-z0-9_]+")
_NUMBER = re.compile(r"\d+")


def exactly(text: str) -> str:
    """Return a regular expression (Rust's syntax, between slashes) for `text` as it is."""
    return escape(text).replace("/", r"\/")


def asked_pattern(world: World, digest: Digest, words: str, *, facts: bool = True) -> str:
    """Return a regular expression (Rust's syntax) for reasons that begin with readable clauses.

    `words` are those of the mission; of an order under a condition both cases are readable. With
    `facts`, those that decide may follow.
    """
    told, tracks = told_assets(world, digest), tracks_of_digest(digest.tracks)
    frames = [*told_frames(world, digest), *world.zones]
    known = {*told, *frames, *(contact.id for contact in tracks)}
    said = [*map(exactly, (n for n in _names_in(link_names(world, words)) if n not in known))]
    assets = _either((*dict.fromkeys(map(_numbered, told)), *said))
    places = _either((*map(exactly, frames), *said))
    targets = _either((*(exactly(contact.id) for contact in tracks), *said))
    gates = _either((*map(exactly, _gates(world, frames)), *said))
    seen = (f"{exactly(track.id)} at ({exactly(track.gate)}|{NOWHERE})" for track in tracks)
    guards = (*_guards(told, digest, gates), *(f"{name} at {gates}" for name in said))
    clause = clause_pattern(
        NamePatterns(
            asset=assets,
            place=places,
            gate=gates,
            team=_teams(digest, said),
            track=_either((*seen, *(f"{name} at {gates}" for name in said))),
            guard=_either(guards),
        )
    )
    follows = rf"((; |, else: )({clause}|{NOTHING})){{0,{MOST_CLAUSES - 1}}}"
    excluded = rf"{EXCEPT}({assets}|{places})(, ({assets}|{places})){{0,{MOST_EXCLUDED - 1}}}"
    asked = rf"{ASKED}{_UNDER}{clause}{follows}(; {_NOW})?(; {excluded})?(; {OTHERS_STAY})?"
    return rf"{asked}(; {_facts_pattern(assets, places, targets)})?" if facts else asked


def _gates(world: World, frames: Iterable[str]) -> list[str]:
    return [name for name in frames if name in world.frames and world.frames[name].kind == "gate"]


def _guards(told: Iterable[str], digest: Digest, gates: str) -> Iterator[str]:
    """Yield who can be relieved: where it is or stood, at any gate where that is not told."""
    for name in told:
        at = stands_at(digest, name) if name in digest.posts else digest.stood.get(name, "")
        yield f"{exactly(name)} at {exactly(at) if at else gates}"


def _teams(digest: Digest, said: Iterable[str]) -> str:
    """Return the expression for a number of assets of a kind, or of any, with their origin.

    A kind without assets must be expressible, too.
    """
    there = (exactly(frame) for frame, names in standing(digest).items() if names)
    slots = {
        **TEAM_SLOTS,
        "count": f"({TEAM_SLOTS['count']})",
        "kind": f"({TEAM_SLOTS['kind']})",
        "origin": _either((*there, *said)),
    }
    return TEAM.pattern(slots)


def _facts_pattern(assets: str, places: str, targets: str) -> str:
    """Return the expression for the facts that decide: each is about a name, or in plain words.

    What is told of a place comes after a colon; it is assets that do something.
    """
    word = f"({_PLAIN}|{assets}|{places}|{targets})"
    about = f"((At )?{places}|{assets}|Free( [a-z]+)?): {word}"
    fact = f"({about}|{assets}|{targets}|{_PLAIN})( {word})*"
    return f"{fact}(, {fact})*"


def _names_in(text: str) -> Iterable[str]:
    """Return the words of `text` that look like a name: letters with a digit or underscore."""
    words = dict.fromkeys(_WORD.findall(text))
    return [word for word in words if re.search(r"[0-9_]", word) and re.search("[A-Za-z]", word)]


def _numbered(name: str) -> str:
    """Return the expression for `name` and for what others of its team would be called."""
    found = [*_NUMBER.finditer(name)]
    if not found:
        return exactly(name)
    start, end = found[-1].span()
    return rf"{exactly(name[:start])}[0-9]{{{end - start}}}{exactly(name[end:])}"


def _either(ways: Iterable[str]) -> str:
    """Return the expression for any of `ways`; with none of them, for what is never written."""
    return f"({'|'.join(ways) or '~~'})"


WORD = r"[ !#-9;-\[\]-~]"
"""Printable ASCII without the quote, the backslash and the colon."""
_PART = r"[ !#-+\--9<-\[\]-~]"
"""A character within what commas and semicolons part."""
_ORDER = r"([A-Zabcdefghj-z0-9_]|i[A-Zabcdeg-z0-9_])[A-Za-z0-9_,; ]*"
"""The same in names, numbers and plain words alone."""
_WORDS = f"{WORD}{{1,160}}"
ASKED_ONCE = f"{ASKED}({_WORDS}|if {_WORDS}: {_WORDS}, else: {_WORDS}; now: {_WORDS}(: {_WORDS})?)"
"""A regular expression for a reading of a moment whose digest is gone."""
MOST_PARTS = 24
"""The largest number of clauses, names and facts in a reason, divided by commas and semicolons."""
MOST_PLAIN = 80
"""The longest fact in the model's own words, in characters."""
_UNCONDITIONAL = rf"([ !#-+\--9<-\[\]-hj-~]|i[ !#-+\--9<-\[\]-eg-~]){_PART}{{0,{MOST_PLAIN}}}"
"""Words that do not begin as a condition does: the names in one are those of the digest."""
MOST_PLANNED = 140
"""Longer words for a plan leave too little room beside them."""
_SO = {True: "so", False: "not so", None: "(not )?so"}
_END = r"( \([A-Z]+-[0-9]+\))?( takes over| stays)?"


def asked_now(world: World, digest: Digest, asked: str) -> str:
    """Return the reading `asked` of some moment in the words for the picture of `digest`.

    A condition is written with its present state, if the digest decides it.
    """
    meant, under, then = asked.partition("; now: ")
    for condition in conditions(world, digest) if under else ():
        if meant.startswith(f"{ASKED}if {in_words(condition)}: "):
            _, limits = parted(then.split("; "))
            so = _SO[holds(condition, DigestFacts(digest))]
            stands = "; ".join((f"; now: {evidence(condition, digest)}, {so}", *limits))
            return meant + stands if so in ("so", "not so") else asked
    return asked


def grounded_reason(world: World, digest: Digest, words: str, asked: str = "") -> tuple[str, ...]:
    """Return regular expressions (Rust's syntax) that a reason has to match, each of them.

    It states what `digest` bears out, and what was asked in clauses about what there is, or about
    names that stand in the mission's `words`; in the words `asked`, where those are given.
    """
    plain = _not_beginning(" only ")
    part = f" {_either(_stated(world, digest))}{_END}|{plain}"
    begins = exactly(asked) if asked else _asked(world, digest, _UNCONDITIONAL)
    stated = f"{begins}([;,]({part})){{0,{MOST_PARTS}}}"
    return stated, asked_pattern(world, digest, words)


def grounded_asked(world: World, digest: Digest, words: str, asked: str = "") -> tuple[str, ...]:
    """Return the same for a judge's reading, in words like those of orders.

    Facts of the picture, which come with colons, brackets and rule ids, have no place in it.
    """
    if asked:
        return (exactly(asked),)
    return _asked(world, digest, _ORDER), asked_pattern(world, digest, words, facts=False)


def _asked(world: World, digest: Digest, unconditional: str) -> str:
    """Return the reading; `digest` decides its conditions."""
    under = (
        f"{escape(in_words(condition))}: {WORD}+, else: {WORD}+; "
        f"now: {escape(evidence(condition, digest))}, {_SO[holds(condition, DigestFacts(digest))]}"
        for condition in conditions(world, digest)
    )
    return f"{ASKED}({unconditional}|if {_either(under)})"


def _stated(world: World, digest: Digest) -> Iterator[str]:
    """Yield what can be stated: of assets, of places, of tracks, of who is free."""
    yield "only watch"
    for name in told_assets(world, digest):
        state = asset_state(digest, name) if name in digest.posts else "down"
        ways = [state, state.partition(",")[0]]
        ways += [f"alone at {gate}" for gate, sole in digest.sole_cover.items() if sole == name]
        ways += ["poor link"] * (name in digest.degraded_comms)
        ways += [digest.posts.get(name, "").partition(" ")[2]] * (name in digest.posts)
        yield f"{name}: {_either(dict.fromkeys(ways))}"
    yield "[A-Za-z0-9_]+: no such asset"
    stand = {frame: list[str]() for frame in told_frames(world, digest)} | standing(digest)
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
    """Return the expression for a fact in the model's own words that does not begin so."""
    rest = f"{_PART}{{0,{MOST_PLAIN}}}"
    ways = (f"{start[:n]}([{_PART[1:-1]}&&[^{char}]]{rest})?" for n, char in enumerate(start))
    return _either(ways)


def _some_of(names: Iterable[str]) -> str:
    """Return the way to name some of `names`, or how many of them; with a bar after it."""
    known = tuple(names)
    if not known:
        return ""
    counts = (f"{number} assets" for number in range(2, len(known) + 1))
    return f"(only )?{_either((*known, *counts))}|"
