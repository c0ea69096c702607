"""Metrics of a session, folded from its events, and the server from which Prometheus reads them."""

from collections import Counter as Counts
from collections.abc import Iterable
from datetime import datetime
from functools import partial
from socketserver import TCPServer, ThreadingMixIn
from threading import Thread
from typing import TYPE_CHECKING, Self
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer

from prometheus_client import (
    CONTENT_TYPE_LATEST,
    CollectorRegistry,
    Counter,
    Gauge,
    Histogram,
    generate_latest,
)

from pa_console.observability.mission_spans import Step
from pa_console.schema.base import ALARM_PRIORITIES
from pa_console.schema.events import event as ev

if TYPE_CHECKING:
    from wsgiref.types import StartResponse, WSGIApplication, WSGIEnvironment

DECISION_S = (1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0)
"""The buckets for a person's decision time, in seconds."""
STEP_S = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0, 60.0)
"""The buckets for the duration of a step, in seconds."""
READY = ("ready", "unconfined", "slow")
"""The states of a worker that is ready to answer."""
ADDRESS = "127.0.0.1"
LISTEN_S = 5.0
"""The longest wait for a client's request, in seconds."""
CLOSES_WITHIN_S = 0.1


class SessionMetrics:
    """The metrics of one session, in a separate `registry`; call `take` with every event.

    Labels are rules, kinds and outcomes, never texts of operators, so their number is bounded.
    """

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        counter = partial(Counter, registry=self.registry)
        gauge = partial(Gauge, registry=self.registry)
        histogram = partial(Histogram, registry=self.registry)
        self._missions = counter(
            "pa_console_missions", "Missions that ended, by outcome.", ["outcome"]
        )
        self._decisions = histogram(
            "pa_console_decision_seconds",
            "Seconds from showing a plan to the accepted decision on it.",
            ["decision"],
            buckets=DECISION_S,
        )
        self._steps = histogram(
            "pa_console_step_seconds",
            "Seconds that a step of a mission took.",
            ["step"],
            buckets=STEP_S,
        )
        self._refusals = counter(
            "pa_console_refusals",
            "Times that a rule blocked the approval of a plan, or a mission before planning.",
            ["rule"],
        )
        self._kept_back = counter(
            "pa_console_commands_refused", "Commands refused at the command gate."
        )
        self._sent = counter("pa_console_commands_sent", "Commands sent to assets.", ["command"])
        self._queue = gauge("pa_console_queue_length", "Waiting missions.")
        self._alarms = counter("pa_console_alarms", "Alarms that were raised.", ["kind"])
        self._open = gauge("pa_console_open_alarms", "Open alarms.", ["priority"])
        self._stopped = gauge("pa_console_stopped", "1 while all assets are stopped.")
        self._waits = gauge("pa_console_plan_waits", "1 while a plan waits for a decision.")
        self._ready = gauge("pa_console_worker_ready", "1 while the model's worker is ready.")
        self._restarts = counter(
            "pa_console_worker_restarts", "Times the worker was started again."
        )
        self._unlogged = gauge("pa_console_log_troubled", "1 while the log cannot be written.")
        self._raised: dict[str, str] = {}
        self._asked: dict[str, datetime] = {}
        self._died = False
        for priority in ALARM_PRIORITIES:
            self._open.labels(priority).set(0)

    def take(self, event: ev.Event) -> None:
        """Process one event."""
        self._take_session(event.data)
        self._take_alarm(event.data)
        self._take_step(event.data)
        if event.mission is not None:
            self._take_mission(event.mission, event)

    def _take_session(self, data: ev.EventPayload) -> None:
        match data:
            case ev.QueueChanged(entries=entries):
                self._queue.set(len(entries))
            case ev.AllStopped():
                self._stopped.set(1)
            case ev.StopReleased():
                self._stopped.set(0)
            case ev.LogTroubled(problem=problem):
                self._unlogged.set(bool(problem))
            case ev.WorkerChanged(state=state):
                if state in READY:
                    self._restarts.inc(self._died)
                self._died = state == "dead" or (self._died and state == "loading")
                self._ready.set(state in READY)
            case ev.CommandSent(command=command):
                self._sent.labels(command.verb).inc()
            case ev.CommandRefused():
                self._kept_back.inc()
            case _:
                pass

    def _take_alarm(self, data: ev.EventPayload) -> None:
        match data:
            case ev.AlarmRaised(alarm=alarm):
                if alarm.id not in self._raised:
                    self._alarms.labels(alarm.kind).inc()
                self._raised[alarm.id] = alarm.priority
            case ev.AlarmCleared(alarm_id=name):
                self._raised.pop(name, None)
            case _:
                return
        counted = Counts(self._raised.values())
        for priority in ALARM_PRIORITIES:
            self._open.labels(priority).set(counted[priority])

    def _take_step(self, data: ev.EventPayload) -> None:
        if (taken := _taken(data)) is not None:
            step, seconds = taken
            self._steps.labels(step).observe(seconds)

    def _take_mission(self, name: str, event: ev.Event) -> None:
        match event.data:
            case ev.PlanChecked(findings=findings):
                for finding in findings:
                    if finding.blocking:
                        self._refusals.labels(finding.rule_id).inc()
            case ev.ApprovalRequested():
                self._asked[name] = event.t
            case ev.DecisionMade(accepted=True, decision=decision):
                since = self._asked.pop(name, None)
                if since is not None:
                    seconds = max(0.0, (event.t - since).total_seconds())
                    self._decisions.labels(decision.kind).observe(seconds)
            case ev.MissionPreempted() | ev.PlanVoided():
                self._asked.pop(name, None)
            case ev.MissionFinished(status=status):
                self._missions.labels(status).inc()
                self._asked.pop(name, None)
            case _:
                return
        self._waits.set(bool(self._asked))


