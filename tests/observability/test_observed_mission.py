"""A mission as spans and as numbers: made of its events alone, and never in the way of it."""

import asyncio
import logging
import re
import socket
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from http.server import BaseHTTPRequestHandler, HTTPServer
from threading import Thread
from typing import Any

import pytest
from opentelemetry.sdk.trace import ReadableSpan, TracerProvider
from opentelemetry.sdk.trace.export import SimpleSpanProcessor
from opentelemetry.sdk.trace.export.in_memory_span_exporter import InMemorySpanExporter
from prometheus_client import CollectorRegistry
from prometheus_client.parser import text_string_to_metric_families

from pa_console.observability import Observing, observed, span_export, unobserved
from pa_console.observability.mission_spans import NUMBERS, MissionSpans
from pa_console.observability.session_metrics import MetricsServer, SessionMetrics
from pa_console.observability.span_export import SpanExport
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Usage
from pa_console.station.assembly import load_site
from tests.rig import Rig
from tests.scripted import ScriptedEngine, plan

WORDS = "Zebra patrol: fill the gap at EastGate."
FILL = plan(("Drone_T04", "move_to EastGate"), reason="because of the zebra")
STRIP = plan(("Drone_T02", "move_to EastGate"), reason="it leaves the North Gate alone")
"""A plan that the rules forbid."""


def played(answer: str) -> Sequence[ev.Event]:
    """Return every event of a session with one mission, to which the planner answers `answer`."""
    rig = Rig(load_site("checkpoint", "checkpoint"))
    asyncio.run(rig.run(ScriptedEngine([answer]), text=WORDS))
    return rig.events


@pytest.fixture(scope="module")
def events() -> Sequence[ev.Event]:
    """Every event of a session with one mission that is verified."""
    return played(FILL)


@pytest.fixture(scope="module")
def refused() -> Sequence[ev.Event]:
    """Every event of a session whose only plan the rules forbid."""
    return played(STRIP)


def spans_of(events: Sequence[ev.Event], *, words: bool = False) -> list[ReadableSpan]:
    """Return the spans that are made of `events`, in the order of their ends."""
    kept, provider = InMemorySpanExporter(), TracerProvider()
    provider.add_span_processor(SimpleSpanProcessor(kept))
    spans = MissionSpans(provider.get_tracer("test"), words=words)
    for event in events:
        spans.take(event)
    return list(kept.get_finished_spans())


def _told(span: ReadableSpan) -> dict[str, Any]:
    return dict(span.attributes or {})


def metrics_of(events: Sequence[ev.Event]) -> dict[str, float]:
    """Return the numbers that `events` come to, by name and labels as Prometheus writes them."""
    metrics = SessionMetrics()
    for event in events:
        metrics.take(event)
    with MetricsServer(metrics.registry, 0) as server:
        text = scraped(server.port)
    found: dict[str, float] = {}
    for family in text_string_to_metric_families(text):
        for sample in family.samples:
            labels = ",".join(f"{name}={value}" for name, value in sorted(sample.labels.items()))
            found[f"{sample.name}{{{labels}}}"] = sample.value
    return found


def scraped(port: int, path: str = "/metrics", host: str = "") -> str:
    """Return what a scrape gives; raises HTTPError for what is refused."""
    request = urllib.request.Request(f"http://127.0.0.1:{port}{path}")
    if host:
        request.add_header("Host", host)
    with urllib.request.urlopen(request, timeout=300) as answer:
        return answer.read().decode()


def test_a_mission_is_one_trace_with_a_span_for_every_step(
    events: Sequence[ev.Event],
) -> None:
    spans = spans_of(events)
    (root,) = (span for span in spans if span.parent is None)
    assert root.name == "mission"
    steps = [span for span in spans if span is not root]
    assert all(span.parent == root.context for span in steps)
    assert {_told(span)["pa.step"] for span in steps} == {*range(1, 11)} - {2}
    assert {_told(span)["pa.step"] for span in steps if span.name == "prompt"} == {4, 6}
    assert {span.name for span in steps} == set(NUMBERS) - {"read_again"}
    assert _told(root)["pa.mission.status"] == "verified"


