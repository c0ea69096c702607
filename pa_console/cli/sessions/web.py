"""The console in a browser: `textual-serve` with tokens, on loopback, for one browser at a time.

Each console in a browser opens a session, so only one console is open at a time. A second browser
has to wait, except that an operator's browser replaces an observer's.
"""

import asyncio
import logging
import secrets
import shlex
import signal
from collections.abc import Sequence
from contextlib import suppress
from html import escape
from ipaddress import ip_address
from typing import Any

from aiohttp import web
from aiohttp.typedefs import Handler
from textual_serve.app_service import AppService
from textual_serve.server import Server, to_int

from pa_console.child_processes import OWN_FOLDER
from pa_console.cli.sessions.tokens import offer_token, token_book
from pa_console.end_signals import end_signals, exit_code_of
from pa_console.fleets.authorization import RefusedError
from pa_console.http.connections import ADDRESS, QUEUED, Listening, listen
from pa_console.http.guard import BODY_S, MOST_BYTES, NAMES, RequestRate
from pa_console.http.tokens import Bearer, TokenBook
from pa_console.terminal.output import errors, out

COOKIE = "pa-console-{port}"
"""The name of a browser's cookie, which includes the port.

A browser sends its cookies to every port of an address, so the name must differ for each port.
"""
LOOK_S = 5.0
"""The time in seconds between two checks of the token of an open console."""
CLOSE_S = 1.0
"""The longest wait for a browser to confirm that its window is closed, in seconds."""
LEAVE_S = 20.0
"""The longest wait for a console to bring its assets to safety and close its log, in seconds."""
WRONG = (0.5, 10)
"""The limits on wrong tokens: the number per second, and the number at once."""
HEADERS = {
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",
    "X-Frame-Options": "DENY",
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data: blob:; "
    "style-src 'self' 'unsafe-inline'; script-src 'self' 'unsafe-inline'; connect-src 'self' ws:; "
    "frame-ancestors 'none'; form-action 'self'; base-uri 'none'",
}
PAGE = """\
<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>PA Console</title>
<style>body{background:#0c181f;color:#eee;font:16px monospace;margin:20vh auto;width:36em}
input,button{font:inherit;padding:.4em;width:100%;box-sizing:border-box;margin:.4em 0}</style>
</head><body><h1>PA Console</h1><form method="post" action="/login">
<label for="token">Your token (pa-console serve --make-token ROLE makes one)</label>
<input id="token" name="token" type="password" autocomplete="off" autofocus required>
<button>Open the console</button></form><p role="alert">PROBLEM</p></body></html>"""


def serve_console(command: Sequence[str], port: int) -> int:
    """Serve the console that `command` opens until Ctrl-C or SIGTERM; return the exit code.

    Raises ValueError if the port cannot be used.
    """
    for library in ("textual-serve", "aiohttp"):  # these would write tracebacks to the terminal
        logging.getLogger(library).addHandler(logging.NullHandler())
        logging.getLogger(library).propagate = False
    with listen(port) as listening:
        listening.failed = _report
        served = ServedConsole(command, token_book(), listening)
        return asyncio.run(served.until_ended())


