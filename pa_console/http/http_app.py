"""The HTTP interface: every path, its required role, its answers, and its server on loopback."""

import json
from collections.abc import AsyncGenerator, Callable
from contextlib import aclosing, asynccontextmanager
from dataclasses import dataclass
from typing import Annotated, Any, cast

from fastapi import Depends, FastAPI, Header, Path, Query, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response, StreamingResponse
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer
from fastapi_offline import FastAPIOffline
from starlette.exceptions import HTTPException

from pa_console import __version__
from pa_console.fleets.authorization import RefusedError
from pa_console.http import bodies
from pa_console.http.connections import Listening, served_app
from pa_console.http.guard import (
    CONNECTION,
    Guard,
    ProblemDetails,
    ProblemError,
    RequestRate,
    internal_error,
)
from pa_console.http.served_session import NumberedEvent, ServedSession
from pa_console.http.tokens import Bearer, TokenBook, TokenRole
from pa_console.language.orders.order_changes import Change
from pa_console.schema.events import event as ev
from pa_console.views import session_views as views

RATES = {"reads": (50.0, 200), "writes": (5.0, 20), "questions": (2.0, 10), "wrong": (2.0, 20)}
"""The limits of requests, per second and at once: reads, writes and questions of each person, and
wrong tokens of all callers together. A question may need rehearsals."""
MOST_READERS = 8
"""The most event streams that one person may have open."""
ABOUT = """\
The running session of PA Console, for programs of this machine.

Every call needs a bearer token. An observer reads and asks; an operator also gives missions,
decides, stops.
A mission from here goes through the same checks, the same gate and the same signed log as one from
the console. Nothing is approved automatically: a decision names the plan that was shown, and is
made in the name of the person who owns the token. Errors are problem details (RFC 9457).
"""
_bearer = HTTPBearer(auto_error=False, description="made by pa-console serve --make-token ROLE")
_PROBLEMS: dict[int | str, dict[str, Any]] = {
    code: {"model": ProblemDetails, "description": about}
    for code, about in {
        401: "the token is missing or unknown",
        403: "the person may not do this",
        409: "not possible in the current state of the session",
        422: "a field is not valid",
        429: "too many requests",
    }.items()
}


Given = Annotated[HTTPAuthorizationCredentials | None, Depends(_bearer)]


class _Doors:
    """The admission of requests by their tokens, within the limits of their rate."""

    def __init__(self, tokens: TokenBook) -> None:
        self._tokens = tokens
        self._rates = {name: RequestRate(*limit) for name, limit in RATES.items()}

    def enter(self, given: Given, role: TokenRole, rate: str = "") -> Bearer:
        """Return the bearer of `given`, within the limit of `rate` if one is named.

        Raises ProblemError for an unknown token, and for one without the rights of `role`.
        """
        bearer = self._known(given)
        if not bearer.may(role):
            raise ProblemError(
                403, "role-too-low", f"{bearer.person} is {bearer.role}; this needs {role}",
                remedy="use a token of that role",
            )  # fmt: skip
        return self._count(rate, bearer) if rate else bearer

    def lets_read(self, given: Given) -> bool:
        """Return whether a token may still read."""
        try:
            self.enter(given, "observer")
        except ProblemError:
            return False
        return True

    def _known(self, given: HTTPAuthorizationCredentials | None) -> Bearer:
        bearer = None
        try:
            if given is not None:
                bearer = self._tokens.find(given.credentials)
        except RefusedError as error:
            raise ProblemError(403, "not-in-the-roster", str(error)) from error
        except (ValueError, OSError) as error:
            raise ProblemError(401, "no-tokens", str(error)) from error
        if bearer is None:
            self._count("wrong", Bearer("", "observer"))
            raise ProblemError(
                401, "no-token", "this needs a token of this session", field="Authorization",
                remedy="Authorization: Bearer TOKEN; pa-console serve --make-token ROLE makes one",
            )  # fmt: skip
        return bearer

    def _count(self, rate: str, bearer: Bearer) -> Bearer:
        if after_s := self._rates[rate].take(bearer.person):
            raise ProblemError(429, "too-often", "there were too many requests",
                               remedy=f"wait {after_s} s", after_s=after_s)  # fmt: skip
        return bearer


def _doors(request: Request) -> _Doors:
    return cast(_Doors, request.app.state.doors)


def _lets_in(role: TokenRole, rate: str = "") -> Callable[[Request, Given], Bearer]:
    """Return a dependency that admits `role`, and records the rank on the connection."""

    def bearer_of(request: Request, given: Given) -> Bearer:
        bearer = _doors(request).enter(given, role, rate)
        if CONNECTION in request.scope:
            request.scope[CONNECTION].let_in(commands=bearer.may("operator"))
        return bearer

    return bearer_of


