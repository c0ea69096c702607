"""Export of spans to a collector over OTLP, in a thread that never delays the session.

It requires the extra `telemetry`: the OpenTelemetry SDK and its exporter.
"""

import logging
from threading import Thread
from typing import Self
from urllib.parse import urlsplit

from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
from opentelemetry.sdk.resources import Resource
from opentelemetry.sdk.trace import TracerProvider
from opentelemetry.sdk.trace.export import BatchSpanProcessor, SpanExporter
from opentelemetry.trace import Tracer

SEND_S = 3.0
"""The longest duration of one delivery with its retries, in seconds."""
LEAVE_S = 2.0
"""The longest wait for the last spans at the end of a session, in seconds."""
PATH = "/v1/traces"
_LIBRARY = "opentelemetry"


class SpanExport:
    """A `tracer` whose spans go to the collector at `endpoint` while the context lasts.

    If the collector is slow or absent, spans are lost, but the session is not delayed: a full queue
    drops spans, and `problem` reports this.
    """

    def __init__(self, endpoint: str, version: str, exporter: SpanExporter | None = None) -> None:
        """Export to `endpoint`, a base address or a complete one; `version` is the program's.

        If `exporter` is given, it is used instead of OTLP.
        """
        self._endpoint = endpoint if urlsplit(endpoint).path.strip("/") else _joined(endpoint)
        self._log = _LastProblem()
        sends = exporter or OTLPSpanExporter(endpoint=self._endpoint, timeout=SEND_S)
        resource = Resource.create({"service.name": "pa-console", "service.version": version})
        self._provider = TracerProvider(resource=resource, shutdown_on_exit=False)
        self._tracer = self._provider.get_tracer("pa_console", version)
        self._provider.add_span_processor(BatchSpanProcessor(sends, schedule_delay_millis=1000))

    @property
    def tracer(self) -> Tracer:
        """The tracer that makes the spans."""
        return self._tracer

    @property
    def problem(self) -> str:
        """The last error of the delivery; '' if there was none."""
        return f"traces for {self._endpoint}: {self._log.last}" if self._log.last else ""

    def __enter__(self) -> Self:
        library = logging.getLogger(_LIBRARY)
        library.addHandler(self._log)
        library.propagate = False
        return self

    def __exit__(self, *_error: object) -> None:
        """Deliver the remaining spans, for at most LEAVE_S seconds."""
        leaving = Thread(target=self._provider.shutdown, name="last-spans", daemon=True)
        leaving.start()
        leaving.join(LEAVE_S)
        if leaving.is_alive():  # keep the handler: later messages must not reach the screen
            self._log.last = self._log.last or "the collector did not accept the last spans in time"
            return
        library = logging.getLogger(_LIBRARY)
        library.removeHandler(self._log)
        library.propagate = True


class _LastProblem(logging.Handler):
    """A handler that keeps the library's messages off the screen; `last` is the latest message."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.last = ""

    def emit(self, record: logging.LogRecord) -> None:
        """Keep one message."""
        self.last = " ".join(record.getMessage().split())[:300]


def _joined(endpoint: str) -> str:
    return endpoint.rstrip("/") + PATH
