"""The observers of a session (traces, metrics, alerts, TAK map), and sources of outside reports."""

from collections.abc import Generator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from pa_console import __version__
from pa_console.cli.options import SessionOptions
from pa_console.observability import Observer, Observing, observed
from pa_console.resources import naming_what_is_missing
from pa_console.schema.events.event import OutsideReport
from pa_console.settings.schema import Settings
from pa_console.station.alarms.alerts import Alerting, AlertRules
from pa_console.station.notices import Outside
from pa_console.terminal.output import errors


@dataclass(frozen=True)
class Beside:
    """The observers of a session, `observer`, and the sources of reports for it, `outside`."""

    observer: Observer
    outside: Outside | None = None


@dataclass(frozen=True)
class _Together:
    """Several sources of reports, combined into one."""

    sources: Sequence[Outside]

    def news(self) -> list[OutsideReport]:
        """Return the new reports of all sources."""
        return [report for source in self.sources for report in source.news()]


@contextmanager
def observing(
    settings: Settings, options: SessionOptions, *, live: bool = False
) -> Generator[Beside]:
    """Yield the observers of a session; their problems are reported at the end.

    If stderr is `live` (not covered by a screen), changes of the connection to a TAK server are
    reported at once. Raises ValueError if a port cannot be used, a library is missing, an address
    for alerts is not valid, or the world has no position on the earth.
    """
    problems: list[str] = []
    choice = Observing(
        settings.traces, settings.trace_words, settings.metrics_port or None, __version__
    )

    def report_change(line: str) -> None:
        if live:
            errors.print_line(line, style="dim")

    try:
        with ExitStack() as stack:
            also, sources = list[Observer](), list[Outside]()
            if settings.tak:
                with naming_what_is_missing("tak", "TAK maps need"):
                    from pa_console.cli.sessions.on_map import on_map  # noqa: PLC0415 - only if used
                shown = stack.enter_context(
                    on_map(settings, options.world, problems.append, report_change)
                )
                also.append(shown.take)
                sources.append(shown.reports)
            if options.alert or options.alert_later:
                alerts = stack.enter_context(_alerting(options, settings))
                also.append(alerts.take)
                sources.append(alerts)
            outside = _Together(sources) if sources else None
            yield Beside(stack.enter_context(observed(choice, problems.append, also)), outside)
    finally:
        for problem in dict.fromkeys(problems):
            errors.print_line(f"warning: {problem}", style="yellow")


@contextmanager
def _alerting(options: SessionOptions, settings: Settings) -> Generator[Alerting]:
    """Yield the alerts about a session; raises ValueError if an address is not valid."""
    with naming_what_is_missing("alert", "alerts need"):
        from pa_console.observability.alert_delivery import AlertDelivery, receivers  # noqa: PLC0415

    rules = AlertRules(settings.alert_from, settings.alert_after_min * 60.0)
    delivery = AlertDelivery(receivers(options.alert or (), options.alert_later or ()))
    try:
        with Alerting(rules, delivery) as alerts:
            yield alerts
    finally:
        delivery.close()
