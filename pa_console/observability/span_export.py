"""Sends spans to a collector over OTLP, in a thread of its own that nobody ever waits for.

It needs the extra `telemetry`: the OpenTelemetry SDK and its exporter.
"""

import logging
from threading import Thread
from types import TracebackType
from typing import Self
from urllib.parse import urlsplit

from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
from opentelemetry.sdk.resources import Resource
from opentelemetry.sdk.trace import TracerProvider
from opentelemetry.sdk.trace.export import BatchSpanProcessor, SpanExporter
from opentelemetry.trace import Tracer

SEND_S = 3.0
"""How long one delivery may take, further tries included."""
LEAVE_S = 2.0
"""How long the end of a session waits for the last spans."""
PATH = "/v1/traces"
_LIBRARY = "opentelemetry"


class SpanExport:
    """Gives a `tracer` whose spans go to the collector at `endpoint` while the context lasts.

    A collector that is slow or away costs spans, never time: the queue has an end, what does not
    fit is dropped, and `problem` says so.
    """

    def __init__(self, endpoint: str, version: str, exporter: SpanExporter | None = None) -> None:
        """`endpoint` is a base address or a whole one, `version` that of the program.

        An `exporter` is used instead of OTLP.
        """
        self._endpoint = endpoint if urlsplit(endpoint).path.strip("/") else _joined(endpoint)
        self._told = _Told()
        sends = exporter or OTLPSpanExporter(endpoint=self._endpoint, timeout=SEND_S)
        resource = Resource.create({"service.name": "pa-console", "service.version": version})
        self._provider = TracerProvider(resource=resource, shutdown_on_exit=False)
        self._tracer = self._provider.get_tracer("pa_console", version)
        self._provider.add_span_processor(BatchSpanProcessor(sends, schedule_delay_millis=1000))

    @property
    def tracer(self) -> Tracer:
        """What makes the spans."""
        return self._tracer

    @property
    def problem(self) -> str:
        """What last went wrong with the delivery, '' when nothing did."""
        return f"traces for {self._endpoint}: {self._told.last}" if self._told.last else ""

    def __enter__(self) -> Self:
        library = logging.getLogger(_LIBRARY)
        library.addHandler(self._told)
        library.propagate = False
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Deliver what is left, for at most LEAVE_S seconds."""
        leaving = Thread(target=self._provider.shutdown, name="last-spans", daemon=True)
        leaving.start()
        leaving.join(LEAVE_S)
        if leaving.is_alive():  # what it logs from now on is for nobody, too
            self._told.last = self._told.last or "the last spans were not taken in time"
            return
        library = logging.getLogger(_LIBRARY)
        library.removeHandler(self._told)
        library.propagate = True


class _Told(logging.Handler):
    """Keeps what the library logs off the screen; `last` is the last thing that went wrong."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.last = ""

    def emit(self, record: logging.LogRecord) -> None:
        """Note one message."""
        self.last = " ".join(record.getMessage().split())[:300]


def _joined(endpoint: str) -> str:
    return endpoint.rstrip("/") + PATH
