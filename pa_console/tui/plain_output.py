"""Text of others as it is: no markup, and nothing that a terminal obeys."""

from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.status import Status
from rich.text import Text
from textual.color import Color
from textual.filter import LineFilter

from pa_console.schema.visible_text import visible, visible_line


class VisibleLines(LineFilter):
    """Shows characters that would be obeyed or not be seen as escapes; a line stays as wide."""

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:
        """Return the line as it may be shown: what no longer fits is cut off at its end."""
        del background
        shown = [Segment(visible_line(text), style) for text, style, _ in segments]
        if all(new.text == old.text for new, old in zip(shown, segments, strict=True)):
            return segments
        return Segment.adjust_line_length(shown, Segment.get_line_length(segments))


class PlainConsole(Console):
    """What the program's own styles need is sent as it is; of all text, the visible form."""

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
    """A spinner that takes what it is given for plain text."""

    def update(self, status: RenderableType | None = None, **options: Any) -> None:
        """Show another text."""
        super().update(None if status is None else _text(status), **options)


def _text(status: RenderableType) -> RenderableType:
    return Text(visible(status)) if isinstance(status, str) else status
