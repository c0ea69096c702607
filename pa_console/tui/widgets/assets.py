"""The table of assets, tracks and cameras, problems first, and the line for a filter."""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Vertical
from textual.content import Content
from textual.widgets import Input

from pa_console.schema.telemetry import AssetTelemetry, CameraReport, Identity, Picture, Track
from pa_console.schema.text import few
from pa_console.schema.world import World
from pa_console.tui.map.markers import arrow
from pa_console.tui.refresh import retitle
from pa_console.tui.status_words import (
    BAD,
    FINE,
    KIND_WORDS,
    QUIET,
    WARN,
    Reliance,
    short_names,
    term,
    track_rank,
)
from pa_console.tui.widgets.fields import LineField
from pa_console.tui.widgets.row_views import NOTES, Cells, Layout, VirtualRows

ASSETS = Layout(
    "",
    (("", 5), ("asset", 10), ("status", 12), ("task", 11), ("at / to", 11), ("batt", 5),
     ("link", 6), ("age", 5)),
    ("asset", "link", "batt"),
)  # fmt: skip
_TRACKS = Layout(
    "track",
    (("track", 11), ("gate", 10), ("dist", 5), ("ident.", 9), ("intent", 9), ("age", 5)),
    ("gate",),
)
_WIDE_TRACKS = Layout(
    "track",
    (("track", 12), ("gate", 11), ("dist", 5), ("identity", 14), ("intent", 9), ("age", 5)),
    (),
)
_WIDE = 74
_BRIEFLY: dict[Identity, str] = {
    "unknown": "unknown", "authorized": "author.", "unauthorized": "UNAUTH.",
}  # fmt: skip
CAMERAS = Layout("camera", (("camera", 16), ("gate", 11), ("status", 10), ("age", 5)), ())

PROBLEMS = "problem"
"""The word with which a filter finds rows that need attention."""


def tracks(width: int) -> Layout:
    """Return the columns of tracks for `width` cells."""
    return _WIDE_TRACKS if width >= _WIDE else _TRACKS


def asset_cells(asset: AssetTelemetry, short: Mapping[str, str], look: Reliance) -> Cells:
    """Return the cells of an asset; values from an unreliable report are dimmed and have a `?`."""
    status, comms, state = look.asset(asset), term("comms", asset.comms), look.report(asset)
    going = asset.at or (f"{arrow(asset.heading_deg)} {asset.post}" if asset.post else "between")
    low = "▼" if asset.low_battery else ""
    level = f"{asset.battery_pct:3.0f}%" if asset.battery_known else "   ?"
    doubt = "" if state == "fresh" else "?"
    calm = asset.task in ("idle", "holding")
    return {
        "": (short.get(asset.id, asset.id), "bold"),
        "asset": (asset.id, ""),
        "status": status.part,
        "task": (f"{asset.task}{doubt}", QUIET if calm or doubt else ""),
        "at / to": (_questioned(going, doubt), QUIET if doubt else "" if asset.at else WARN),
        "batt": (f"{level}{low or doubt}", WARN if low else QUIET * bool(doubt)),
        "link": comms.part,
        "age": age_cell(look.age(asset), old=state in ("stale", "silent")),
    }


def track_cells(track: Track, look: Reliance) -> Cells:
    """Return the cells of a track; a lost track is dimmed and noted as not seen."""
    identity, intent = term("identity", track.identity), term("intent", track.intent)
    lost = look.lost(track)
    style = QUIET if lost else identity.style
    sign = "■" if track.kind == "vehicle" else "▪"
    return {
        "track": (f"{sign} {track.id}", f"bold {style}"),
        "gate": (track.gate, QUIET if lost else ""),
        "dist": (f"{track.distance_m:.0f} m{'?' if lost else ''}", QUIET if lost else ""),
        "identity": (f"{identity.glyph} {identity.word}", style),
        "ident.": (f"{identity.glyph} {_BRIEFLY[track.identity]}", style),
        "intent": intent.part,
        "age": age_cell(look.age(track), old=lost),
        NOTES: _track_notes(track, look),
    }


