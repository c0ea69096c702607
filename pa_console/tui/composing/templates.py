"""Orders with slots: `Send {asset} to {place}.` is one, and every name fits into some slot."""

import re
from collections.abc import Iterator
from typing import NamedTuple

from pa_console.schema.command import COMMANDS, Verb
from pa_console.schema.world import KINDS, PLAIN_KINDS, AssetKind, World

_SLOT = re.compile(r"\{([a-z]+)\}")


class Slot(NamedTuple):
    """The place of a slot in a text, its braces included, and its kind."""

    start: int
    end: int
    kind: str

    def filled(self, text: str, name: str) -> str:
        """Return `text` with `name` in this slot."""
        return text[: self.start] + name + text[self.end :]


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

    A slot for the asset says of which kind it has to be, where not every kind can.
    """
    kinds: set[AssetKind] = {spec.kind for spec in world.assets.values()}
    found: list[str] = []
    for form in FORMS:
        able = kinds & COMMANDS[form.verb].kinds
        if able:
            slot = "asset" if able == kinds else PLAIN_KINDS[min(able, key=KINDS.index)]
            found.append(form.text.replace("{asset}", f"{{{slot}}}"))
    return found