def _taken(data: ev.EventPayload) -> tuple[Step, float] | None:
    """Return the step that `data` ends, and its duration in seconds; None for other events."""
    taken: tuple[Step, float] | None = None
    match data:
        case ev.RulesRetrieved(seconds=seconds):
            taken = "retrieve", seconds
        case ev.PictureDigested(seconds=seconds):
            taken = "picture", seconds
        case ev.PromptBuilt(seconds=seconds):
            taken = "prompt", seconds
        case ev.PlanProposed(usage=usage, author="planner"):
            taken = "plan", usage.seconds
        case ev.PlanRehearsed(seconds=seconds):
            taken = "rehearse", seconds
        case ev.PlanChecked(seconds=seconds):
            taken = "safeguards", seconds
        case ev.PlanJudged(usage=usage):
            taken = "judge", usage.seconds
        case ev.OrderReadAgain(usage=usage):
            taken = "read_again", usage.seconds
        case ev.MissionVerified(seconds=seconds):
            taken = "verify", seconds
        case ev.OutcomeJudged(usage=usage):
            taken = "outcome", usage.seconds
        case _:
            pass
    return taken


class MetricsServer:
    """A server of `registry` as Prometheus text at `/metrics`, for this machine only.

    It listens on loopback and answers only requests to loopback's names, so that a web page whose
    host name resolves to this machine cannot read the metrics.
    """

    def __init__(self, registry: CollectorRegistry, port: int) -> None:
        """Listen on `port`, 0 for a free one; raise ValueError if the port cannot be used."""
        try:
            self._server = _MetricsServer((ADDRESS, port), _Handler)
        except OSError as error:
            why = error.strerror or error
            raise ValueError(
                f"--metrics-port {port}: {ADDRESS} cannot be listened on there: {why}; "
                "choose another port"
            ) from error
        self.port = self._server.server_port
        self._server.set_app(_answering(registry, self.port))
        serve = partial(self._server.serve_forever, poll_interval=CLOSES_WITHIN_S)
        self._thread = Thread(target=serve, name="metrics", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._server.shutdown()
        self._server.server_close()


class _MetricsServer(ThreadingMixIn, WSGIServer):
    daemon_threads = True
    block_on_close = False

    def handle_error(self, request: object, client_address: object) -> None:
        """Ignore a lost client, because no message may disturb the operator's screen."""

    def server_bind(self) -> None:
        """Bind without a name lookup for the address."""
        TCPServer.server_bind(self)
        self.server_name, self.server_port = ADDRESS, self.socket.getsockname()[1]
        self.setup_environ()


class _Handler(WSGIRequestHandler):
    timeout = LISTEN_S

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the library's name
        """Do not log a scrape."""


def _answering(registry: CollectorRegistry, port: int) -> "WSGIApplication":
    """Return the application that answers `/metrics` for requests to loopback's names."""
    names = {f"{name}:{port}" for name in (ADDRESS, "localhost")}

    def answer(environ: "WSGIEnvironment", start: "StartResponse") -> Iterable[bytes]:
        status, kind, body = "200 OK", CONTENT_TYPE_LATEST, b""
        if environ.get("HTTP_HOST", "").lower() not in names:
            status, body = "421 Misdirected Request", f"http://{ADDRESS}:{port}/metrics\n".encode()
        elif environ.get("PATH_INFO") != "/metrics":
            status, body = "404 Not Found", b"there is only /metrics\n"
        elif environ.get("REQUEST_METHOD") not in ("GET", "HEAD"):
            status, body = "405 Method Not Allowed", b"metrics are only read\n"
        else:
            body = generate_latest(registry)
        start(status, [("Content-Type", kind if status == "200 OK" else "text/plain")])
        return [body]

    return answer
