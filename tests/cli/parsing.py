"""Takes a command line apart as the program does, without running anything."""

import shlex

from typer.core import TyperGroup
from typer.main import get_command

from pa_console.cli.main import app

ACTS_AT_ONCE = frozenset(("--install-completion", "--show-completion", "--version", "--help", "-h"))
"""Options that do their work while they are read."""


def left_over(line: str) -> list[str]:
    """Return the words of a `pa-console` line that no verb takes, of which there should be none.

    Raises TyperException for an unknown verb or option, a missing or a wrong value, and ValueError
    for an option that acts while it is read.
    """
    command, words, context = get_command(app), shlex.split(line, comments=True)[1:], None
    if acting := ACTS_AT_ONCE.intersection(words):
        raise ValueError(f"{line!r} cannot be tried: {', '.join(acting)} acts at once")
    while True:
        context = command.make_context("pa-console", words, parent=context)
        words = [*context._protected_args, *context.args]  # pyright: ignore[reportPrivateUsage]
        if not isinstance(command, TyperGroup) or not words:
            return words
        _, below, words = command.resolve_command(context, words)
        assert below is not None
        command = below
