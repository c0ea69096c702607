"""A Rich console that prints text of others as it is: no markup, nothing a terminal obeys."""

from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.status import Status
from rich.text import Text

from pa_console.schema.text import visible


class PlainConsole(Console):
    """A console that passes its own styles on, and shows all text in visible form."""

    def __init__(self, **options: Any) -> None:
        """`options` are Rich's own; markup, highlighting and emoji codes are off."""
        super().__init__(markup=False, highlight=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """Return `text` as it is shown, before it is measured, wrapped and put into columns."""
        return super().render_str(visible(text), **options)

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Yield the segments of anything; the last gate, for what was a `Text` before."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(visible(segment.text), segment.style)

    def status(self, status: RenderableType, **options: Any) -> Status:
        """Return a spinner whose text, now and later, is no markup."""
        return _PlainStatus(_text(status), console=self, **options)


class _PlainStatus(Status):
    """A spinner that treats its label as plain text."""

    def update(self, status: RenderableType | None = None, **options: Any) -> None:
        """Show another text."""
        super().update(None if status is None else _text(status), **options)


def _text(status: RenderableType) -> RenderableType:
    return Text(visible(status)) if isinstance(status, str) else status
