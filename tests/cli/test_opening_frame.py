"""A console that opens shows the first screen of its last start, and loses no typed key."""

import os
import pty
import select
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from pa_console.terminal.opening_frame import KEPT, keep_frame, load_frame
from pa_console.tui.over_frame import OPENING
from tests.cli.outside import WITHIN_S, Start
from tests.cli.terminal import screen

ENTERED, LEFT = "\x1b[?1049h", "\x1b[?1049l"
OPENS = """
import sys
from pathlib import Path
from pa_console.terminal.opening_frame import OpeningFrame
with OpeningFrame(Path(sys.argv[1])) as frame:
    exec(sys.argv[2])
"""


@pytest.fixture
def frame(tmp_path: Path) -> Path:
    """The file of a frame of two lines."""
    file = tmp_path / "frame.ansi"
    keep_frame(file, ["\x1b[1;31mMap\x1b[0m", "Opening"])
    return file


def text_of(written: str) -> str:
    """Return the text on a screen to which all this was `written`."""
    cells = screen(written)
    return "".join(cells[place][0] for place in sorted(cells))


def outcome(frame: Path, then: str, typed: bytes = b"") -> tuple[str, int]:
    """Return what a terminal shows of a program that opens with `frame`, and its exit code."""
    terminal, its = pty.openpty()
    program = subprocess.Popen(
        [sys.executable, "-c", OPENS, str(frame), then], stdin=its, stdout=its, stderr=its
    )
    os.close(its)
    shown = b""
    try:
        while program.poll() is None or select.select([terminal], [], [], 0)[0]:
            if select.select([terminal], [], [], 0.05)[0]:
                shown += os.read(terminal, 65536)
                if typed and b"Opening" in shown:
                    os.write(terminal, typed)
                    typed = b""
    except OSError:  # the program has left the terminal
        pass
    os.close(terminal)
    return shown.decode(), program.wait()


def test_the_frame_is_shown_and_then_the_terminal_is_as_it_was(frame: Path) -> None:
    shown, code = outcome(frame, "pass")
    assert (shown.index(ENTERED) < shown.index("Opening") < shown.index(LEFT), code) == (True, 0)


def test_what_is_written_while_it_opens_is_seen(frame: Path) -> None:
    for stream in ("stdout", "stderr"):
        shown, _ = outcome(frame, f"print('the rules were altered', file=sys.{stream})")
        assert shown.index(LEFT) < shown.index("the rules were altered")


def test_a_key_for_the_screen_answers_no_question(frame: Path) -> None:
    waiting = "select.select([sys.stdin], [], [], {})[0]"
    asks = f"import select; {waiting.format(60)}; print('Go on?'); print({waiting.format(0)})"
    shown, _ = outcome(frame, asks, typed=b"y\r")
    assert shown.partition("Go on?")[2].split() == ["[]"]


def test_keys_that_are_typed_while_it_opens_come_to_the_prompt(
    start: Start,
) -> None:
    words = ("console", "--no-alarms")
    before = start(*words, terminal=True)
    before.until("telemetry")
    before.process.send_signal(signal.SIGTERM)
    assert before.process.wait(WITHIN_S) == 143
    assert OPENING not in before.shown
    again = start(*words, terminal=True)
    again.until_shown(OPENING)
    again.type("Fill the gap")
    again.until_new(before.log)
    assert again.shown.count(ENTERED) == 1, "the terminal is not cleared in between"
    again.until_true(lambda: "Fill the gap" in text_of(again.shown))


def test_a_signal_that_ends_it_uncovers_the_terminal(frame: Path) -> None:
    shown, code = outcome(frame, "import os, signal; os.kill(os.getpid(), signal.SIGTERM)")
    assert (LEFT in shown, code) == (True, 143)


@pytest.mark.parametrize("drawn", ["\x1b]52;c;aGk=\x07", "\x1b[2J", "\x07", "\x9b31m"])
def test_a_frame_that_does_more_than_draw_is_not_shown(tmp_path: Path, drawn: str) -> None:
    keep_frame(tmp_path / "frame.ansi", [f"Map{drawn}"])
    assert load_frame(tmp_path / "frame.ansi") is None


def test_a_frame_that_others_may_have_written_is_not_shown(frame: Path) -> None:
    assert load_frame(frame) == ["\x1b[1;31mMap\x1b[0m", "Opening"]
    frame.chmod(0o666)
    assert load_frame(frame) is None


def test_few_frames_are_kept(tmp_path: Path) -> None:
    for number in range(KEPT + 3):
        keep_frame(tmp_path / f"{number}.ansi", [str(number)])
        os.utime(tmp_path / f"{number}.ansi", (number, number))
    keep_frame(tmp_path / "last.ansi", ["last"])
    assert len(list(tmp_path.glob("*.ansi"))) == KEPT
    assert (tmp_path / "last.ansi").exists()
