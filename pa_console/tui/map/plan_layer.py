"""The map's layer for a plan that has not run yet: routes, arrivals, cover of gates."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

from pa_console.schema.world import World
from pa_console.tui.map.canvas import Canvas, Cell, Projection, Run, Strokes
from pa_console.tui.map.ground import MapGround
from pa_console.tui.map.labels import Labels
from pa_console.tui.map.markers import Symbol
from pa_console.tui.plan_preview import CoverChange, PlanPreview

ARRIVAL = "◎"
"""The mark of a destination."""

MOST_NAMED = 3
"""The maximum number of arrivals at a place that are named there, each with its time in seconds."""

FARTHEST = 4.0
"""The highest cost of a text beside its place; a costlier text follows the place's name."""

MOST_SOLID = 16
"""The maximum number of routes drawn as solid lines; if there are more, all are dotted."""

DIMMED = frozenset(("uav", "ugv", "robot", "crowd", "track-authorized"))
"""The roles of symbols without trouble or threat; a plan dims those that it does not concern."""

_ROUTE_OVER = frozenset(("", "lane", "zone", "asset-field", "camera-field", "trail", "route"))


@dataclass(frozen=True)
class PlanLayer:
    """One plan on the map, `time_s` seconds after its start."""

    preview: PlanPreview
    short: Mapping[str, str]
    time_s: float = 0.0

    def dims(self, name: str) -> bool:
        """Return whether the plan does not concern an asset or track."""
        return name not in self.preview.involved

    def draw_routes(self, canvas: Canvas, view: Projection) -> None:
        """Draw the rest of the route of every moving asset, and its destination."""
        strokes, ends = Strokes(), list[tuple[int, int]]()
        period = 1 if len(self.preview.ways) <= MOST_SOLID else 3
        for name in self.preview.ways:
            left = self.preview.way_left(name, self.time_s)
            if not left:
                continue
            strokes.path([view.spot(point) for point in left], period=period)
            if name in self.preview.goals:
                ends.append(view.cell(left[-1]))
        strokes.draw(canvas, "ghost", over=_ROUTE_OVER)
        for cell in ends:
            canvas.put(cell, ARRIVAL, "arrival")

    def write(self, labels: Labels, ground: MapGround, world: World) -> None:
        """Write the arrivals at every place, with their times, and the change of its cover.

        If there is no room beside the place, the text follows the place's name; a text that hides
        no wall is preferred.
        """
        view = ground.view
        changes = self.preview.cover_changes
        for place in dict.fromkeys((*changes, *self.preview.arrivals)):
            at = world.frames[place].at
            if view.shows(at):
                coming = self.preview.arrivals.get(place, ())
                lines = list(self._lines(changes.get(place), place, coming))
                spot = view.spot(at)
                beside = (
                    labels.place(view.cell(at), [spot], [text], most=FARTHEST) for text in lines
                )
                if not any(beside) and (name := ground.names.get(place)):
                    behind = name[0] + len(place), name[1]
                    spaced = [[(" ", ""), *line] for line in lines]
                    inside = [line for line in spaced if not _meets_barrier(ground, behind, line)]
                    _ = any(labels.write(behind, line) for line in (*inside, *spaced))

    def _lines(
        self, change: CoverChange | None, place: str, coming: tuple[str, ...]
    ) -> Iterator[list[Run]]:
        """Yield the text for a place, and then shorter texts for less room."""
        yield list(self._line(change, self._coming(place, coming)))
        if coming:
            yield list(self._line(change, f"+{len(coming)}"))
        if change is not None:
            yield list(self._line(change, ""))

    @staticmethod
    def _line(change: CoverChange | None, coming: str) -> Iterator[Run]:
        if change is not None:
            yield _cover_words(change), "gate-loses" if change.loses else "gate-gains"
        if coming:
            yield f"{' ' * (change is not None)}{coming}", "arrival"

    def _coming(self, place: str, names: tuple[str, ...]) -> str:
        if len(names) > MOST_NAMED:
            last = self.preview.arrival_s(names[-1], place)
            return f"{len(names)} come" + (f" by {last:.0f}s" if last is not None else "")
        return " ".join(
            f"{self.short.get(name, name)}{self._seconds(name, place)}" for name in names
        )

    def _seconds(self, name: str, place: str) -> str:
        at = self.preview.arrival_s(name, place)
        return "" if at is None else f"+{at:.0f}s"


def _meets_barrier(ground: MapGround, start: Cell, line: Sequence[Run]) -> bool:
    length = sum(len(text) for text, _ in line)
    return any((start[0] + offset, start[1]) in ground.barriers for offset in range(length))


@lru_cache(maxsize=4096)
def dimmed(symbol: Symbol) -> Symbol:
    """Return a symbol that a plan does not concern, dimmed unless it shows trouble or a threat."""
    if symbol.role not in DIMMED:
        return symbol
    return symbol._replace(role="dimmed", detail="")


def _cover_words(change: CoverChange) -> str:
    words = f"{change.before}→{change.after}"
    gap_s = change.longest_gap_s if change.after else 0.0
    return f"{words} gap {gap_s:.0f}s" if gap_s else words