def _track_notes(track: Track, look: Reliance) -> tuple[str, str]:
    """Return the notes on a track: disputes, reports of hostility, behaviour and uncertainty."""
    urgent = track.intent == "hostile" or track.defiant or bool(track.dispute)
    parts: list[str] = []
    if look.lost(track):
        parts.append("not in view")
    if track.dispute:
        claims = zip(_short([*track.identity_claims]), track.identity_claims.values(), strict=True)
        parts.append(f"DISPUTED: {few([f'{name} {claim}' for name, claim in claims])}")
    if track.hostile_by:
        parts.append(f"by {few(_short(track.hostile_by))}")
    if track.defiant:
        parts.append("DEFIES warning")
    elif track.warned:
        parts.append("warned")
    parts.append(track.status)
    if track.emergency:
        parts.append("EMERGENCY VEHICLE")
    if track.noncombatants:
        parts.append("noncombatants?")
    if track.uncertainty_m >= 0.5:
        parts.append(f"±{track.uncertainty_m:.0f} m")
    seen = track.seen_by or track.observed_by
    if seen and not track.hostile_by:
        parts.append(f"seen by {few(_short(seen), 2)}")
    return ", ".join(parts), BAD if urgent else QUIET


def _short(names: Sequence[str]) -> list[str]:
    return list(short_names(names).values())


def camera_cells(name: str, camera: CameraReport, look: Reliance) -> Cells:
    """Return the cells of a gate camera."""
    state = look.camera(camera)
    mark = term("camera", state)
    return {
        "camera": (name, "bold"),
        "gate": (camera.gate, ""),
        "status": mark.part,
        "age": age_cell(look.age(camera), old=state == "unknown"),
    }


def _questioned(text: str, doubt: str, room: int = 11) -> str:
    return text[: room - len(doubt)] + doubt


def age_cell(age_s: float, *, old: bool) -> tuple[str, str]:
    """Return the age of a report; an old report's age is marked, so that it never looks recent."""
    if not old:
        return f"{min(age_s, 99):.1f} s", QUIET
    return f"{min(age_s, 999):.0f} s!", BAD


def asset_words(asset: AssetTelemetry, short: Mapping[str, str], look: Reliance) -> str:
    """Return the facts about an asset that a filter searches for its words."""
    problem = "problem" if look.rank(asset) < FINE else "fine"
    low = "low battery" if asset.low_battery else ""
    return " ".join(
        (asset.id, short.get(asset.id, ""), asset.kind, KIND_WORDS[asset.kind], "asset",
         asset.at or "", asset.post or "", asset.task, look.asset(asset).word,
         look.report(asset), asset.comms, low, problem)
    ).lower()  # fmt: skip


def track_words(track: Track, look: Reliance) -> str:
    """Return the facts about a track that a filter searches for its words."""
    problem = "problem" if track_rank(track)[0] < 4 else "fine"
    seen = "stale" if look.lost(track) else ""
    warned = "warned" if track.warned else ""
    disputed = "disputed" if track.dispute else ""
    return " ".join(
        (track.id, "track", track.kind, track.gate, track.identity, track.intent, track.status,
         disputed, seen, warned, problem)
    ).lower()  # fmt: skip


def camera_words(name: str, camera: CameraReport, look: Reliance) -> str:
    """Return the facts about a camera that a filter searches for its words."""
    state = look.camera(camera)
    return (
        f"{name} camera {camera.gate} {state} {'fine' if state == 'works' else 'problem'}".lower()
    )


class _Item(NamedTuple):
    """A row of the table; `name` is the title of a heading, the text of a note, or else an id."""

    kind: Literal["heading", "track", "asset", "camera", "note"]
    name: str


class RowCount(NamedTuple):
    """The numbers of all rows, of shown rows, and of rows that need attention."""

    total: int = 0
    shown: int = 0
    problems: int = 0


