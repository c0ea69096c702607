"""Which clauses can stand for what was asked in a world: those that name what is there or was said.

Assets, frames, zones and tracks go by the names that the picture has for them, and stand where it
says: an asset is relieved where it is, a track is at its own gate, and nobody comes from where
nobody is. A name that stands in the mission's own words is let through, and so is another number of
a team: that something is not there must be sayable.
"""

import re
from collections.abc import Iterable, Iterator

from pa_console.llm.compact_prompt import standing, stands_at
from pa_console.llm.condition import told_assets, told_frames
from pa_console.llm.contact import contacts
from pa_console.llm.facts import WORDS
from pa_console.llm.grammar import exactly
from pa_console.llm.linking import link_names
from pa_console.llm.reading import NOWHERE, Names, clause_pattern
from pa_console.schema.telemetry import Digest
from pa_console.schema.world import World

_UNDER = r"(if [ !#-9;-\[\]-~]+: )?"
_NOW = r"now: [ !#-:<-\[\]-~]+"
"""How a condition stands, which the picture decides."""
_PLAIN = r"[a-z]+|[0-9]+|\([A-Z]+-[0-9]+\)"
"""What is no name: plain words, numbers, a rule in brackets."""
MOST_CLAUSES = 8
_WORD = re.compile(r"[A-Za-z0-9_]+")
_NUMBER = re.compile(r"\d+")


def asked_pattern(world: World, digest: Digest, words: str, *, facts: bool = True) -> str:
    """Return a regular expression (Rust's syntax) for reasons that begin with readable clauses.

    `words` are those of the mission; of an order under a condition both cases are readable. With
    `facts`, those that decide may follow.
    """
    told, tracks = told_assets(world, digest), contacts(digest.tracks)
    frames = [*told_frames(world, digest), *world.zones]
    known = {*told, *frames, *(contact.id for contact in tracks)}
    said = [*map(exactly, (n for n in _names(link_names(world, words)) if n not in known))]
    assets = _either((*dict.fromkeys(map(_numbered, told)), *said))
    places = _either((*map(exactly, frames), *said))
    targets = _either((*(exactly(contact.id) for contact in tracks), *said))
    gates = _either((*map(exactly, _gates(world, frames)), *said))
    seen = (f"{exactly(track.id)} at ({exactly(track.gate)}|{NOWHERE})" for track in tracks)
    guards = (*_guards(told, digest, gates), *(f"{name} at {gates}" for name in said))
    clause = clause_pattern(
        Names(
            asset=assets,
            place=places,
            gate=gates,
            team=_teams(digest, said),
            track=_either((*seen, *(f"{name} at {gates}" for name in said))),
            guard=_either(guards),
        )
    )
    follows = rf"((; |, else: )({clause}|nothing)){{0,{MOST_CLAUSES - 1}}}"
    asked = rf"asked: {_UNDER}{clause}{follows}(; {_NOW})?(; others stay)?"
    return rf"{asked}(; {_facts(assets, places, targets)})?" if facts else asked


def _gates(world: World, frames: Iterable[str]) -> list[str]:
    return [name for name in frames if name in world.frames and world.frames[name].kind == "gate"]


def _guards(told: Iterable[str], digest: Digest, gates: str) -> Iterator[str]:
    """Yield who can be relieved: where it is or stood, at any gate where that is not told."""
    for name in told:
        at = stands_at(digest, name) if name in digest.posts else digest.stood.get(name, "")
        yield f"{exactly(name)} at {exactly(at) if at else gates}"


def _teams(digest: Digest, said: Iterable[str]) -> str:
    """Return the expression for so many of a kind, or of any, from where somebody is.

    That none of the kind is there must be sayable.
    """
    there = (exactly(frame) for frame, names in standing(digest).items() if names)
    kinds = "|".join(WORDS.values())
    return rf"(all|any|([0-9]+|all) ({kinds})s?)( from {_either((*there, *said))})?"


def _facts(assets: str, places: str, targets: str) -> str:
    """Return the expression for the facts that decide: each is about a name, or in plain words.

    What is told of a place comes after a colon; it is assets that do something.
    """
    word = f"({_PLAIN}|{assets}|{places}|{targets})"
    about = f"((At )?{places}|{assets}|Free( [a-z]+)?): {word}"
    fact = f"({about}|{assets}|{targets}|{_PLAIN})( {word})*"
    return f"{fact}(, {fact})*"


def _names(text: str) -> Iterable[str]:
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
