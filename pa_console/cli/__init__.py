"""The command line of the console."""

from pa_console.cli.main import main

__all__ = ["main"]
