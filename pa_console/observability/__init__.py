"""Observers of a session: missions as traces, numbers as metrics.

They receive every event after the log and cannot stop the session. An observer that fails is left
out. Without observers, their libraries are not loaded.
"""

from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from pa_console.resources import naming_what_is_missing
from pa_console.schema.events.event import Event

Observer = Callable[[Event], None]
"""A function that receives the events of a session one by one; an error ends only its observing."""


def unobserved(_: Event) -> None:
    """Observe nothing."""


@dataclass(frozen=True)
class Observing:
    """The choice of a session's observers.

    `traces` is the address of a collector, '' for none; `metrics_port` is a port of this machine,
    None for none. With `trace_words`, spans have the texts of operator and model. `version` is the
    version of the program.
    """

    traces: str = ""
    trace_words: bool = False
    metrics_port: int | None = None
    version: str = ""


@contextmanager
def observed(
    asked: Observing, tell: Callable[[str], None], also: Sequence[Observer] = ()
) -> Generator[Observer]:
    """Yield a function that passes the events of a session to all observers, `also` included.

    `tell` is called with a line about a failed observer, and at the end about a failed delivery.
    Raises ValueError for a port that cannot be used, and for a library that is not installed.
    """
    with ExitStack() as stack:
        observers = list(also)
        if asked.metrics_port is not None:
            with naming_what_is_missing("telemetry", "metrics need"):
                from pa_console.observability.session_metrics import (  # noqa: PLC0415
                    MetricsServer,
                    SessionMetrics,
                )
            metrics = SessionMetrics()
            stack.enter_context(MetricsServer(metrics.registry, asked.metrics_port))
            observers.append(metrics.take)
        if asked.traces:
            with naming_what_is_missing("telemetry", "traces need"):
                from pa_console.observability.mission_spans import MissionSpans  # noqa: PLC0415
                from pa_console.observability.span_export import SpanExport  # noqa: PLC0415

            export = SpanExport(asked.traces, asked.version)
            stack.callback(lambda: tell(export.problem) if export.problem else None)
            stack.enter_context(export)
            observers.append(MissionSpans(export.tracer, words=asked.trace_words).take)
        yield _Each(observers, tell).take if observers else unobserved


class _Each:
    """Several observers as one; an observer that fails is reported once and left out."""

    def __init__(self, observers: Sequence[Observer], tell: Callable[[str], None]) -> None:
        self._observers, self._tell = list(observers), tell
        self._failed: list[Observer] = []

    def take(self, event: Event) -> None:
        for observer in self._observers:
            try:
                observer(event)
            except Exception as error:  # a failing observer must not end the session
                self._failed.append(observer)
                self._tell(f"no more is observed: {type(error).__name__}: {error}")
        if self._failed:
            self._observers = [o for o in self._observers if o not in self._failed]
            self._failed.clear()
