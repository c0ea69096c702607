"""The operator's favourite orders and templates, in a file beside the settings."""

from pathlib import Path

import yaml
from pydantic import Field

from pa_console.schema.base import StrictModel
from pa_console.schema.document import Document, DocumentError, read_text
from pa_console.schema.mission import MAX_MISSION_TEXT
from pa_console.settings.file import changed_text, write_atomically
from pa_console.settings.sources import settings_file

HEAD = "# Favourite orders of PA Console; what stands in braces, like {gate}, is a slot.\n"
MOST_KEPT = 200


class _Kept(StrictModel):
    """The content of the file."""

    orders: tuple[str, ...] = Field(default=(), max_length=MOST_KEPT)


def favourites_file() -> Path:
    """Return the user's file, in the folder of the settings."""
    return settings_file().with_name("favourites.yaml")


class Favourites:
    """Orders in the sequence in which they were kept; what else stands in the file stays there."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def orders(self) -> tuple[str, ...]:
        """Return the orders as the file has them now.

        Raises DocumentError, which names file and line, for a file that cannot be used.
        """
        if not self.file.exists():
            return ()
        document = Document.read(self.file)
        if document.value is None:
            return ()
        if isinstance(document.value, dict) and document.value.get("orders", ()) is None:
            return ()
        kept = document.parse(_Kept).orders
        for number, order in enumerate(kept):
            if not order.strip() or len(order) > MAX_MISSION_TEXT:
                problem = f"expected an order of 1 to {MAX_MISSION_TEXT} characters"
                raise document.error(("orders", number), problem)
        return kept

    def keep(self, order: str) -> bool:
        """Add an order; returns whether it is new.

        Raises DocumentError for a file that cannot be used, OSError for one that cannot be
        written, ValueError when there are too many. The file then is as it was.
        """
        kept = self.orders()
        if order in kept:
            return False
        if len(kept) >= MOST_KEPT:
            raise ValueError(f"{MOST_KEPT} favourites are kept; remove one first")
        self._write((*kept, order))
        return True

    def remove(self, order: str) -> None:
        """Take an order out; raises what `keep` raises."""
        self._write(tuple(kept for kept in self.orders() if kept != order))

    def _write(self, orders: tuple[str, ...]) -> None:
        path = self.file.resolve()  # a link to the file stays one
        text = read_text(path) if path.exists() else HEAD
        changed = changed_text(str(path), text, "orders", list(orders))
        if tuple(yaml.safe_load(changed)["orders"]) != orders:
            raise DocumentError(str(path), 0, "orders", "could not be written as they are")
        write_atomically(path, changed)
