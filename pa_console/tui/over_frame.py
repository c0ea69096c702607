"""The handover from the opening frame to the screen, without a blank between them.

The first screen is stored as the opening frame of the next start.
"""

from collections.abc import Callable
from typing import Any

from rich.segment import Segment
from textual.app import App
from textual.driver import Driver
from textual.drivers.linux_driver import LinuxDriver
from textual.strip import Strip
from textual.widget import Widget

from pa_console.terminal.opening_frame import ENTER_SCREEN, OpeningFrame, keep_frame
from pa_console.tui.widgets.mission_prompt import MissionInput

OPENING = "Opening; what you type now is kept"
"""The text at the prompt of an opening frame."""


def driver_over(hand_over: Callable[[], list[Any]]) -> type[Driver]:
    """Return a driver class for a terminal that already shows the opening frame.

    `hand_over` hands over the terminal and returns its earlier attributes. The driver does not
    enter the alternate screen again, because that would clear the frame.
    """

    class DriverOverFrame(LinuxDriver):
        _covered = True

        def start_application_mode(self) -> None:
            before = hand_over() if self._covered else None
            super().start_application_mode()
            self._covered = False
            if before is not None:
                self.attrs_before = before

        def write(self, data: str) -> None:
            if not (self._covered and data == ENTER_SCREEN):
                super().write(data)

    return DriverOverFrame


def take_over(app: App[Any], frame: OpeningFrame) -> None:
    """Start `app` on top of `frame` if the frame covers the terminal."""
    frame.release()
    if frame.shown:
        app.driver_class = driver_over(frame.hand_over)


def keep_first(app: App[Any], frame: OpeningFrame) -> None:
    """Store the first painted screen of `app` as the opening frame of the next start."""
    prompts = app.screen.query(MissionInput)
    if frame.file is not None and prompts:
        keep_frame(frame.file, _frame_lines(app, prompts.first()))


def _frame_lines(app: App[Any], prompt: Widget) -> list[str]:
    """Return the lines of the current screen, with OPENING at the start of `prompt`."""
    strips = app.screen._compositor.render_strips()  # pyright: ignore[reportPrivateUsage]
    x, y = prompt.content_region.offset
    line, width = strips[y], min(prompt.content_region.width, app.size.width - x)
    words = OPENING[:width].ljust(width)
    style = next((style for _, style, _ in line.crop(x, x + 1)), None)
    message = Strip([Segment(words, style)], width)
    strips[y] = Strip.join([line.crop(0, x), message, line.crop(x + width)])
    return [strip.render(app.console) for strip in strips]
