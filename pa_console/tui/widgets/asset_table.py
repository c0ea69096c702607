"""All tracks, assets and cameras, a row each: problems first, and only what a filter lets in."""

from bisect import bisect_right
from typing import Literal, NamedTuple

from textual.content import Content

from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_console.tui.condition import FINE, Reliance, track_rank
from pa_console.tui.vocabulary import QUIET, WARN
from pa_console.tui.widgets import asset_rows as cells
from pa_console.tui.widgets.virtual_rows import VirtualRows
from pa_console.tui.words import short_names


class _Item(NamedTuple):
    """A row: a heading has the title of its group as name, a note its text."""

    kind: Literal["heading", "track", "asset", "camera", "note"]
    name: str


class Count(NamedTuple):
    """How many rows there are, how many are shown, and how many of all need an eye."""

    total: int = 0
    shown: int = 0
    problems: int = 0


class AssetTable(VirtualRows):
    """Status, place and age of the last report of everything; only rows in view are laid out."""

    def __init__(self, world: World, **kwargs: str) -> None:
        super().__init__(**kwargs)
        self._short = short_names(world.assets)
        self._stale_s = world.stale_s
        self._picture: Picture | None = None
        self._look: Reliance | None = None
        self._items: list[_Item] = []
        self._headings: list[int] = []
        self._wanted: tuple[str, ...] = ()
        self.count = Count()

    def show(self, picture: Picture | None) -> None:
        """Show another picture; filter and cursor stay."""
        self._picture = picture
        if picture is None:
            self._items = [_Item("note", "no telemetry yet: unknown")]
        else:
            self._look = Reliance(picture, self._stale_s)
            self._items = self._arranged(picture, self._look)
        self._headings = [i for i, item in enumerate(self._items) if item.kind == "heading"]
        plain = ("heading", "note")
        self.set_keys(["" if item.kind in plain else item.name for item in self._items])

    def filter(self, text: str) -> None:
        """Show only rows that have every word of `text` in what is known of them."""
        self._wanted = tuple(text.lower().split())
        self.show(self._picture)

    def _arranged(self, picture: Picture, look: Reliance) -> list[_Item]:
        """Return the rows in order: what is most urgent first, equal ones as they were told."""
        tracks = sorted(picture.tracks.values(), key=lambda t: (*track_rank(t), t.id))
        ranks = {name: look.rank(asset) for name, asset in picture.assets.items()}
        assets = sorted(picture.assets.values(), key=lambda a: ranks[a.id])
        cameras = sorted(picture.cameras.items(), key=lambda c: look.camera(c[1]) == "works")
        if self._wanted:
            tracks = [t for t in tracks if self._lets_in(cells.track_words(t, look))]
            assets = [a for a in assets if self._lets_in(cells.asset_words(a, self._short, look))]
            cameras = [c for c in cameras if self._lets_in(cells.camera_words(*c, look))]
        items: list[_Item] = []
        if tracks:
            items += [_Item("heading", "tracks"), *(_Item("track", t.id) for t in tracks)]
        if assets:
            items += [_Item("heading", "assets"), *(_Item("asset", a.id) for a in assets)]
        if cameras:
            items += [_Item("heading", "cameras"), *(_Item("camera", name) for name, _ in cameras)]
        down = sum(look.camera(camera) != "works" for camera in picture.cameras.values())
        suspicious = sum(track_rank(track)[0] < 4 for track in picture.tracks.values())
        self.count = Count(
            total=len(picture.tracks) + len(picture.assets) + len(picture.cameras),
            shown=len(tracks) + len(assets) + len(cameras),
            problems=sum(rank < FINE for rank in ranks.values()) + down + suspicious,
        )
        return items or [_Item("note", "nothing passes the filter")]

    def _lets_in(self, words: str) -> bool:
        return all(word in words for word in self._wanted)

    def row(self, index: int, width: int) -> Content:
        """Return a heading or the row of a track, an asset or a camera."""
        kind, name = self._items[index]
        picture, look = self._picture, self._look
        if kind == "heading":
            layouts = {"tracks": cells.tracks(width), "assets": cells.ASSETS}
            return layouts.get(name, cells.CAMERAS).heading(width)
        if picture is None or look is None or kind == "note":
            return Content.styled(name, WARN if picture is None else QUIET)
        if kind == "track":
            return cells.tracks(width).line(cells.track_cells(picture.tracks[name], look), width)
        if kind == "camera":
            given = picture.cameras[name]
            return cells.CAMERAS.line(cells.camera_cells(name, given, look), width)
        asset = picture.assets[name]
        return cells.ASSETS.line(cells.asset_cells(asset, self._short, look), width)

    def sticky(self, first: int, width: int) -> Content | None:
        """Return the heading of the group that is scrolled through."""
        at = bisect_right(self._headings, first) - 1
        return self.row(self._headings[at], width) if at >= 0 else None
