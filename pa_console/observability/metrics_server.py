"""Gives metrics as Prometheus text at `/metrics`, on this machine alone."""

from collections.abc import Iterable
from functools import partial
from socketserver import TCPServer, ThreadingMixIn
from threading import Thread
from types import TracebackType
from typing import TYPE_CHECKING, Self
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer

from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, generate_latest

if TYPE_CHECKING:
    from wsgiref.types import StartResponse, WSGIApplication, WSGIEnvironment

ADDRESS = "127.0.0.1"
LISTEN_S = 5.0
"""A client that says nothing for so long is left."""
CLOSES_WITHIN_S = 0.1


class MetricsServer:
    """Answers scrapes of `registry` in threads of its own while the context lasts.

    It listens on loopback and answers to no other name: a web page that a browser of this machine
    shows can then read nothing by having its own name lead here.
    """

    def __init__(self, registry: CollectorRegistry, port: int) -> None:
        """`port` 0 takes a free one; raises ValueError when nothing can listen there."""
        try:
            self._server = _Server((ADDRESS, port), _Handler)
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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._server.shutdown()
        self._server.server_close()


class _Server(ThreadingMixIn, WSGIServer):
    daemon_threads = True
    block_on_close = False

    def handle_error(self, request: object, client_address: object) -> None:
        """Say nothing of a client that has gone: the screen belongs to the operator."""

    def server_bind(self) -> None:
        """Bind without looking a name up for the address."""
        TCPServer.server_bind(self)
        self.server_name, self.server_port = ADDRESS, self.socket.getsockname()[1]
        self.setup_environ()


class _Handler(WSGIRequestHandler):
    timeout = LISTEN_S

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the library's name
        """Log no scrape."""


def _answering(registry: CollectorRegistry, port: int) -> "WSGIApplication":
    """Answer whoever reads `/metrics` of this machine by its own name."""
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
