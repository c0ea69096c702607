"""The console in a browser: who is let in, one window at a time, and an end in order."""

import asyncio
import signal
import sys
from collections.abc import AsyncGenerator, Sequence
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import aiohttp
import pytest
from yarl import URL

from pa_console.cli.sessions import web
from pa_console.http import connections
from pa_console.http.connections import listen
from pa_console.http.tokens import TokenBook

APP = """
import json, sys
out, into = sys.stdout.buffer, sys.stdin.buffer
out.write(b"__GANGLION__\\n")
def tell(text):
    out.write(b"D" + len(text).to_bytes(4, "big") + text)
    out.flush()
tell(" ".join(sys.argv[1:]).encode() or b"console")
while kind := into.read(1):
    body = into.read(int.from_bytes(into.read(4), "big"))
    if kind == b"D":
        tell(b"typed " + body)
    elif json.loads(body)["type"] == "quit":
        open(ENDED, "w").close()
        break
"""
"""Speaks with textual-serve as a Textual app does."""


class Browser:
    """A browser at a console that is served."""

    def __init__(self, client: aiohttp.ClientSession, address: str) -> None:
        self._client, self._address = client, address
        self.origin = {"Origin": address}

    async def get(self, path: str, **headers: str) -> int:
        """Return the status of a page."""
        async with self._client.get(
            self._address + path, headers=headers, allow_redirects=False
        ) as answer:
            return answer.status

    @property
    def port(self) -> int | None:
        """The port that is served."""
        return URL(self._address).port

    @property
    def cookies(self) -> list[str]:
        """The names of the cookies that were set."""
        return [cookie.key for cookie in self._client.cookie_jar]

    async def login(self, token: str, **headers: str) -> int:
        """Return the status of the answer to a token."""
        async with self._client.post(
            f"{self._address}/login",
            data={"token": token},
            headers=headers or self.origin,
            allow_redirects=False,
        ) as answer:
            return answer.status

    async def open(self, **headers: str) -> aiohttp.ClientWebSocketResponse:
        """Open the console; raises WSServerHandshakeError for what is refused."""
        return await self._client.ws_connect(f"{self._address}/ws", headers=headers or self.origin)


Served = tuple[Browser, TokenBook]


@asynccontextmanager
async def served(folder: Path, command: Sequence[str] = ()) -> AsyncGenerator[Served]:
    """Serve `command`, by default a stand-in for the console, as `serve --web` does, until Ctrl-C.

    The stand-in leaves the file `ended` in `folder` when it was told to end.
    """
    stand_in = (sys.executable, "-c", APP.replace("ENDED", repr(str(folder / "ended"))))
    tokens = TokenBook(folder / "tokens.json")
    tokens.make("olaf", "observer")
    with listen(0) as listening:
        port: int = listening.getsockname()[1]
        console = web.ServedConsole(command or stand_in, tokens, listening)
        work = asyncio.create_task(console.until_ended())
        jar = aiohttp.CookieJar(unsafe=True)
        async with aiohttp.ClientSession(cookie_jar=jar) as client:
            browser = Browser(client, f"http://127.0.0.1:{port}")
            while not console.begun.is_set():
                await asyncio.sleep(0)
            try:
                yield browser, tokens
            finally:
                signal.raise_signal(signal.SIGINT)
                assert await work == 0


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


async def test_nobody_sees_the_console_without_a_token(tmp_path: Path) -> None:
    async with served(tmp_path) as (browser, _):
        assert await browser.get("/login") == 200
        assert await browser.get("/") == 303
        assert await browser.get("/static/js/textual.js") == 401
        assert await browser.get("/download/x") == 401
        with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
            await browser.open()
        assert refused.value.status == 401
        assert await browser.login("pa_wrong") == 401
        assert await browser.get("/login", Host="evil.example") == 421


