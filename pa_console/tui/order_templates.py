"""Orders with slots, like `Send {asset} to {place}.`, and the names that complete or fill them."""

import re
from collections.abc import Iterable, Iterator
from itertools import cycle
from typing import NamedTuple

from pa_console.language.name_linking import WORD
from pa_console.schema.command import COMMANDS, Verb
from pa_console.schema.world import KINDS, PLAIN_KINDS, AssetKind, World

_SLOT = re.compile(r"\{([a-z]+)\}")

LEAST_TYPED = 2
"""The number of letters that begin a name; fewer begin too many other words."""

MOST_EXAMPLES = 4

_LAST_WORD = re.compile(r"\w+$")
_LAST_TWO_WORDS = re.compile(r"\w+ \w+$")


class Slot(NamedTuple):
    """The place of a slot in a text, its braces included, and its kind."""

    start: int
    end: int
    kind: str


def slots(text: str) -> list[Slot]:
    """Return the slots of a text that are still open, in order."""
    return [Slot(found.start(), found.end(), found[1]) for found in _SLOT.finditer(text)]


def next_slot(text: str, after: int) -> Slot | None:
    """Return the first open slot that begins at `after` or behind it, else the first of all."""
    found = slots(text)
    return next((slot for slot in found if slot.start >= after), found[0] if found else None)


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
"""One form for each command that a device has, the movements first."""


def forms_for(kind: AssetKind) -> Iterator[OrderForm]:
    """Yield the forms of what an asset of a kind can do."""
    return (form for form in FORMS if kind in COMMANDS[form.verb].kinds)


def templates(world: World) -> list[str]:
    """Return a template for each command that some asset of the world can carry out.

    A slot for the asset names its kind if not every kind can carry the command out.
    """
    kinds: set[AssetKind] = {spec.kind for spec in world.assets.values()}
    found: list[str] = []
    for form in FORMS:
        able = kinds & COMMANDS[form.verb].kinds
        if able:
            slot = "asset" if able == kinds else PLAIN_KINDS[min(able, key=KINDS.index)]
            found.append(form.text.replace("{asset}", f"{{{slot}}}"))
    return found


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


def example_orders(world: World) -> tuple[str, ...]:
    """Return up to four orders, each with another gate as long as there are others.

    The assets in them are spare ones where there are any: no gate is their post.
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
    """Return an asset of the first kind that there is; empty without any."""
    return next(_by_choice(world, kinds), "")


def _by_choice(world: World, kinds: tuple[AssetKind, ...]) -> Iterator[str]:
    for kind in kinds:
        own = [name for name, spec in world.assets.items() if spec.kind == kind]
        yield from (name for name in own if world.assets[name].post not in world.gates)
        yield from own
