"""Observers of a session: missions as traces, numbers as metrics.

They receive every event after it is logged, and cannot stop the session. An observer that fails
gets no more events. The libraries of observers are loaded only if the observers are used.
"""

from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from pa_console.resources import naming_what_is_missing
from pa_console.schema.events.event import Event

Observer = Callable[[Event], None]
"""A function that receives the events of a session one by one, until it raises an error."""


def unobserved(_: Event) -> None:
    """Observe nothing."""


@dataclass(frozen=True)
class Observing:
    """The choice of observers for a session.

    `traces` is the address of a collector, '' for no traces; `metrics_port` is a port of this
    machine, None for no metrics. If `trace_words` is True, spans include the texts of operator and
    model. `version` is the version of the program.
    """

    traces: str = ""
    trace_words: bool = False
    metrics_port: int | None = None
    version: str = ""


@contextmanager
def observed(
    choice: Observing, tell: Callable[[str], None], also: Sequence[Observer] = ()
) -> Generator[Observer]:
    """Yield a function that passes the events of a session to all observers, `also` included.

    `tell` is called with a line about a failed observer, and at the end about a failed delivery.
    Raises ValueError for a port that cannot be used, and for a library that is not installed.
    """
    with ExitStack() as stack:
        observers = list(also)
        if choice.metrics_port is not None:
            with naming_what_is_missing("telemetry", "metrics need"):
                from pa_console.observability.session_metrics import (  # noqa: PLC0415
                    MetricsServer,
                    SessionMetrics,
                )
            metrics = SessionMetrics()
            stack.enter_context(MetricsServer(metrics.registry, choice.metrics_port))
            observers.append(metrics.take)
        if choice.traces:
            with naming_what_is_missing("telemetry", "traces need"):
                from pa_console.observability.mission_spans import MissionSpans  # noqa: PLC0415
                from pa_console.observability.span_export import SpanExport  # noqa: PLC0415

            export = SpanExport(choice.traces, choice.version)
            stack.callback(lambda: tell(export.problem) if export.problem else None)
            stack.enter_context(export)
            observers.append(MissionSpans(export.tracer, words=choice.trace_words).take)
        yield _Each(observers, tell).take if observers else unobserved


class _Each:
    """Several observers in one; an observer that fails is reported once and then left out."""

    def __init__(self, observers: Sequence[Observer], tell: Callable[[str], None]) -> None:
        self._observers, self._tell = list(observers), tell
        self._failed: list[Observer] = []

    def take(self, event: Event) -> None:
        for observer in self._observers:
            try:
                observer(event)
            except Exception as error:  # a failing observer must not end the session
                self._failed.append(observer)
                reason = f"{type(error).__name__}: {error}"
                self._tell(f"an observer failed and gets no more events: {reason}")
        if self._failed:
            self._observers = [o for o in self._observers if o not in self._failed]
            self._failed.clear()