Watching = Annotated[Bearer, Depends(_lets_in("observer", "reads"))]
Asking = Annotated[Bearer, Depends(_lets_in("observer", "questions"))]
Commanding = Annotated[Bearer, Depends(_lets_in("operator", "writes"))]
Stopping = Annotated[Bearer, Depends(_lets_in("operator"))]
"""The bearer of a request, with the right to read, to ask, to command, or to stop everything."""


def make_app(
    session: ServedSession, tokens: TokenBook, failed: Callable[[Exception], None]
) -> FastAPI:
    """Return the interface to `session` for the holders of `tokens`.

    `failed` is called with a defect. Requests must pass the Guard first.
    """
    app = FastAPIOffline(
        title="PA Console",
        version=__version__,
        description=ABOUT,
        redoc_url=None,
        responses=_PROBLEMS,
        swagger_ui_parameters={"tryItOutEnabled": True},
    )
    app.state.doors = _Doors(tokens)
    _add_reads(app, session)
    _add_stills(app, session)
    _add_events(app, session)
    _add_commands(app, session)
    _add_problems(app, failed)
    return app


def _add_reads(app: FastAPI, session: ServedSession) -> None:
    """Add the paths on which an observer reads and asks."""

    @app.get("/v1/whoami", tags=["session"])
    async def whoami(who: Watching) -> bodies.WhoView:
        """Return the owner of the token."""
        return bodies.WhoView(person=who.person, role=who.role)

    @app.get("/v1/state", tags=["session"])
    async def state(_: Watching) -> views.StateView:
        """Return the present state of the session: picture, alarms, queue, stop, waiting plan."""
        return views.state_view(session.state, session.feed.number)

    @app.get("/v1/rules", tags=["session"])
    async def rules(_: Watching) -> views.RulesView:
        """Return the rules in force."""
        book = session.station.rulebook
        return views.RulesView(name=book.name, sha256=book.sha256, seal=book.seal, rules=book.rules)

    @app.get("/v1/missions", tags=["missions"])
    async def missions(_: Watching) -> list[views.MissionView]:
        """List the missions of the session, oldest first."""
        return [views.mission_view(trace) for trace in session.state.missions.values()]

    @app.get("/v1/missions/{id}", tags=["missions"], responses={404: {"model": ProblemDetails}})
    async def mission(_: Watching, name: Annotated[str, Path(alias="id")]) -> views.MissionDetail:
        """Return a mission with all its plans and the findings on each."""
        return views.mission_detail(session.mission(name))

    @app.get("/v1/plans", tags=["plans"])
    async def plans(_: Watching) -> list[views.PlanView]:
        """Return the plan that waits for a decision, with its SHA-256, or an empty list."""
        waiting = session.waiting
        return [views.plan_view(*waiting)] if waiting is not None else []

    @app.get("/v1/plans/{request_id}/approval", tags=["plans"])
    async def approval(
        who: Watching,
        request_id: Annotated[str, Path()],
        person: Annotated[
            str | None, Query(description="the person who signs; by default, the token's")
        ] = None,
    ) -> bodies.ToSignView:
        """Return exactly what a second person signs, if the rules require two people for the plan.

        `to_sign` is the exact text, in ASCII. `pa-console keys sign` signs it on the person's own
        machine, and so can any program with Ed25519.
        """
        return session.to_sign(request_id, person or who.person)

    @app.post("/v1/questions", tags=["session"])
    async def ask(_: Asking, body: bodies.QuestionBody) -> ev.QuestionAnswered:
        """Answer a question such as *Why?* or *Why not Robot_T02?* from the record.

        The answer is about the waiting plan or, if no plan waits, the active or last mission. No
        model is asked, and nothing is decided. The answer is logged.

        Any other text is refused and does not become a mission.
        """
        return await session.answer(body.text)


def _add_stills(app: FastAPI, session: ServedSession) -> None:
    """Add the paths of camera stills."""
    missing: dict[int | str, dict[str, Any]] = {
        404: {"model": ProblemDetails},
        200: {"content": {"image/png": {}, "image/jpeg": {}}},
    }

    @app.get("/v1/tracks/{id}/still", tags=["session"], response_class=Response, responses=missing)
    async def still(_: Asking, name: Annotated[str, Path(alias="id")]) -> Response:
        """Return a still of a track that a camera takes now: PNG or JPEG.

        It is logged and kept like one that is shown to the operator. The status is 409 if no camera
        has the track in view, or if the camera returns no image.
        """
        return _file(session, await session.still_of(name))

    @app.get("/v1/stills/{sha256}", tags=["session"], response_class=Response, responses=missing)
    async def kept(_: Watching, sha256: Annotated[str, Path()]) -> Response:
        """Return a still that was shown in this session, by its SHA-256."""
        return _file(session, session.still(sha256))


