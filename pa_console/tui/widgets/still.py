"""A camera still of a track in half blocks, two pixels a cell, with its caption.

Every terminal shows half blocks; they can be copied with the screen and scroll with it. Kitty or
Sixel graphics would need a query to the terminal before the console starts, and the answer would
arrive among the operator's keys.
"""

from collections.abc import Callable, Iterator
from io import BytesIO
from itertools import groupby

from textual.content import Content
from textual.widget import Widget

from pa_console.schema.events.event import CameraStill
from pa_console.tui.status_words import QUIET

ReadStill = Callable[[CameraStill], bytes | None]
"""A function that returns the stored file of a still; None if it is missing or has changed."""

BESIDE = 40
"""The minimum width of a still with its caption beside it and not below it, in cells."""
STILL_ROWS = 7
"""The height of a still with its caption beside it, in lines."""
_CAPTION, _MOST_PIXELS = 16, 4_000_000


def half_blocks(content: bytes, columns: int, rows: int) -> list[Content]:
    """Return an image as lines within `columns` and `rows`; none if it cannot be read."""
    try:
        from PIL import Image  # noqa: PLC0415 - only where a still is shown

        with Image.open(BytesIO(content), formats=("JPEG", "PNG")) as image:
            if image.width * image.height > _MOST_PIXELS:
                return []
            scale = min(columns / image.width, 2 * rows / image.height)
            width = max(round(image.width * scale), 1)
            height = max(round(image.height * scale / 2), 1)
            small = image.convert("RGB").resize((width, 2 * height), Image.Resampling.BOX)
    except (ImportError, OSError, ValueError, SyntaxError):
        return []
    raw, across = small.tobytes(), 3 * width
    return [
        Content.assemble(*_cells(raw[y * across :][:across], raw[(y + 1) * across :][:across]))
        for y in range(0, 2 * height, 2)
    ]


def _cells(upper: bytes, lower: bytes) -> Iterator[tuple[str, str]]:
    """Yield the cells of two rows of pixels; equal neighbours are joined."""
    pairs = (
        f"#{upper[i : i + 3].hex()} on #{lower[i : i + 3].hex()}" for i in range(0, len(upper), 3)
    )
    for style, cells in groupby(pairs):
        yield "▀" * sum(1 for _ in cells), style


class StillView(Widget):
    """A still and its age; without an image, the widget takes no room."""

    DEFAULT_CSS = f"""
    StillView {{ width: 100%; height: {STILL_ROWS}; }}
    StillView.-empty {{ display: none; }}
    """

    def __init__(self, read: ReadStill) -> None:
        super().__init__(classes="-empty")
        self._read = read
        self._still: CameraStill | None = None
        self._content = b""
        self._now_s: float | None = None
        self._drawn: tuple[tuple[int, int], list[Content]] | None = None

    @property
    def has_room(self) -> bool:
        """True if there is an image, which takes room."""
        return not self.has_class("-empty")

    def show(self, still: CameraStill | None) -> bool:
        """Show another still, or no still if it is None.

        Returns True if the image has appeared or disappeared, so that the layout must change.
        """
        if still != self._still:
            self._still, self._drawn = still, None
            self._content = (self._read(still) if still is not None else None) or b""
            self.refresh()
        before = self.has_room
        self.set_class(not (self._content and half_blocks(self._content, 1, 1)), "-empty")
        return self.has_room != before

    def tell_age(self, now_s: float) -> None:
        """Show the age of the still at a moment of the session's clock."""
        before, self._now_s = self._age, now_s
        if self._age != before:
            self.refresh()

    @property
    def _age(self) -> str:
        if self._still is None or self._now_s is None:
            return ""
        return f"{max(self._now_s - self._still.taken_s, 0.0):.0f} s ago"

    def render(self) -> Content:
        """Return the image and its caption, which is beside the image if there is room."""
        still, (width, height) = self._still, self.content_size
        if still is None or width < 1 or height < 3:
            return Content()
        beside = width >= BESIDE
        room = (width - _CAPTION, height) if beside else (width, height - 2)
        if self._drawn is None or self._drawn[0] != room:
            self._drawn = room, half_blocks(self._content, *room)
        lines = self._drawn[1]
        if not beside:
            caption = f"{still.track}, {self._age}".removesuffix(", ")
            return Content("\n").join([*lines, _quiet(caption, width), _quiet(still.camera, width)])
        captions = [_quiet(text, _CAPTION - 1) for text in (still.track, still.camera, self._age)]
        captions += [Content()] * (len(lines) - len(captions))
        rows = zip(lines, captions, strict=False)
        return Content("\n").join(Content.assemble(line, " ", text) for line, text in rows)


def _quiet(text: str, width: int) -> Content:
    return Content.styled(text, QUIET).truncate(width, ellipsis=True)
