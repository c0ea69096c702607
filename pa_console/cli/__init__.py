"""The command line: the same verbs as the console, without its screen."""

from pa_console.cli.main import main

__all__ = ["main"]