def _file(session: ServedSession, still: ev.CameraStill) -> Response:
    headers = {"ETag": f'"{still.sha256}"', "X-Content-Type-Options": "nosniff"}
    kind = "image/png" if still.format == "png" else "image/jpeg"
    return Response(session.file_of(still), media_type=kind, headers=headers)


def _add_events(app: FastAPI, session: ServedSession) -> None:
    """Add the event stream."""
    readers: dict[str, int] = {}

    @app.get(
        "/v1/events",
        tags=["session"],
        response_class=StreamingResponse,
        responses={200: {"content": {"text/event-stream": {}}}},
    )
    async def events(
        request: Request,
        given: Given,
        who: Watching,
        kind: Annotated[
            list[str] | None, Query(description="only these kinds, such as mission_finished")
        ] = None,
        last_event_id: Annotated[
            str | None, Header(description="continue after this event: SESSION.NUMBER")
        ] = None,
    ) -> StreamingResponse:
        """Stream the logged events of the session as server-sent events.

        Each event has an id. A client that reconnects with it as `Last-Event-ID` misses nothing.
        Without an id, the stream begins with the next event.
        """
        if readers.get(who.person, 0) >= MOST_READERS:
            raise ProblemError(429, "too-many-streams", f"{MOST_READERS} streams are open already",
                               remedy="close one", after_s=10)  # fmt: skip
        doors, after = _doors(request), _number(session, last_event_id)
        reader = _StreamReader(who.person, frozenset(kind or ()), lambda: doors.lets_read(given))
        return StreamingResponse(
            _stream(session, after, reader, readers), media_type="text/event-stream"
        )


def _add_commands(app: FastAPI, session: ServedSession) -> None:
    """Add the paths of an operator."""

    @app.post("/v1/missions", tags=["missions"], status_code=201)
    async def submit(_: Commanding, body: bodies.MissionBody) -> views.MissionView:
        """Submit a mission in plain language; it is queued, and its plan waits for a decision."""
        return views.mission_view(session.submit(body.text))

    @app.post("/v1/missions/{id}/cancel", tags=["missions"], status_code=204)
    async def cancel(_: Commanding, name: Annotated[str, Path(alias="id")]) -> None:
        """Cancel a mission: its moving assets go to safety; a waiting one leaves the queue."""
        session.cancel(name)

    @app.post("/v1/decisions", tags=["plans"])
    async def decide(who: Commanding, body: bodies.DecisionBody) -> bodies.DecisionView:
        """Decide on the plan that was shown, in the name of the token's person.

        The status is 409 if another plan waits by now, or if this plan differs from the one shown.
        """
        return await session.decide(who, body)

    @app.post("/v1/plans/{request_id}/signatures", tags=["plans"])
    async def countersign(
        _: Commanding, request_id: Annotated[str, Path()], body: bodies.SignatureBody
    ) -> bodies.DecisionView:
        """Accept a second person's signature on the waiting plan.

        It counts once, for this plan only, and for the person whose key made it, no matter who
        submits it. `accepted` is false while an approval is missing; `detail` names the person.
        """
        return await session.countersign(request_id, body)

    @app.post(
        "/v1/alarms/{id}/acknowledge",
        tags=["alarms"],
        status_code=204,
        responses={404: {"model": ProblemDetails}},
    )
    async def acknowledge(who: Commanding, name: Annotated[str, Path(alias="id")]) -> None:
        """Record that the token's person has seen an alarm, which stays open until it clears."""
        session.acknowledge(who, name)

    @app.post(
        "/v1/standing/{id}/{change}",
        tags=["missions"],
        status_code=204,
        responses={404: {"model": ProblemDetails}},
    )
    async def change_standing(
        who: Commanding, name: Annotated[str, Path(alias="id")], change: Change
    ) -> None:
        """Revoke, pause or resume a standing order, or skip its next scheduled time."""
        session.change_standing(who, name, change)

    @app.post(
        "/v1/assets/{id}/manual",
        tags=["assets"],
        status_code=204,
        responses={404: {"model": ProblemDetails}},
    )
    async def take_manual(who: Commanding, name: Annotated[str, Path(alias="id")]) -> None:
        """Take manual control of an asset: only the hold of a stop is still sent to it."""
        session.change_manual(who, name, take=True)

    @app.delete(
        "/v1/assets/{id}/manual",
        tags=["assets"],
        status_code=204,
        responses={404: {"model": ProblemDetails}},
    )
    async def end_manual(who: Commanding, name: Annotated[str, Path(alias="id")]) -> None:
        """Give an asset back; missions that awaited it are queued, and each needs approval."""
        session.change_manual(who, name, take=False)

    @app.post("/v1/stop", tags=["stop"], status_code=204)
    async def stop(who: Stopping) -> None:
        """Stop all assets; the request needs no body and has no rate limit."""
        session.stop_all(who)

    @app.post("/v1/release", tags=["stop"], status_code=204)
    async def release(who: Commanding) -> None:
        """Release the stop, which moves no asset."""
        session.release(who)


