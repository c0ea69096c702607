"""Completion of names in an order, and the slots of a template that a name fits."""

import re
from collections.abc import Iterable
from typing import NamedTuple

from pa_console.language.name_linking import WORD
from pa_console.schema.world import PLAIN_KINDS, World

LEAST_TYPED = 2
"""The number of letters that begin a name; fewer begin too many other words."""

_LAST_WORD = re.compile(r"\w+$")
_LAST_TWO_WORDS = re.compile(r"\w+ \w+$")


class Completion(NamedTuple):
    """The completions of the `typed` end of a text, the likeliest first."""

    typed: str
    names: tuple[str, ...]

    @property
    def rest(self) -> str:
        """The missing rest of the first."""
        return self.names[0][len(self.typed) :]


class OrderNames:
    """Names of tracks, frames and assets; the tracks come and go."""

    def __init__(self, world: World) -> None:
        assets = {name: PLAIN_KINDS[spec.kind] for name, spec in world.assets.items()}
        self._slots: dict[str, frozenset[str]] = {
            **{
                name: frozenset(("place", "gate") if frame.kind == "gate" else ("place",))
                for name, frame in world.frames.items()
            },
            **{name: frozenset(("asset", kind)) for name, kind in assets.items()},
        }
        self._fixed = tuple(self._slots)
        spoken = (" ".join(WORD.findall(name)).lower() for name in world.frames)
        self._spoken = tuple(name for name in spoken if " " in name)
        self._tracks: tuple[str, ...] = ()

    def use_tracks(self, tracks: Iterable[str]) -> None:
        """Take the tracks that there are now."""
        self._tracks = tuple(tracks)

    def fits(self, name: str, slot: str) -> bool:
        """Return whether `name` fits a slot of a template, like `asset`, `drone` or `gate`."""
        own = frozenset(("track",)) if name in self._tracks else self._slots.get(name, frozenset())
        return slot in own

    def for_slot(self, slot: str) -> tuple[str, ...]:
        """Return every name that can stand in a slot."""
        return tuple(name for name in (*self._tracks, *self._fixed) if self.fits(name, slot))

    def completion(self, before: str) -> Completion | None:
        """Return what the end of `before` may become: a name, or a place as it is spoken.

        A word that is a name already becomes no longer one.
        """
        word = _LAST_WORD.search(before)
        if word is None:
            return None
        typed, low = word[0], word[0].lower()
        names = (*self._tracks, *self._fixed)
        if any(name.lower() == low for name in names):
            return None
        if len(typed) >= LEAST_TYPED:
            found = tuple(name for name in names if name.lower().startswith(low))
            if found:
                return Completion(typed, found)
        two = _LAST_TWO_WORDS.search(before)
        if two is not None:
            typed, low = two[0], two[0].lower()
            longer = (name for name in self._spoken if name.startswith(low) and name != low)
            if found := tuple(typed + name[len(typed) :] for name in longer):
                return Completion(typed, found)
        return None
