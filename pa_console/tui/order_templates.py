"""Order templates with slots, like `Send {asset} to {place}.`, and the names that fill them."""

import re
from collections.abc import Iterable, Iterator
from itertools import cycle
from typing import NamedTuple

from pa_console.language.name_linking import WORD
from pa_console.schema.command import COMMANDS, Verb
from pa_console.schema.world import KINDS, PLAIN_KINDS, AssetKind, World

_SLOT = re.compile(r"\{([a-z]+)\}")

LEAST_TYPED = 2
"""The minimum number of letters that are completed to a name; fewer match too many words."""

MOST_EXAMPLES = 4

_LAST_WORD = re.compile(r"\w+$")
_LAST_TWO_WORDS = re.compile(r"\w+ \w+$")


class Slot(NamedTuple):
    """A slot of a text: its start, its end and its kind; the braces are part of it."""

    start: int
    end: int
    kind: str


def slots(text: str) -> list[Slot]:
    """Return the open slots of a text, in order."""
    return [Slot(match.start(), match.end(), match[1]) for match in _SLOT.finditer(text)]


def next_slot(text: str, after: int) -> Slot | None:
    """Return the first open slot at or after position `after`, or else the first in the text."""
    open_slots = slots(text)
    return next(
        (slot for slot in open_slots if slot.start >= after), open_slots[0] if open_slots else None
    )


class OrderForm(NamedTuple):
    """The wording of an order to an asset, with the slot `{asset}`, and its name in a menu."""

    verb: Verb
    name: str
    text: str


FORMS: tuple[OrderForm, ...] = (
    OrderForm("move_to", "Send to …", "Send {asset} to {place}."),
    OrderForm("observe", "Look at …", "Send {asset} to look at {gate}."),
    OrderForm("identify", "Identify who is at …", "Let {asset} identify the vehicle at {gate}."),
    OrderForm("warn", "Warn who is at …", "Let {asset} warn the vehicle at {gate}."),
    OrderForm("block", "Block …", "Let {asset} block {gate}."),
    OrderForm("hold", "Hold", "Let {asset} hold its position."),
    OrderForm("return_to_base", "Home", "Send {asset} home."),
    OrderForm("report", "Report", "Let {asset} report."),
)
"""One form for each command of a device; the movements come first."""


def forms_for(kind: AssetKind) -> Iterator[OrderForm]:
    """Yield the forms of the commands that an asset of a kind can carry out."""
    return (form for form in FORMS if kind in COMMANDS[form.verb].kinds)


def templates(world: World) -> list[str]:
    """Return a template for each command that some asset of the world can carry out.

    If only some kinds of assets can carry out a command, its asset slot names a kind.
    """
    kinds: set[AssetKind] = {spec.kind for spec in world.assets.values()}
    texts: list[str] = []
    for form in FORMS:
        able = kinds & COMMANDS[form.verb].kinds
        if able:
            slot = "asset" if able == kinds else PLAIN_KINDS[min(able, key=KINDS.index)]
            texts.append(form.text.replace("{asset}", f"{{{slot}}}"))
    return texts


class Completion(NamedTuple):
    """The names that complete `typed`, the end of a text; the likeliest name is first."""

    typed: str
    names: tuple[str, ...]

    @property
    def rest(self) -> str:
        """The letters of the first name that are still missing."""
        return self.names[0][len(self.typed) :]


class OrderNames:
    """The names of tracks, frames and assets; the tracks change during a session."""

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
        """Use these tracks instead of the previous ones."""
        self._tracks = tuple(tracks)

    def fits(self, name: str, slot: str) -> bool:
        """Return whether `name` fits a slot of a template, like `asset`, `drone` or `gate`."""
        own = frozenset(("track",)) if name in self._tracks else self._slots.get(name, frozenset())
        return slot in own

    def for_slot(self, slot: str) -> tuple[str, ...]:
        """Return every name that fits a slot."""
        return tuple(name for name in (*self._tracks, *self._fixed) if self.fits(name, slot))

    def completion(self, before: str) -> Completion | None:
        """Return the completions of the end of `before`: names, or places as they are spoken.

        A word that is already a name has no completion.
        """
        word = _LAST_WORD.search(before)
        if word is None:
            return None
        typed, low = word[0], word[0].lower()
        names = (*self._tracks, *self._fixed)
        if any(name.lower() == low for name in names):
            return None
        if len(typed) >= LEAST_TYPED:
            matches = tuple(name for name in names if name.lower().startswith(low))
            if matches:
                return Completion(typed, matches)
        two = _LAST_TWO_WORDS.search(before)
        if two is not None:
            typed, low = two[0], two[0].lower()
            longer = (name for name in self._spoken if name.startswith(low) and name != low)
            if matches := tuple(typed + name[len(typed) :] for name in longer):
                return Completion(typed, matches)
        return None


def example_orders(world: World) -> tuple[str, ...]:
    """Return up to four example orders, each with a different gate if there are enough gates.

    The examples prefer spare assets, whose post is not a gate.
    """
    gates = cycle(world.gates)
    orders: list[str] = []
    if drone := _spare(world, ("uav",)):
        orders.append(f"Send {drone} to look at {next(gates)}.")
    if walker := _spare(world, ("ugv", "robot")):
        orders.append(f"Send {walker} to {next(gates)}.")
    orders.append(f"Report on {next(gates)}.")
    if robot := _spare(world, ("robot", "ugv", "uav")):
        orders.append(f"Send {robot} home.")
    return tuple(orders[:MOST_EXAMPLES])


def _spare(world: World, kinds: tuple[AssetKind, ...]) -> str:
    """Return an asset of the first of `kinds` in the world, if possible a spare one; else ''."""
    return next(_by_choice(world, kinds), "")


def _by_choice(world: World, kinds: tuple[AssetKind, ...]) -> Iterator[str]:
    for kind in kinds:
        own = [name for name, spec in world.assets.items() if spec.kind == kind]
        yield from (name for name in own if world.assets[name].post not in world.gates)
        yield from own
