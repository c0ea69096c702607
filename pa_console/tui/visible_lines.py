"""The last gate before the terminal: no line of the screen holds what the terminal would obey."""

from rich.segment import Segment
from textual.color import Color
from textual.filter import LineFilter

from pa_console.schema.text import visible_line


class VisibleLines(LineFilter):
    """Shows characters that would be obeyed or not be seen as escapes; a line stays as wide."""

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:
        """Return the line as it may be shown: what no longer fits is cut off at its end."""
        del background
        shown = [Segment(visible_line(text), style) for text, style, _ in segments]
        if all(new.text == old.text for new, old in zip(shown, segments, strict=True)):
            return segments
        return Segment.adjust_line_length(shown, Segment.get_line_length(segments))
