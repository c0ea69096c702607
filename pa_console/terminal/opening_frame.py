"""The frame that a console shows while it opens: the first painting of its previous start.

Importing and opening everything takes a second; the frame appears after a tenth of that. A frame is
stored before the first event of a session, so nothing in it can be mistaken for the present
picture. Keys typed in the meantime stay in the terminal's queue for the screen. Before anything is
written to the standard streams, such as a warning, an error or a question, the frame is removed
from the terminal. Keys typed for the screen never answer such a question.
"""

import hashlib
import os
import re
import signal
import sys
import termios
from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from typing import IO, Any, Self, cast

from platformdirs import user_state_path

from pa_console.end_signals import end_signals, exit_code_of
from pa_console.private_files import make_private_folder, read_private, replace_private
from pa_console.terminal.output import DRIVER

ENTER_SCREEN, LEAVE_SCREEN = "\x1b[?1049h", "\x1b[0m\x1b[?25h\x1b[?1049l"
MOST_BYTES = 1_000_000
KEPT = 8
"""The number of frames that are kept; there is one for each size of the terminal and each choice of
options."""

_DRAWN = re.compile(r"(?:[^\x00-\x1f\x7f-\x9f]|\x1b\[[\d;]*m|\n)*")
"""The pattern of text with colours, but without any other control sequence for a terminal."""

_LOOKS = ("TERM", "COLORTERM", "NO_COLOR", "TEXTUAL_COLOR_SYSTEM", "TERM_PROGRAM")
"""The variables on which the colours of the screen depend."""


def frame_file(*options: object) -> Path | None:
    """Return the file of the frame for this terminal and these `options` of the screen.

    The result is None if there is no terminal, or Textual uses another driver.
    """
    if DRIVER in os.environ:
        return None
    try:
        if not (sys.stdin.isatty() and sys.stderr.isatty()):
            return None
        size = os.get_terminal_size(sys.stderr.fileno())
    except (OSError, ValueError):  # a stream without a descriptor
        return None
    looks = [os.environ.get(name, "") for name in _LOOKS]
    named = hashlib.sha256(repr((*size, *looks, *options)).encode()).hexdigest()[:32]
    return user_state_path("pa-console") / "frames" / f"{named}.ansi"


def keep_frame(file: Path, lines: Sequence[str]) -> None:
    """Store the screen's `lines` for the next start; errors of the disk are ignored."""
    content = "\n".join(lines).encode("utf-8", "replace")
    with suppress(OSError):
        make_private_folder(file.parent)
        if not file.exists() or file.read_bytes() != content:
            replace_private(file, content)
        newest = sorted(file.parent.glob("*.ansi"), key=lambda frame: frame.stat().st_mtime)
        for old in newest[:-KEPT]:
            old.unlink(missing_ok=True)


def load_frame(file: Path) -> list[str] | None:
    """Return the lines of a stored frame; None if there is none, or if it is not valid."""
    try:
        content = read_private(file)
        text = content.decode() if len(content) <= MOST_BYTES else "\x1b"
    except (OSError, UnicodeDecodeError):
        return None
    return text.split("\n") if _DRAWN.fullmatch(text) else None


class _UncoveringStream:
    """A standard stream that calls `uncover` before anything is written to it."""

    def __init__(self, stream: IO[str], uncover: Callable[[], None]) -> None:
        self._stream, self._uncover = stream, uncover

    def write(self, text: str) -> int:
        """Uncover the terminal, and write `text`."""
        self._uncover()
        return self._stream.write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


class OpeningFrame:
    """A cover for the terminal until the screen takes over: the frame in `file`, if there is one.

    It is a context manager; at its end, the terminal is as before, unless the screen has taken it
    over.
    """

    def __init__(self, file: Path | None) -> None:
        self.file = file
        self.shown = False
        self._modes: list[Any] = []
        """The terminal's modes before the frame."""
        self._heeding = ExitStack()
        """The cleanup that restores the standard streams and the signals."""
        self._covered: list[IO[str]] = []
        """The covering streams. They are kept because a `print` that uncovers the terminal still
        writes to one of them afterwards, although it holds no reference to that stream."""

    def __enter__(self) -> Self:
        """Show the frame; without one, the terminal is not changed."""
        lines = load_frame(self.file) if self.file is not None else None
        if lines is not None:
            self._show(lines)
        return self

    def __exit__(self, *_: object) -> None:
        self.uncover()

    def _show(self, lines: Sequence[str]) -> None:
        terminal = sys.stdin.fileno()
        self._modes = termios.tcgetattr(terminal)
        rows = "".join(f"\x1b[{number};1H{line}" for number, line in enumerate(lines, start=1))
        self._heeding.enter_context(end_signals(_end))
        self._heeding.callback(signal.signal, signal.SIGTSTP, signal.getsignal(signal.SIGTSTP))
        signal.signal(signal.SIGTSTP, signal.SIG_IGN)
        self.shown = True
        termios.tcsetattr(terminal, termios.TCSANOW, _raw(self._modes))
        sys.stderr.write(f"{ENTER_SCREEN}\x1b[?25l\x1b[?7l{rows}\x1b[0m\x1b[?7h")
        sys.stderr.flush()
        covered = [_UncoveringStream(stream, self.uncover) for stream in (sys.stdout, sys.stderr)]
        self._covered = cast(list[IO[str]], covered)
        self._heeding.enter_context(redirect_stdout(self._covered[0]))
        self._heeding.enter_context(redirect_stderr(self._covered[1]))

    def uncover(self) -> None:
        """Restore the terminal; keys typed for the screen are dropped."""
        self.release()
        if self.shown:
            self.shown = False
            sys.stderr.write(LEAVE_SCREEN)
            sys.stderr.flush()
            with suppress(termios.error):  # the terminal is gone
                termios.tcsetattr(sys.stdin.fileno(), termios.TCSAFLUSH, self._modes)

    def release(self) -> None:
        """Restore the standard streams and the signals; the frame stays visible."""
        self._heeding.close()

    def hand_over(self) -> list[Any]:
        """Hand the terminal and its frame to the screen; return the terminal's former modes."""
        self.shown = False
        return self._modes

    @contextmanager
    def telling(self, step: str) -> Generator[None]:
        """Show `step` in a line while the block runs, unless a frame is shown."""
        seen = not self.shown and sys.stderr.isatty()
        if seen:
            sys.stderr.write(step)
            sys.stderr.flush()
        try:
            yield
        finally:
            if seen:
                sys.stderr.write(f"\r{' ' * len(step)}\r")
                sys.stderr.flush()


def _end(number: int) -> None:
    raise SystemExit(exit_code_of(number))


def _raw(modes: Sequence[Any]) -> list[Any]:
    """Return `modes` changed so that keys are neither converted nor echoed; ^C still interrupts."""
    raw = list(modes)
    raw[0] &= ~(termios.IXON | termios.IXOFF | termios.ICRNL | termios.INLCR | termios.IGNCR)
    raw[3] &= ~(termios.ECHO | termios.ICANON | termios.IEXTEN)
    raw[6] = list(raw[6])
    raw[6][termios.VMIN], raw[6][termios.VTIME] = 1, 0
    return raw
