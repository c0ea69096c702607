"""Which clauses can stand for what was asked in a world: those that name what is there or was said.

Assets, frames, zones and tracks go by the names that the picture has for them. A name that stands
in the mission's own words is let through, and so is another number of a team: that something is not
there must be sayable.
"""

import re
from collections.abc import Iterable

from pa_console.llm.condition import told_assets, told_frames
from pa_console.llm.contact import contacts
from pa_console.llm.grammar import exactly
from pa_console.llm.linking import link_names
from pa_console.llm.reading import clause_pattern
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


def asked_pattern(world: World, digest: Digest, words: str) -> str:
    """Return a regular expression (Rust's syntax) for reasons that begin with readable clauses.

    `words` are those of the mission; of an order under a condition both cases are readable.
    """
    tracks = [contact.id for contact in contacts(digest.tracks)]
    frames = [*told_frames(world, digest), *world.zones]
    known = {*told_assets(world, digest), *frames, *tracks}
    said = [name for name in _names(link_names(world, words)) if name not in known]
    numbered = dict.fromkeys(map(_numbered, told_assets(world, digest)))
    assets = _either((*numbered, *map(exactly, said)))
    places = _either(map(exactly, (*frames, *said)))
    targets = _either(map(exactly, (*tracks, *said)))
    clause = clause_pattern(assets, places, targets)
    follows = rf"((; |, else: )({clause}|nothing)){{0,{MOST_CLAUSES - 1}}}"
    asked = rf"asked: {_UNDER}{clause}{follows}(; {_NOW})?(; others stay)?"
    return rf"{asked}(; {_facts(assets, places, targets)})?"


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