def test_the_times_of_spans_are_those_of_the_events(events: Sequence[ev.Event]) -> None:
    spans = {span.name: span for span in spans_of(events)}
    told = {event.data.kind: event for event in events}
    asked, finished = told["approval_requested"], told["mission_finished"]
    decide, root = spans["decide"], spans["mission"]
    assert (decide.start_time or 0) // 1000 == round(asked.t.timestamp() * 1e6)
    assert (root.end_time or 0) // 1000 == round(finished.t.timestamp() * 1e6)
    for span in spans.values():
        assert (span.start_time or 0) <= (span.end_time or 0)


def test_what_was_read_before_the_order_was_sent_is_no_part_of_a_span(
    events: Sequence[ev.Event],
) -> None:
    usage = {"usage": Usage(seconds=5.0, ahead_s=4.5)}
    early = [
        event.model_copy(update={"data": event.data.model_copy(update=usage)})
        if isinstance(event.data, ev.PlanProposed)
        else event
        for event in events
    ]
    span = {span.name: span for span in spans_of(early)}["plan"]
    assert span.start_time is not None
    assert span.end_time is not None
    assert span.end_time - span.start_time == 500_000_000
    assert _told(span)["pa.usage.ahead_s"] == 4.5


def test_no_word_of_an_operator_is_in_a_span_unless_asked_for(
    events: Sequence[ev.Event],
) -> None:
    told = "".join(span.to_json() for span in spans_of(events)).lower()
    assert "zebra" not in told
    assert "standing instruction" not in told
    with_words = "".join(span.to_json() for span in spans_of(events, words=True))
    assert WORDS in with_words
    assert "because of the zebra" in with_words


def test_a_session_that_ends_ends_every_span(events: Sequence[ev.Event]) -> None:
    asked = next(n for n, event in enumerate(events) if event.data.kind == "approval_requested")
    cut = [*events[: asked + 1], events[-1]]
    assert cut[-1].data.kind == "session_ended"
    spans = spans_of(cut)
    root = next(span for span in spans if span.name == "mission")
    assert _told(root)["pa.mission.status"] == "unfinished"
    assert "decide" in {span.name for span in spans}


def test_missions_decisions_steps_and_commands_are_counted(
    events: Sequence[ev.Event],
) -> None:
    numbers = metrics_of(events)
    assert numbers["pa_console_missions_total{outcome=verified}"] == 1
    assert numbers["pa_console_decision_seconds_count{decision=approve}"] == 1
    assert numbers["pa_console_commands_sent_total{command=move_to}"] == 1
    assert numbers["pa_console_step_seconds_count{step=judge}"] == 1
    assert numbers["pa_console_queue_length{}"] == 0
    assert numbers["pa_console_plan_waits{}"] == 0
    assert numbers["pa_console_worker_ready{}"] == 1


def test_refusals_are_counted_by_rule(refused: Sequence[ev.Event]) -> None:
    numbers = metrics_of(refused)
    assert numbers["pa_console_missions_total{outcome=refused}"] == 1
    assert numbers["pa_console_refusals_total{rule=WF-03}"] >= 1
    assert not [name for name in numbers if name.startswith("pa_console_commands_sent_total")]


def test_alarms_stops_and_the_worker_s_deaths_are_told(events: Sequence[ev.Event]) -> None:
    def happened(*payloads: ev.EventPayload) -> list[ev.Event]:
        return [ev.Event(t=events[0].t, tick=0, data=payload) for payload in payloads]

    ready, dead = ev.WorkerChanged(state="ready"), ev.WorkerChanged(state="dead")
    loading = ev.WorkerChanged(state="loading")
    numbers = metrics_of(happened(loading, ready, dead, loading, ready, ev.AllStopped(by="ann")))
    assert numbers["pa_console_worker_restarts_total{}"] == 1
    assert numbers["pa_console_stopped{}"] == 1
    assert "ann" not in "".join(numbers)


