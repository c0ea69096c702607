"""Rows laid out at whatever width there is, as text that can be selected with the mouse."""

from textual.content import Content
from textual.geometry import Size
from textual.widget import Widget

from pa_console.tui.trace.rows import Row, layout


class Sheet(Widget):
    """Shows rows with hanging indents; nothing in them is read as markup."""

    DEFAULT_CSS = "Sheet { height: auto; width: 1fr; }"

    def __init__(self, rows: tuple[Row, ...] = (), **kwargs: str | None) -> None:
        super().__init__(id=kwargs.get("id"), classes=kwargs.get("classes"))
        self._rows = rows
        self._laid_out: tuple[int, Content] | None = None

    def show(self, rows: tuple[Row, ...]) -> None:
        """Show other rows; the same rows again cost nothing."""
        if rows != self._rows:
            self._rows, self._laid_out = rows, None
            self.refresh(layout=True)

    def _at(self, width: int) -> Content:
        if self._laid_out is None or self._laid_out[0] != width:
            self._laid_out = width, Content("\n").join(layout(self._rows, width))
        return self._laid_out[1]

    def get_content_height(self, container: Size, viewport: Size, width: int) -> int:  # noqa: ARG002
        """Return the number of lines at `width` cells."""
        return self._at(width).plain.count("\n") + 1 if self._rows else 0

    def get_content_width(self, container: Size, viewport: Size) -> int:  # noqa: ARG002
        """Return all the width there is."""
        return container.width

    def render(self) -> Content:
        """Return the laid out rows."""
        return self._at(self.content_size.width)
