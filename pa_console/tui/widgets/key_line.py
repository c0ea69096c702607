"""The line over the footer with the effect of a typed key, or why it has none."""

from textual.content import Content
from textual.widgets import Static


class KeyLine(Static):
    """Stands in the footer's place; the screen below does not move."""

    DEFAULT_CSS = """
    KeyLine {
        dock: bottom; width: 100%; height: 1; padding: 0 1;
        background: $warning; color: $background; text-wrap: nowrap; text-overflow: ellipsis;
    }
    """

    def __init__(self, key: str, text: str) -> None:
        """`key` is empty where the line is not about one key."""
        super().__init__(_content(key, text))

    def show(self, key: str, text: str) -> None:
        """Show another text."""
        self.update(_content(key, text), layout=False)


def _content(key: str, text: str) -> Content:
    return Content.assemble((f"{key}  " if key else "", "bold"), text)