@pytest.mark.parametrize(
    ("path", "host", "code"),
    [
        ("/metrics", "evil.example", 421),
        ("/metrics", "localhost", 421),
        ("/", "", 404),
    ],
)
def test_metrics_answer_to_this_machine_s_own_name_alone(path: str, host: str, code: int) -> None:
    with MetricsServer(CollectorRegistry(), 0) as server:
        assert scraped(server.port, host=f"localhost:{server.port}") == ""
        with pytest.raises(urllib.error.HTTPError) as refused:
            scraped(server.port, path, host)
    assert refused.value.code == code


def test_a_port_that_is_taken_is_named_with_a_remedy() -> None:
    with (
        MetricsServer(CollectorRegistry(), 0) as server,
        pytest.raises(ValueError, match=rf"--metrics-port {server.port}.*choose another port"),
        observed(Observing(metrics_port=server.port), lambda _: None),
    ):
        pass


def test_nothing_observes_where_nothing_was_asked_for() -> None:
    with observed(Observing(), lambda _: None) as observer:
        assert observer is unobserved


class Collector(HTTPServer):
    """Takes what is posted to it, and answers `status`."""

    def __init__(self, status: int) -> None:
        super().__init__(("127.0.0.1", 0), _Posted)
        self.status, self.bodies = status, list[bytes]()


class _Posted(BaseHTTPRequestHandler):
    def do_POST(self) -> None:
        assert isinstance(self.server, Collector)
        self.server.bodies.append(self.rfile.read(int(self.headers["Content-Length"])))
        self.send_response(self.server.status)
        self.send_header("Content-Length", "0")
        self.end_headers()

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        """Print nothing."""


@pytest.fixture
def collector() -> Iterator[Callable[[int], Collector]]:
    """Return what starts a collector that answers with a status."""
    started: list[Collector] = []

    def start(status: int) -> Collector:
        one = Collector(status)
        started.append(one)
        Thread(target=one.serve_forever, daemon=True).start()
        return one

    yield start
    for one in started:
        one.shutdown()
        one.server_close()


def test_a_collector_is_given_the_spans_over_otlp(
    events: Sequence[ev.Event], collector: Callable[[int], Collector]
) -> None:
    takes = collector(200)
    told: list[str] = []
    address = f"http://127.0.0.1:{takes.server_port}"
    with observed(Observing(traces=address), told.append) as observer:
        for event in events:
            observer(event)
    sent = b"".join(takes.bodies)
    for step in ("mission", "retrieve", "safeguards", "decide", "execute", "report"):
        assert step.encode() in sent
    assert b"pa-console" in sent
    assert not re.search(b"(?i)zebra", sent)
    assert told == []


def test_an_unreachable_collector_is_told_of_once_and_holds_nobody_up(
    events: Sequence[ev.Event],
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(span_export, "LEAVE_S", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as deaf:  # takes the connection, says nothing
        address = f"http://127.0.0.1:{deaf.getsockname()[1]}"
        told: list[str] = []
        with observed(Observing(traces=address), told.append) as observer:
            for event in list(events) * 20:
                observer(event)
        assert len(told) == 1
        assert address in told[0]
    assert not [one for one in caplog.records if one.levelno >= logging.WARNING]


def test_an_observer_that_fails_is_left_out_and_the_others_go_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def broken(_self: object, _event: ev.Event) -> None:
        raise RuntimeError("a number too many")

    monkeypatch.setattr(SessionMetrics, "take", broken)
    told: list[str] = []
    event = ev.Event.model_validate_json(
        '{"t": "2026-01-01T00:00:00Z", "tick": 0, "data": {"kind": "worker", "state": "ready"}}'
    )
    with observed(Observing(metrics_port=free_port()), told.append) as observer:
        observer(event)
        observer(event)
    assert told == ["an observer failed and gets no more events: RuntimeError: a number too many"]


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        return taken.getsockname()[1]


def test_a_whole_address_of_a_collector_is_used_as_it_is() -> None:
    with SpanExport("http://127.0.0.1:9/custom", "1", InMemorySpanExporter()) as export:
        assert export.problem == ""
