"""Readable files of the prompts of named missions, and fingerprints of every text by its kind."""

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from hashlib import sha256
from itertools import takewhile
from typing import Any

Texts = Mapping[str, str]
"""The texts of one mission by name."""

NAMED = {
    "P02": "a_drone_to_a_gate",
    "P04": "an_unknown_vehicle_and_a_lost_camera",
    "F008": "a_condition_in_chatter",
    "G05": "two_assets_home_in_another_world",
}
"""The missions whose prompts are kept whole, one of each kind, and the names of their files."""
LONGEST_GRAMMAR = 2000
"""Longer grammars list every name of a world and are pinned by fingerprints alone."""
SHARED = 4
"""Texts that begin with as many equal lines are written as an addition to the earlier one."""
DIGITS = 20
"""Digits of a SHA-256 in a fingerprint: enough that two texts never share one."""
_NUMBER = re.compile(r" \d+\b")


def readable(missions: Mapping[str, Texts]) -> dict[str, str]:
    """Return the file of each named mission; a text that an earlier one holds is not repeated."""
    seen: dict[str, str] = {}
    return {NAMED[mission]: "".join(_parts(mission, missions[mission], seen)) for mission in NAMED}


def _parts(mission: str, texts: Texts, seen: dict[str, str]) -> Iterator[str]:
    """Yield each text under its name; `seen` maps the texts so far to their names."""
    for name, text in texts.items():
        whole = f"{mission} {name}"
        if text in seen:
            yield f"==== {name} = {seen[text]}\n"
        elif _is_long_grammar(name, text):
            seen[text] = whole
            yield f"==== {name}: a grammar of {len(text)} characters\n"
        else:
            base, shared = _nearest(text, seen)
            begins = f": {shared} lines of {base}, then" if shared >= SHARED else ""
            rest = text.split("\n")[shared if begins else 0 :]
            seen[text] = whole
            yield "\n".join([f"==== {name}{begins}", *rest, ""])


def _is_long_grammar(name: str, text: str) -> bool:
    return ("grammar" in name or name.startswith("clauses")) and len(text) > LONGEST_GRAMMAR


def _nearest(text: str, seen: Mapping[str, str]) -> tuple[str, int]:
    """Return the name of the earlier text with the most first lines in common, and their number."""
    lines = text.split("\n")
    best, most = "", 0
    for other, name in seen.items():
        pairs = zip(lines, other.split("\n"), strict=False)
        shared = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))
        if shared > most:
            best, most = name, shared
    return best, most


def fingerprints(missions: Mapping[str, Texts]) -> dict[str, str]:
    """Return one fingerprint for each kind of text: of all its texts in all missions, in order.

    A kind is a name without numbers, such as `station compact planner user`.
    """
    hashes: defaultdict[str, Any] = defaultdict(sha256)
    for mission, texts in missions.items():
        for name, text in texts.items():
            hashes[_NUMBER.sub("", name)].update(f"{mission}\0{name}\0{text}\0".encode())
    return {kind: found.hexdigest()[:DIGITS] for kind, found in hashes.items()}