async def test_an_operator_types_and_reads_in_one_window_at_a_time(tmp_path: Path) -> None:
    async with served(tmp_path) as (browser, tokens):
        assert await browser.login(tokens.make("anna", "operator")) == 303
        assert browser.cookies == [f"pa-console-{browser.port}"]
        assert await browser.get("/") == 200
        console = await browser.open()
        assert await console.receive_bytes() == b"console"
        await console.send_json(["stdin", "stop"])
        assert await console.receive_bytes() == b"typed stop"
        with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
            await browser.open()
        assert refused.value.status == 409
        for elsewhere in ({"Origin": "http://evil.example"}, {"X-Nothing": "1"}):
            with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
                await browser.open(**elsewhere)
            assert refused.value.status == 403
        reading = asyncio.create_task(console.receive())
    assert (await reading).type == aiohttp.WSMsgType.CLOSE
    assert (tmp_path / "ended").exists()


async def test_a_page_of_another_site_logs_nobody_in(tmp_path: Path) -> None:
    async with served(tmp_path) as (browser, tokens):
        token = tokens.make("anna", "operator")
        assert await browser.login(token, Origin="http://evil.example") == 403
        assert await browser.login(token, **{"X-Nothing": "1"}) == 403


async def test_an_observer_s_console_is_read_only_and_ends_with_the_token(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(web, "LOOK_S", 0.05)
    async with served(tmp_path) as (browser, tokens):
        token = tokens.make("olga", "observer")
        assert await browser.login(token) == 303
        console = await browser.open()
        assert await console.receive_bytes() == b"--readonly"
        (row,) = (row for row in tokens.listed() if row.person == "olga")
        tokens.revoke(row.id)
        assert (await console.receive()).type in (
            aiohttp.WSMsgType.CLOSE,
            aiohttp.WSMsgType.CLOSED,
        )
        assert await browser.get("/") == 303
    assert (tmp_path / "ended").exists()


async def test_an_operator_opens_the_window_that_an_observer_holds(tmp_path: Path) -> None:
    async with served(tmp_path) as (browser, tokens):
        assert await browser.login(tokens.make("olga", "observer")) == 303
        watching = await browser.open()
        assert await watching.receive_bytes() == b"--readonly"
        with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
            await browser.open()
        assert refused.value.status == 409
        assert await browser.login(tokens.make("anna", "operator")) == 303
        reading = asyncio.create_task(watching.receive())
        console = await browser.open()
        assert (await reading).type in (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED)
        assert (tmp_path / "ended").exists()
        assert await console.receive_bytes() == b"console"
        assert await browser.login(tokens.make("olga", "observer")) == 303
        with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
            await browser.open()
        assert refused.value.status == 409


async def test_a_window_whose_console_died_is_closed_and_free_again(tmp_path: Path) -> None:
    async with served(tmp_path, [sys.executable, "-c", "raise SystemExit(3)"]) as (browser, tokens):
        assert await browser.login(tokens.make("anna", "operator")) == 303
        window = await browser.open()
        assert (await window.receive()).type in (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED)
        again = None
        while again is None:
            with suppress(aiohttp.WSServerHandshakeError):
                again = await browser.open()
        await again.receive()


@pytest.mark.parametrize(
    "sent", ["", "POST /login HTTP/1.1\r\nHost: HERE\r\nOrigin: http://HERE\r\n"
             "Content-Type: application/x-www-form-urlencoded\r\nContent-Length: 99\r\n\r\ntoken="]
)  # fmt: skip
async def test_an_idle_connection_is_closed_and_an_open_window_is_not(
    sent: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "IDLE_S", 0.05)
    monkeypatch.setattr(web, "BODY_S", 0.05)
    async with served(tmp_path) as (browser, tokens):
        assert await browser.login(tokens.make("anna", "operator")) == 303
        console = await browser.open()
        assert await console.receive_bytes() == b"console"
        for _ in range(2):
            reader, writer = await asyncio.open_connection("127.0.0.1", browser.port)
            writer.write(sent.replace("HERE", f"127.0.0.1:{browser.port}").encode())
            async with asyncio.timeout(300):
                await reader.read()
            writer.close()
        await console.send_json(["stdin", "still here"])
        assert await console.receive_bytes() == b"typed still here"
