"""Observes the session of a verb as its settings say."""

from collections.abc import Generator
from contextlib import contextmanager

from pa_console import __version__
from pa_console.cli.output import errors
from pa_console.observability.observers import Observer, Observing, observed
from pa_console.settings.schema import Settings


@contextmanager
def observing(settings: Settings) -> Generator[Observer]:
    """Give what takes the session's events; what goes wrong with it is told at the end.

    Raises ValueError for a port that cannot be listened on, and for a library that is missing.
    """
    problems: list[str] = []
    asked = Observing(
        settings.traces, settings.trace_words, settings.metrics_port or None, __version__
    )
    try:
        with observed(asked, problems.append) as observer:
            yield observer
    finally:
        for problem in dict.fromkeys(problems):
            errors.print(f"warning: {problem}", style="yellow", markup=False, soft_wrap=True)