class AssetTable(VirtualRows):
    """The last reports of all assets, tracks and cameras; only rows in view are laid out."""

    def __init__(self, world: World, **kwargs: str) -> None:
        super().__init__(**kwargs)
        self._short = short_names(world.assets)
        self._stale_s = world.stale_s
        self._picture: Picture | None = None
        self._look: Reliance | None = None
        self._items: list[_Item] = []
        self._headings: list[int] = []
        self._wanted: tuple[str, ...] = ()
        self.count = RowCount()

    def show(self, picture: Picture | None) -> None:
        """Show another picture; the filter and the cursor are kept."""
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
        """Show only rows whose facts have every word of `text`."""
        self._wanted = tuple(text.lower().split())
        self.show(self._picture)

    def _arranged(self, picture: Picture, look: Reliance) -> list[_Item]:
        """Return the rows of each group with the most urgent first."""
        tracks = sorted(picture.tracks.values(), key=lambda t: (*track_rank(t), t.id))
        ranks = {name: look.rank(asset) for name, asset in picture.assets.items()}
        assets = sorted(picture.assets.values(), key=lambda a: ranks[a.id])
        cameras = sorted(picture.cameras.items(), key=lambda c: look.camera(c[1]) == "works")
        if self._wanted:
            tracks = [t for t in tracks if self._lets_in(track_words(t, look))]
            assets = [a for a in assets if self._lets_in(asset_words(a, self._short, look))]
            cameras = [c for c in cameras if self._lets_in(camera_words(*c, look))]
        items: list[_Item] = []
        if tracks:
            items += [_Item("heading", "tracks"), *(_Item("track", t.id) for t in tracks)]
        if assets:
            items += [_Item("heading", "assets"), *(_Item("asset", a.id) for a in assets)]
        if cameras:
            items += [_Item("heading", "cameras"), *(_Item("camera", name) for name, _ in cameras)]
        down = sum(look.camera(camera) != "works" for camera in picture.cameras.values())
        suspicious = sum(track_rank(track)[0] < 4 for track in picture.tracks.values())
        self.count = RowCount(
            total=len(picture.tracks) + len(picture.assets) + len(picture.cameras),
            shown=len(tracks) + len(assets) + len(cameras),
            problems=sum(rank < FINE for rank in ranks.values()) + down + suspicious,
        )
        return items or [_Item("note", "nothing matches the filter")]

    def _lets_in(self, words: str) -> bool:
        return all(word in words for word in self._wanted)

    def row(self, index: int, width: int) -> Content:
        """Return a heading or the row of a track, an asset or a camera."""
        kind, name = self._items[index]
        picture, look = self._picture, self._look
        if kind == "heading":
            layouts = {"tracks": tracks(width), "assets": ASSETS}
            return layouts.get(name, CAMERAS).heading(width)
        if picture is None or look is None or kind == "note":
            return Content.styled(name, WARN if picture is None else QUIET)
        if kind == "track":
            return tracks(width).line(track_cells(picture.tracks[name], look), width)
        if kind == "camera":
            camera = picture.cameras[name]
            return CAMERAS.line(camera_cells(name, camera, look), width)
        asset = picture.assets[name]
        return ASSETS.line(asset_cells(asset, self._short, look), width)

    def sticky(self, first: int, width: int) -> Content | None:
        """Return the heading of the group at the top of the view."""
        at = bisect_right(self._headings, first) - 1
        return self.row(self._headings[at], width) if at >= 0 else None


class AssetPane(Vertical):
    """The table with its filter; a filter in use is always named in the title."""

    BINDINGS = [Binding("escape", "clear", "No filter", show=False)]

    def __init__(self, world: World, **kwargs: str) -> None:
        super().__init__(id=kwargs.get("id"))
        self._text = ""
        self._field = LineField(
            id="asset-filter",
            placeholder="filter: uav, NorthGate, problem, stale, hostile, any text; Enter, Esc",
        )
        self._table = AssetTable(world, id="asset-rows")

    def compose(self) -> ComposeResult:
        """Yield the field of the filter, hidden until it is used, and the table."""
        yield self._field
        yield self._table

    def on_mount(self) -> None:
        """Begin without a filter."""
        self._field.display = False
        self._label()

    def show(self, picture: Picture | None) -> None:
        """Show another picture."""
        self._table.show(picture)
        self._label()

    def ask(self) -> None:
        """Let the operator type a filter."""
        self._field.display = True
        self.screen.set_focus(self._field)

    def toggle_problems(self) -> None:
        """Show only rows that need attention, or all rows again."""
        self._set("" if self._text == PROBLEMS else PROBLEMS)

    @on(Input.Changed, "#asset-filter")
    def _typed(self, event: Input.Changed) -> None:
        event.stop()
        self._text = event.value.strip()
        self._table.filter(self._text)
        self._label()

    @on(Input.Submitted, "#asset-filter")
    def _done(self, event: Input.Submitted) -> None:
        event.stop()
        self._leave()

    def action_clear(self) -> None:
        """Remove the filter."""
        self._set("")
        self._leave()

    def _set(self, text: str) -> None:
        self._field.value = text

    def _leave(self) -> None:
        self._field.display = False
        if self._field.has_focus or self.has_focus_within:
            self._table.focus()

    def _label(self) -> None:
        count = self._table.count
        title = "Assets and tracks"
        if count.problems:
            verb = "needs" if count.problems == 1 else "need"
            title += f"  ▲ {count.problems} of {count.total} {verb} attention"
        if self._text:
            title += f"  filter “{self._text}”: {count.shown} of {count.total}, Esc clears"
        retitle(self, title)
