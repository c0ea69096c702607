"""The observers of a verb's session by its settings, and the sources of outside reports."""

from collections.abc import Generator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from pa_console import __version__
from pa_console.cli.options import naming_what_is_missing
from pa_console.cli.sessions.alerting import NOBODY, AlertTargets, alerting
from pa_console.observability import Observer, Observing, observed
from pa_console.schema.events.event import OutsideReport
from pa_console.settings.schema import Settings
from pa_console.station.notices import Outside
from pa_console.terminal.output import errors


@dataclass(frozen=True)
class Beside:
    """The observers of a session: `observer` takes its events, `outside` has reports for it."""

    observer: Observer
    outside: Outside | None = None


@contextmanager
def observing(
    settings: Settings, world: str = "", alerts: AlertTargets = NOBODY, *, live: bool = False
) -> Generator[Beside]:
    """Yield the observers of a session; their problems are reported at the end.

    With the name of a `world`, the session is shown on the map of a TAK server, if one is set.
    Changes of that connection are reported meanwhile if stderr is `live`: no screen is over it.
    People are alerted at the addresses of `alerts`.
    Raises ValueError for a port that cannot be listened on, for a library that is missing and for a
    world without a place on the earth.
    """
    problems: list[str] = []
    asked = Observing(
        settings.traces, settings.trace_words, settings.metrics_port or None, __version__
    )
    try:
        with ExitStack() as stack:
            also, sources = list[Observer](), list[Outside]()
            if world and settings.tak:
                with naming_what_is_missing("tak", "TAK maps need"):
                    from pa_console.cli.sessions.on_map import on_map  # noqa: PLC0415 - then only
                shown = stack.enter_context(
                    on_map(settings, world, problems.append, _say if live else _nothing)
                )
                also.append(shown.take)
                sources.append(shown.reports)
            if alerts:
                told = stack.enter_context(alerting(alerts, settings))
                also.append(told.take)
                sources.append(told)
            outside = _Together(sources) if sources else None
            yield Beside(stack.enter_context(observed(asked, problems.append, also)), outside)
    finally:
        for problem in dict.fromkeys(problems):
            errors.print_line(f"warning: {problem}", style="yellow")


@dataclass(frozen=True)
class _Together:
    """Several sources of reports as one."""

    sources: Sequence[Outside]

    def news(self) -> list[OutsideReport]:
        """Return the new reports of all of them."""
        return [report for source in self.sources for report in source.news()]


def _say(line: str) -> None:
    errors.print_line(line, style="dim")


def _nothing(_: str) -> None:
    pass
