"""Output on a terminal: streams, consoles that print plain text, JSON, and exit codes."""

import json
import os
import sys
from collections.abc import Iterable
from typing import IO, TYPE_CHECKING, Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.status import Status
from rich.text import Text

from pa_console.schema.text import visible, visible_json

if TYPE_CHECKING:
    from pa_console.schema.rule import RulesSeal

DRIVER = "TEXTUAL_DRIVER"
"""The variable that names a driver of Textual other than the terminal's, such as a browser's."""
FAILED = 1
BAD_INPUT = 2


class PlainConsole(Console):
    """A console that reads no markup in a text, and shows control characters in visible form."""

    def __init__(self, **options: Any) -> None:
        """Pass `options` to Rich; markup, highlighting and emoji codes are off."""
        super().__init__(markup=False, highlight=False, emoji=False, **options)

    def print_line(self, text: RenderableType, style: str | None = None) -> None:
        """Print a line without wrapping, so that paths and commands in it can be copied."""
        self.print(text, style=style, soft_wrap=True)

    def render_str(self, text: str, **options: Any) -> Text:
        """Return `text` in visible form before it is measured, wrapped and put into columns."""
        return super().render_str(visible(text), **options)

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Yield the segments of `renderable` in visible form, including those of a `Text`."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(visible(segment.text), segment.style)

    def status(self, status: RenderableType, **options: Any) -> Status:
        """Return a spinner whose label is always plain text, even after an update."""
        return _PlainStatus(_text(status), console=self, **options)


class _PlainStatus(Status):
    """A spinner that treats its label as plain text."""

    def update(self, status: RenderableType | None = None, **options: Any) -> None:
        """Show another label."""
        super().update(None if status is None else _text(status), **options)


def _text(status: RenderableType) -> RenderableType:
    return Text(visible(status)) if isinstance(status, str) else status


def open_closed_streams() -> None:
    """Open every closed standard stream on the null device.

    Otherwise, the next file that is opened becomes standard input or output, and code that reads or
    writes there would use that file.
    """
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        if getattr(sys, name) is None:
            stream = _open_on_nothing(number, mode)
            setattr(sys, name, stream)
            setattr(sys, f"__{name}__", stream)


def require_keys(instead: str) -> None:
    """Raise ValueError, with the advice `instead`, if the operator's keys cannot be read.

    Textual's other drivers, such as that of a browser, deliver keys without a terminal.
    """
    if DRIVER not in os.environ and not sys.stdin.isatty():
        raise ValueError(f"standard input is not a terminal, so keys cannot be read; {instead}")


def _open_on_nothing(number: int, mode: str) -> IO[Any]:
    """Return a stream on the null device, as descriptor `number` unless that is already in use."""
    opened = os.open(os.devnull, os.O_RDONLY if mode == "r" else os.O_WRONLY)
    os.set_inheritable(opened, opened == number)
    return os.fdopen(opened, mode, encoding="utf-8", closefd=False)


out = PlainConsole()
errors = PlainConsole(stderr=True)


def warn_of_altered(rules: str, seal: "RulesSeal") -> None:
    """Print the warnings about the rules in force to stderr."""
    altered = (f"{seal.words}: {seal.problem}",) if seal.altered else ()
    for warning in (*altered, *seal.warnings):
        errors.print_line(f"warning: the rules {rules!r}: {warning}", style="bold red")


def print_json(value: Any) -> None:
    """Print `value`, dataclasses and pydantic models included, as one indented JSON document."""
    from pydantic import TypeAdapter  # noqa: PLC0415 - only when it is asked for

    plain = TypeAdapter(Any).dump_python(value, mode="json")
    sys.stdout.write(visible_json(json.dumps(plain, indent=2, ensure_ascii=False)) + "\n")


def print_document(text: str) -> None:
    """Print a text that has its own line breaks, such as Markdown, and add nothing."""
    sys.stdout.write(visible(text))