class ServedConsole(Server):
    """The server of one console at a time, for browsers with a token."""

    def __init__(self, command: Sequence[str], tokens: TokenBook, listening: Listening) -> None:
        port: int = listening.getsockname()[1]
        super().__init__("", ADDRESS, port, "PA Console", f"http://{ADDRESS}:{port}")
        self._commands = {True: _in_shell(command), False: _in_shell([*command, "--readonly"])}
        self._listening, self._tokens, self._wrong = listening, tokens, RequestRate(*WRONG)
        self._hosts = {f"{name}:{port}" for name in NAMES}
        self._cookie = COOKIE.format(port=port)
        self._let_in: dict[str, str] = {}
        """The token of each admitted browser, by its cookie."""
        self._open: asyncio.Task[Any] | None = None
        self._watched = False
        """True if the open console belongs to an observer."""
        self.begun = asyncio.Event()
        """An event that is set once the server listens and handles signals."""
        self._left = asyncio.Event()

    async def until_ended(self) -> int:
        """Serve until a signal, then end the open console properly; return the exit code."""
        app = await self._make_app()
        app.middlewares.append(self._guard)
        app.add_routes([web.get("/login", self._ask), web.post("/login", self._login)])
        app.on_response_prepare.append(_with_headers)
        runner = web.AppRunner(app, access_log=None, shutdown_timeout=0.5)
        await runner.setup()
        await web.SockSite(runner, self._listening, backlog=QUEUED).start()
        loop, over, ended_by = asyncio.get_running_loop(), asyncio.Event(), list[int]()

        def end(number: int) -> None:
            ended_by.append(number)
            loop.call_soon_threadsafe(over.set)

        loop.add_signal_handler(signal.SIGINT, over.set)
        with end_signals(end):
            self._greet()
            self.begun.set()
            await over.wait()
            await self._close_window()
            await runner.cleanup()
        loop.remove_signal_handler(signal.SIGINT)
        return exit_code_of(ended_by[0]) if ended_by else 0

    def _greet(self) -> None:
        out.print_line(self.public_url)
        offer_token(self._tokens, "run")
        errors.print("Ctrl-C closes the open console and stops the server.")

    async def on_startup(self, app: web.Application) -> None:
        """Do nothing, in place of the library's banner."""

    @web.middleware
    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Answer a request if it is admitted, and set the rank of its connection."""
        address = request.transport.get_extra_info("peername") if request.transport else None
        with self._listening.request(address) as connection:
            self._admit(request)
            bearer = self._bearer(request)
            if bearer is not None:
                connection.let_in(commands=bearer.may("operator"))
            elif request.path != "/login":
                raise web.HTTPSeeOther("/login") if request.path == "/" else web.HTTPUnauthorized()
            return await handler(request)

    def _admit(self, request: web.Request) -> None:
        """Refuse requests from other machines, to other hosts, or from pages of other sites."""
        if request.remote is None or not ip_address(request.remote).is_loopback:
            raise web.HTTPForbidden(text="only connections from this machine are accepted")
        if request.headers.getall("Host", []) != [request.host] or (
            request.host.lower() not in self._hosts
        ):
            raise web.HTTPMisdirectedRequest(text=f"use {self.public_url}")
        origin = request.headers.get("Origin")
        asks = request.method != "GET" or "Upgrade" in request.headers
        if origin not in (None, f"http://{request.host}") or (asks and origin is None):
            raise web.HTTPForbidden(text="requests from pages of other sites are refused")

    def _bearer(self, request: web.Request) -> Bearer | None:
        """Return the bearer of the browser's token; None if the browser was not admitted."""
        token = self._let_in.get(request.cookies.get(self._cookie, ""))
        return self._bearer_of(token) if token else None

    def _bearer_of(self, token: str) -> Bearer | None:
        with suppress(RefusedError, ValueError, OSError):
            return self._tokens.find(token)
        return None

    async def _ask(self, _: web.Request) -> web.Response:
        return _page("")

    async def _login(self, request: web.Request) -> web.Response:
        """Admit a browser that sends a valid token, and set its cookie."""
        try:
            async with asyncio.timeout(BODY_S):
                given = await request.post()
        except TimeoutError as error:
            raise web.HTTPRequestTimeout from error
        token = str(given.get("token", "")).strip()
        if self._bearer_of(token) is None:
            wait = self._wrong.take("")
            again = f"; wait {wait} s" if wait else ""
            return _page(f"This token is not valid on this machine{again}.", 429 if wait else 401)
        cookie = secrets.token_urlsafe(32)
        self._let_in[cookie] = token
        answer = web.Response(status=303, headers={"Location": "/"})
        answer.set_cookie(self._cookie, cookie, httponly=True, samesite="Strict", path="/")
        return answer

    async def handle_websocket(self, request: web.Request) -> web.WebSocketResponse:
        """Open a console for one browser; it is read-only for an observer.

        An operator's console replaces an observer's console, which is closed properly.
        """
        bearer, own = self._bearer(request), asyncio.current_task()
        if bearer is None or own is None:
            raise web.HTTPUnauthorized
        commands = bearer.may("operator")
        if self._watched and commands:
            await self._close_window()
        if self._open is not None:
            raise web.HTTPConflict(text="a console is open in another window; close it first")
        self._open, self._watched = own, not commands
        self._left.clear()
        looking = asyncio.create_task(self._look(request, own))
        try:
            return await self._show(request, self._commands[commands])
        finally:
            looking.cancel()
            self._open, self._watched = None, False
            self._left.set()

    async def _close_window(self) -> None:
        """End the open console properly, if there is one."""
        if self._open is not None:
            self._open.cancel()
            with suppress(TimeoutError):
                await asyncio.wait_for(self._left.wait(), LEAVE_S)

    async def _show(self, request: web.Request, command: str) -> web.WebSocketResponse:
        """Run the console for one browser; its window closes after the console has ended."""
        websocket = web.WebSocketResponse(timeout=CLOSE_S, heartbeat=15, max_msg_size=MOST_BYTES)
        await websocket.prepare(request)

        async def close() -> None:
            await websocket.close()

        console = _Console(
            command,
            write_bytes=websocket.send_bytes,
            write_str=websocket.send_str,
            close=close,
            download_manager=self.download_manager,
        )
        width, height = (to_int(request.query.get(name, ""), 80) for name in ("width", "height"))
        await console.start(width, height)
        try:
            await self._process_messages(websocket, console)
        finally:
            await console.stop()
            await websocket.close()
        return websocket

    async def _look(self, request: web.Request, console: asyncio.Task[Any]) -> None:
        """End a console once its token is no longer valid."""
        while self._bearer(request) is not None:
            await asyncio.sleep(LOOK_S)
        console.cancel()


class _Console(AppService):
    """The process of one console."""

    async def stop(self) -> None:
        """End the process, and wait until it has ended."""
        await super().stop()
        if self._process is not None:
            await self._process.wait()

    async def run(self) -> None:
        """Show the console until its process ends, then close the window."""
        await super().run()
        self.stdin.close()
        await self.remote_close()


def _in_shell(command: Sequence[str]) -> str:
    """Return the shell command that runs `command` in the folder of child processes."""
    return f"cd {OWN_FOLDER} && exec {shlex.join(command)}"


def _report(error: Exception) -> None:
    errors.print_line(str(error), style="bold red")


def _page(problem: str, status: int = 200) -> web.Response:
    text = PAGE.replace("PROBLEM", escape(problem))
    return web.Response(text=text, content_type="text/html", status=status)


async def _with_headers(_: web.Request, response: web.StreamResponse) -> None:
    for name, value in HEADERS.items():
        response.headers.setdefault(name, value)
