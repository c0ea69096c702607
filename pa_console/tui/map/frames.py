"""Draws gates, posts and the base with their names, and makes way for markers."""

from collections.abc import Collection, Mapping
from math import inf

from pa_console.schema.telemetry import Picture
from pa_console.schema.world import Frame
from pa_console.tui.map.canvas import Canvas, Cell, Run
from pa_console.tui.map.ground import FRAME_GLYPHS
from pa_console.tui.map.labels import Labels
from pa_console.tui.map.projection import Projection
from pa_console.tui.report_condition import cover_state
from pa_console.tui.status_words import term

_ADJOINING = 2.0
"""The discount of a place right beside a marker, if it hides nothing."""


class Frames:
    """Draws the frames of a picture; a gate shows whether it is covered, uncovered or unknown.

    A marker on a frame goes before the frame's sign, which then stands beside it.
    """

    def __init__(
        self,
        canvas: Canvas,
        labels: Labels,
        view: Projection,
        picture: Picture,
        involved: Collection[str] | None = None,
    ) -> None:
        """Covered gates that are not among those `involved` are dimmed, None dims nothing."""
        self._canvas, self._labels, self._view = canvas, labels, view
        self._covers, self._involved = picture.gates, involved
        self._displaced: list[tuple[Frame, Run]] = []

    def draw(self, frames: Mapping[str, Frame], places: Mapping[str, Cell]) -> None:
        """Draw signs, and those names that must be seen or have no marker in their way."""
        shown = {name: frame for name, frame in frames.items() if self._view.shows(frame.at)}
        for name in sorted(shown, key=lambda name: not self._urgent(name)):
            frame, at = shown[name], places.get(name)
            cell, sign = self._view.cell(frame.at), self._sign(name, frame)
            urgent, role = self._urgent(name), "label"
            if urgent:
                role = sign[1].replace("gate", "label")
            line = [(name, role)]
            if cell in self._canvas.marks:
                line.insert(0, sign)
            else:
                self._canvas.put(cell, *sign)
                self._labels.keep(cell)
            start = at and (at[0] + 1 - len(line), at[1])
            if start and self._labels.write(start, line, keep=urgent):
                continue
            if urgent:
                _ = self._place(frame, line) or self._place(frame, line[:1])
            elif at is not None:
                self._displaced.append((frame, line[-1]))
                if len(line) > 1:
                    self._place(frame, line[:1], most=_ADJOINING)

    def name_displaced(self) -> None:
        """Write the other names where assets have left room for them."""
        for frame, name in self._displaced:
            self._place(frame, [name])

    def _urgent(self, name: str) -> bool:
        return name in self._covers and not self._covers[name].covered

    def _sign(self, name: str, frame: Frame) -> Run:
        if name not in self._covers:
            return FRAME_GLYPHS[frame.kind], "frame"
        state = cover_state(self._covers[name])
        if state == "covered" and self._involved is not None and name not in self._involved:
            return term("gate", state).glyph, "dimmed"
        return term("gate", state).glyph, f"gate-{state}"

    def _place(self, frame: Frame, line: list[Run], most: float = inf) -> list[Cell]:
        gap = int(line[0][1].startswith("label"))
        cell, spots = self._view.cell(frame.at), [self._view.spot(frame.at)]
        return self._labels.place(cell, spots, [line], gap=gap, most=most)
