"""What the program finds as its standard streams: a terminal, a file, or nothing (`<&-`)."""

import os
import sys
from typing import IO, Any


def open_closed_streams() -> None:
    """Let every standard stream that was closed read nothing, or lead nowhere.

    Otherwise the next file that is opened becomes standard input or output, and whoever reads or
    writes there meets it.
    """
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        if getattr(sys, name) is None:
            stream = _open_on_nothing(number, mode)
            setattr(sys, name, stream)
            setattr(sys, f"__{name}__", stream)


def require_keys(instead: str) -> None:
    """Raise ValueError, with what to do instead, where no key of an operator can arrive.

    Textual's own drivers, such as that of a browser, bring keys without a terminal.
    """
    if "TEXTUAL_DRIVER" not in os.environ and not sys.stdin.isatty():
        raise ValueError(f"standard input is no terminal, no key would arrive; {instead}")


def _open_on_nothing(number: int, mode: str) -> IO[Any]:
    """Return a stream on the null device: as descriptor `number`, unless a file is there by now."""
    opened = os.open(os.devnull, os.O_RDONLY if mode == "r" else os.O_WRONLY)
    os.set_inheritable(opened, opened == number)
    return os.fdopen(opened, mode, encoding="utf-8", closefd=False)