def _add_problems(app: FastAPI, failed: Callable[[Exception], None]) -> None:
    """Turn every error into problem details."""

    @app.exception_handler(ProblemError)
    async def problem(_: Request, error: Exception) -> JSONResponse:
        return cast(ProblemError, error).response()

    @app.exception_handler(RequestValidationError)
    async def invalid(_: Request, error: Exception) -> JSONResponse:
        first = cast(RequestValidationError, error).errors()[0]
        place = [str(part) for part in first["loc"] if part not in ("body", "query", "path")]
        return ProblemError(
            422, "not-valid", str(first["msg"]).removeprefix("Value error, "),
            field=".".join(place), remedy="/docs lists the fields of every request",
        ).response()  # fmt: skip

    @app.exception_handler(HTTPException)
    async def refused(_: Request, error: Exception) -> JSONResponse:
        cause = error.__cause__
        if isinstance(cause, ProblemError):
            return cause.response()
        refused = cast(HTTPException, error)
        if refused.status_code == 400:
            return ProblemError(
                422, "not-valid", "the body cannot be read", field="body",
                remedy="send JSON in UTF-8; /docs lists its fields",
            ).response()  # fmt: skip
        kind = {404: "no-such-path", 405: "no-such-method"}.get(refused.status_code, "refused")
        return ProblemError(
            refused.status_code, kind, str(refused.detail), remedy="/docs lists every path"
        ).response()

    @app.exception_handler(Exception)
    async def broken(_: Request, error: Exception) -> JSONResponse:
        failed(error)
        return internal_error().response()


def _number(session: ServedSession, last: str | None) -> int:
    """Return the number of the event after which the stream continues."""
    if last is None:
        return session.feed.number
    started = session.state.started
    name, _, number = last.rpartition(".")
    if not number.isdecimal() or len(number) > 12:
        raise ProblemError(422, "not-valid", f"{last!r} is not the id of an event",
                           field="Last-Event-ID", remedy="leave it out")  # fmt: skip
    if started is None or name != started.session:
        raise ProblemError(410, "another-session", f"the session {name!r} is not this one",
                           field="Last-Event-ID", remedy="leave it out to begin anew")  # fmt: skip
    return int(number)


@dataclass(frozen=True)
class _StreamReader:
    """The reader of an event stream; empty `kinds` mean all, `let_in` returns its right to read."""

    person: str
    kinds: frozenset[str]
    let_in: Callable[[], bool]


async def _stream(
    session: ServedSession, after: int, reader: _StreamReader, readers: dict[str, int]
) -> AsyncGenerator[str]:
    """Yield events as text, and a comment from time to time while there are none.

    The stream ends with the session, and as soon as its token is no longer valid.
    """
    readers[reader.person] = readers.get(reader.person, 0) + 1
    try:
        yield ": the session's events\n\n"
        async with aclosing(session.feed.follow(after)) as items:
            async for item in items:
                if not reader.let_in():
                    return
                if item is None:
                    yield ": still here\n\n"
                elif not reader.kinds or item.event.data.kind in reader.kinds:
                    yield _sent(session, item)
    finally:
        readers[reader.person] -= 1


def _sent(session: ServedSession, item: NumberedEvent) -> str:
    event: ev.Event = item.event
    started = session.state.started
    data = json.dumps(event.model_dump(mode="json"), ensure_ascii=False)
    name = started.session if started is not None else ""
    return f"id: {name}.{item.number}\nevent: {event.data.kind}\ndata: {data}\n\n"


@asynccontextmanager
async def serving(
    session: ServedSession,
    tokens: TokenBook,
    listening: Listening,
    failed: Callable[[Exception], None],
) -> AsyncGenerator[str]:
    """Serve `session` on the socket while the context lasts; yield the address.

    When the context ends, event streams end, and no more requests are answered. `failed` is called
    with a defect, and once if descriptors run out.
    """
    listening.failed = failed
    app = Guard(make_app(session, tokens, failed), listening, failed)
    async with served_app(app, listening) as address:
        try:
            yield address
        finally:
            session.end()
