"""Closed lists of the words that descriptions are made of, and the names that stand among them."""

from collections.abc import Mapping

from pa_console.language.references.reader import Reader
from pa_console.language.references.scene import Scene
from pa_console.language.world_names import NUMBERS

DEFINITE = frozenset(("the", "our", "my", "your", "those", "these", "this", "that"))
INDEFINITE = frozenset(("a", "an", "any", "some", "another", "one", "no"))
FREE_CHOICE = frozenset(("whichever", "whatever", "which"))
EVERY = frozenset(("all", "every", "each"))
ANYBODY = frozenset(("whoever", "whomever", "whatever"))
EVERYBODY = frozenset(("everyone", "everybody", "everything"))
NEAR = frozenset(("nearest", "closest", "nearer", "closer"))
FAR = frozenset(("farthest", "furthest", "remotest", "farther", "further"))
MOST = frozenset(("fullest", "most", "best", "highest", "more", "higher", "better", "strongest"))
LEAST = frozenset(
    ("least", "lowest", "emptiest", "flattest", "weakest", "worst", "less", "lower", "poorest")
)
CHARGE = frozenset(("battery", "batteries", "charge", "power", "juice", "cells", "energy"))
BARE = frozenset(
    ("unguarded", "uncovered", "empty", "unmanned", "bare", "deserted", "undefended", "unprotected")
)
GUARDS = frozenset(("guard", "guards", "sentry", "cover", "asset", "assets", "unit", "units"))
GUARDING = frozenset(
    word
    for stem in ("guard", "cover", "watch", "protect", "hold", "mann")
    for word in (stem, f"{stem}s", f"{stem}ing", f"{stem}es")
)
GUARDED = frozenset(("guarded", "covered", "watched", "held", "protected", "manned"))
COPULA = frozenset(
    ("is", "are", "'s", "'re", "was", "stands", "stand", "standing", "sits", "sitting", "waits")
)
SAYING = COPULA - {"standing", "sitting"} | {"hovers", "stays"}
"""The beginnings of a statement without *that* or *who* before it."""
STANDING = COPULA | {
    *("waiting", "hovers", "hovering", "parked", "posted", "stationed", "hanging", "stays"),
    *("around", "right", "now", "currently", "still", "up", "about", "just", "idling", "parking"),
}
IN = frozenset(("at", "in", "over", "on", "by", "near", "above", "around", "from", "beside"))
IDLE = frozenset(("free", "idle", "spare", "available", "unused", "unoccupied", "jobless"))
FAILED = frozenset(("dead", "failed", "broken", "down", "defunct", "defective"))
SILENT = frozenset(("silent", "quiet", "mute"))
BUT = ("but", "except for", "except", "apart from", "other than", "save")
SENT = frozenset(("sent", "moved", "dispatched", "ordered", "send"))
AFTER_ONE = frozenset(
    (*STANDING, *NEAR, *FAR, *IN, "with", "without", "that", "which", "who", "i", "we", "you")
)
"""The words after *the one* if it stands for a noun."""
CONTACTS: Mapping[str, str] = {
    **dict.fromkeys(("car", "truck", "van", "lorry", "vehicle", "jeep", "pickup"), "vehicle"),
    **dict.fromkeys(("person", "man", "woman", "stranger", "pedestrian", "walker"), "person"),
    **dict.fromkeys(("visitor", "contact", "intruder", "track"), ""),
}
"""The words for contacts, and their sort of track; '' for either."""
COMING = frozenset(
    (
        *("is", "'s", "has", "walking", "heading", "driving", "coming", "going", "approaching"),
        *("rolling", "up", "to", "towards", "toward", "for", "at", "stopped", "standing", "waits"),
        *("stands", "walks", "drives", "approaches", "headed", "parked", "stops"),
    )
)


def place_at(scene: Scene, reader: Reader) -> str:
    """Read the name of a frame, or the word for the base; '' where neither is here."""
    start = reader.at
    reader.take("the", "our")
    word = reader.word()
    found = scene.frames_said.get(word, "")
    if not found and word in ("base", "home"):
        found = scene.world.base
    if not found and word not in ("", "gate"):
        found = scene.names.gate_with(word) or ""
        if found and reader.word(1) in ("side", "end", "corner"):
            found = ""
    if not found:
        reader.at = start
        return ""
    reader.at += 1
    if found in scene.gates:
        reader.take("gate")
    return found


def asset_at(scene: Scene, reader: Reader) -> str:
    """Read the name of an asset; '' where none is here."""
    found = scene.assets_said.get(reader.said().lower(), "")
    if found:
        reader.at += 1
    return found


def number_of(word: str) -> int:
    """Return the number that a word is; -1 for none."""
    if word.isdigit():
        return int(word)
    return NUMBERS.index(word) if word in NUMBERS else -1
