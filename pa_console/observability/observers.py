"""What observes a session: it is given every event after the log, and can neither stop nor slow it.

An observer that fails is left out. Where nothing observes, no library is loaded for it.
"""

from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from pa_console.schema.events.event import Event

Observer = Callable[[Event], None]
"""Is given one event of a session after the other; what it raises ends its observing, no more."""


def unobserved(_: Event) -> None:
    """Observe nothing."""


@dataclass(frozen=True)
class Observing:
    """What a session is observed with.

    `traces` is the address of a collector, '' for none; `metrics_port` one of this machine, None
    for none. With `trace_words`, spans have what operator and model wrote.
    `version` is that of the program.
    """

    traces: str = ""
    trace_words: bool = False
    metrics_port: int | None = None
    version: str = ""


@contextmanager
def observed(
    asked: Observing, tell: Callable[[str], None], also: Sequence[Observer] = ()
) -> Generator[Observer]:
    """Give what takes the events of a session; `tell` is told what went wrong, at the end.

    `also` are other observers, which are given every event too.

    Where nothing observes, no library is loaded for it. Raises ValueError for a port that cannot
    be listened on, and for a library that is not installed.
    """
    with ExitStack() as stack:
        observers = list(also)
        if asked.metrics_port is not None:
            from pa_console.observability.metrics_server import MetricsServer  # noqa: PLC0415
            from pa_console.observability.session_metrics import SessionMetrics  # noqa: PLC0415

            metrics = SessionMetrics()
            stack.enter_context(MetricsServer(metrics.registry, asked.metrics_port))
            observers.append(metrics.take)
        if asked.traces:
            from pa_console.observability.mission_spans import MissionSpans  # noqa: PLC0415

            try:
                from pa_console.observability.span_export import SpanExport  # noqa: PLC0415
            except ImportError as error:
                raise ValueError(
                    f"traces need a library that is not installed ({error.name}): "
                    "pip install 'pa-console[telemetry]'"
                ) from error
            export = SpanExport(asked.traces, asked.version)
            stack.callback(lambda: tell(export.problem) if export.problem else None)
            stack.enter_context(export)
            observers.append(MissionSpans(export.tracer, words=asked.trace_words).take)
        yield _Each(observers, tell).take if observers else unobserved


class _Each:
    """Gives events to every observer; one that fails is told of and left out from then on."""

    def __init__(self, observers: Sequence[Observer], tell: Callable[[str], None]) -> None:
        self._observers, self._tell = list(observers), tell
        self._failed: list[Observer] = []

    def take(self, event: Event) -> None:
        for observer in self._observers:
            try:
                observer(event)
            except Exception as error:  # whoever observes must not end what is observed
                self._failed.append(observer)
                self._tell(f"no more is observed: {type(error).__name__}: {error}")
        if self._failed:
            self._observers = [each for each in self._observers if each not in self._failed]
            self._failed.clear()
