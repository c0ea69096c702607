"""The outermost guard of every request: its source, its host name, its size and its rate.

A refused request is answered with problem details (RFC 9457) that name the field and the remedy. An
internal error becomes a problem without a traceback.
"""

import asyncio
from collections import OrderedDict
from collections.abc import Callable
from ipaddress import ip_address
from math import ceil
from time import monotonic
from typing import Annotated

from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pa_console.http.connections import Listening

MEDIA_TYPE = "application/problem+json"
MOST_BUCKETS = 1024
CONNECTION = "pa_console.connection"
"""The key of a request's `Connection` in its scope."""
MOST_BYTES = 65_536
"""The longest body of a request, in bytes."""
BODY_S = 10.0
"""The time in which a body must arrive, in seconds."""
NAMES = ("127.0.0.1", "localhost", "[::1]")
HEADERS = (
    (b"cache-control", b"no-store"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"same-origin"),
    (b"x-frame-options", b"DENY"),
    (
        b"content-security-policy",
        b"default-src 'self'; img-src 'self' data:; style-src 'self' 'unsafe-inline'; "
        b"script-src 'self' 'unsafe-inline'; frame-ancestors 'none'; form-action 'self'",
    ),
)


class ProblemDetails(BaseModel):
    """The reason why a request was refused."""

    type: Annotated[str, Field(description="the kind of problem, urn:pa-console:...")]
    title: str
    status: int
    detail: str
    field: Annotated[str, Field(description="the wrong part of the request; '' for all of it")] = ""
    remedy: Annotated[str, Field(description="the remedy")] = ""


class ProblemError(Exception):
    """A refused request; `kind` is the end of its type, `after_s` the wait before another try."""

    def __init__(
        self,
        status: int,
        kind: str,
        detail: str,
        *,
        field: str = "",
        remedy: str = "",
        after_s: int = 0,
    ) -> None:
        super().__init__(detail)
        self.details = ProblemDetails(
            type=f"urn:pa-console:problem:{kind}",
            title=kind.replace("-", " ").capitalize(),
            status=status,
            detail=detail,
            field=field,
            remedy=remedy,
        )
        self.headers: dict[str, str] = {}
        if status == 401:
            self.headers["WWW-Authenticate"] = 'Bearer realm="pa-console"'
        if after_s:
            self.headers["Retry-After"] = str(after_s)

    def response(self) -> JSONResponse:
        """Return the response for the client."""
        return JSONResponse(
            self.details.model_dump(),
            status_code=self.details.status,
            media_type=MEDIA_TYPE,
            headers=self.headers,
        )


def internal_error() -> ProblemError:
    """Return the response for an internal defect, without its details."""
    return ProblemError(
        500,
        "internal-error",
        "the program has a defect; as far as is known, this request has changed nothing",
        remedy="look at /v1/state before you go on; STOP works as before",
    )


class RequestRate:
    """A limit of requests: each name may make `burst` at once, and then `per_s` each second."""

    def __init__(self, per_s: float, burst: int, clock: Callable[[], float] = monotonic) -> None:
        self._per_s, self._burst, self._clock = per_s, burst, clock
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def take(self, name: str) -> int:
        """Count one request of `name`; return 0, or the wait in seconds if there are too many."""
        now = self._clock()
        left, since = self._buckets.pop(name, (float(self._burst), now))
        left = min(self._burst, left + (now - since) * self._per_s)
        wait = 0 if left >= 1.0 else ceil((1.0 - left) / self._per_s)
        self._buckets[name] = (left - 1.0 if left >= 1.0 else left, now)
        while len(self._buckets) > MOST_BUCKETS:
            self._buckets.popitem(last=False)
        return wait


class Guard:
    """An ASGI wrapper that passes to `app` only requests from loopback to a name of this machine.

    The name must have the port of the socket. This refuses a page of another site whose name
    resolves to this machine, and requests that a browser sends for a page of another site. `failed`
    is called with a defect.
    """

    def __init__(
        self, app: ASGIApp, listening: Listening, failed: Callable[[Exception], None]
    ) -> None:
        self._app, self._listening, self._failed = app, listening, failed
        port: int = listening.getsockname()[1]
        self._hosts = {f"{name}:{port}" for name in NAMES}
        self._origins = {f"http://{host}" for host in self._hosts}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":
            return
        answer = _GuardedResponse(send)
        with self._listening.request(scope["client"]) as scope[CONNECTION]:
            try:
                self._admit(scope)
                await self._app(scope, _Body(scope, receive), answer)
            except ProblemError as problem:
                await self._tell(problem, scope, receive, answer)
            except Exception as error:
                self._failed(error)
                await self._tell(internal_error(), scope, receive, answer)

    def _admit(self, scope: Scope) -> None:
        client = scope.get("client")
        if client is None or not ip_address(client[0]).is_loopback:
            raise ProblemError(403, "not-from-here", "only this machine is let in",
                               remedy="use an SSH tunnel: ssh -L")  # fmt: skip
        headers = scope["headers"]
        hosts = [value.decode("latin-1").lower() for name, value in headers if name == b"host"]
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            raise ProblemError(421, "wrong-host", "the request is for another name", field="Host",
                               remedy=f"ask {min(self._hosts)}")  # fmt: skip
        origins = [value.decode("latin-1").lower() for name, value in headers if name == b"origin"]
        if any(origin not in self._origins for origin in origins):
            raise ProblemError(403, "wrong-origin", "a page of another site may not send requests",
                               field="Origin")  # fmt: skip

    async def _tell(
        self, problem: ProblemError, scope: Scope, receive: Receive, answer: "_GuardedResponse"
    ) -> None:
        if not answer.begun:
            await problem.response()(scope, receive, answer)


class _GuardedResponse:
    """A response with the headers that every response has."""

    def __init__(self, send: Send) -> None:
        self._send, self.begun = send, False

    async def __call__(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            self.begun = True
            own = {name for name, _ in message["headers"]}
            more = [header for header in HEADERS if header[0] not in own]
            message = {**message, "headers": [*message["headers"], *more]}
        await self._send(message)


class _Body:
    """A request body that is neither too long nor too slow."""

    def __init__(self, scope: Scope, receive: Receive) -> None:
        self._receive, self._left, self._whole = receive, MOST_BYTES, False
        for name, value in scope["headers"]:
            if name == b"content-length" and (not value.isdigit() or int(value) > MOST_BYTES):
                raise _too_large()
        self._until = asyncio.get_running_loop().time() + BODY_S

    async def __call__(self) -> Message:
        if self._whole:
            return await self._receive()
        try:
            async with asyncio.timeout_at(self._until):
                message = await self._receive()
        except TimeoutError as error:
            raise ProblemError(408, "too-slow", f"no complete body within {BODY_S:g} s") from error
        if message["type"] == "http.request":
            self._left -= len(message.get("body", b""))
            self._whole = not message.get("more_body", False)
            if self._left < 0:
                raise _too_large()
        return message


def _too_large() -> ProblemError:
    return ProblemError(413, "too-large", f"a body has at most {MOST_BYTES} bytes",
                        field="body", remedy="send less")  # fmt: skip
