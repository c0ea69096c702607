"""The console's terminal: notice of a hang-up, and the user's own editor in the terminal."""

import asyncio
import os
import select
import shlex
import shutil
import signal
import tempfile
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from types import FrameType
from typing import Any

from textual.app import SuspendNotSupported
from textual.screen import Screen

from pa_console.schema.document import DocumentError, read_text

NO_EDITOR = "set VISUAL or EDITOR to the command of your editor"


def when_hung_up(terminal: int, do: Callable[[], None]) -> None:
    """Call `do` from a separate thread once the other end of the file `terminal` is closed.

    SIGHUP is not enough, because only a controlling terminal sends it. The thread reads no keys.
    """
    watch = select.poll()
    watch.register(terminal, 0)  # hang-ups and errors are always reported

    def wait() -> None:
        watch.poll()
        do()

    Thread(target=wait, name="hangup", daemon=True).start()


def editor_command() -> list[str]:
    """Return the words of the user's editor command, with its program as an absolute path.

    Raises ValueError if there is no editor.
    """
    given = os.environ.get("VISUAL") or os.environ.get("EDITOR") or "vi"
    try:
        words = shlex.split(given)
    except ValueError as error:
        raise ValueError(f"“{given}” is not a command ({error}); {NO_EDITOR}") from error
    program = shutil.which(words[0]) if words else None
    if program is None:
        raise ValueError(f"there is no editor “{given}”; {NO_EDITOR}")
    return [os.path.abspath(program), *words[1:]]


async def edit_outside(screen: Screen[Any], command: list[str], text: str) -> str:
    """Open `text` in the editor `command` on the console's terminal; return the saved text.

    The editor starts in the folder of its file, so that it reads no settings (`.exrc`) from another
    folder. The event loop keeps running, so that a session continues. Raises ValueError if the
    editor fails or the terminal cannot be handed over.
    """
    with tempfile.TemporaryDirectory(prefix="pa-console-") as folder:
        file = Path(folder, "rule.yaml")
        file.write_text(text, encoding="utf-8")
        try:
            with (
                screen.app.suspend(),
                screen.app.batch_update(),
                _keyboard_interrupts_left_to_the_editor(),
            ):
                process = await asyncio.create_subprocess_exec(*command, str(file), cwd=folder)
                code = await process.wait()
        except SuspendNotSupported as error:
            raise ValueError("this terminal cannot be given to another program") from error
        except OSError as error:
            raise ValueError(f"{command[0]}: {error.strerror}") from error
        if code != 0:
            raise ValueError(f"{command[0]} ended with code {code}: the draft is unchanged")
        try:
            return read_text(file)
        except DocumentError as error:
            raise ValueError(f"the text from the editor cannot be read: {error}") from error


@contextmanager
def _keyboard_interrupts_left_to_the_editor() -> Generator[None]:
    before = signal.signal(signal.SIGINT, _nothing)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _nothing(_number: int, _frame: FrameType | None) -> None:
    """Ignore an interrupt; unlike SIG_IGN, this handler is not inherited by a child process."""
