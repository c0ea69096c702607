"""Connections to a served session: idle ones end, and no number of them keeps an operator out."""

import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack

import pytest
from yarl import URL

from pa_console.http import connections
from tests.http.conftest import Site

MANY = 6
LIMIT_S = 300


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as opened:
        yield opened


def connect(site: Site, stack: ExitStack, sent: str = "") -> socket.socket:
    """Return a connection on which `sent` was sent."""
    address = URL(site.address)
    assert address.host
    assert address.port
    connected = socket.create_connection((address.host, address.port), LIMIT_S)
    stack.enter_context(connected)
    connected.sendall(sent.encode())
    return connected


def whole(site: Site, path: str, role: str = "") -> str:
    """Return a whole request as it is sent."""
    bearer = f"Authorization: Bearer {site.tokens[role]}\r\n" if role else ""
    return f"GET {path} HTTP/1.1\r\nHost: {URL(site.address).authority}\r\n{bearer}\r\n"


def ended(connected: socket.socket) -> bool:
    """Return whether the other end closes the connection, after all that it still sends."""
    try:
        while connected.recv(65_536):
            pass
    except ConnectionResetError:
        pass
    except TimeoutError:
        return False
    return True


@pytest.mark.parametrize("sent", ["", "GET /v1/whoami HT", "GET / HTTP/1.1\r\nHost: a\r\nX"])
def test_a_connection_that_asks_for_nothing_is_closed(
    sent: str, site: Site, stack: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "IDLE_S", 0.05)
    assert ended(connect(site, stack, sent))


def test_a_connection_that_stops_within_its_second_request_is_closed(
    site: Site, stack: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "IDLE_S", 0.05)
    request = whole(site, "/v1/whoami", "observer")
    connected = connect(site, stack, request)
    until(connected, b"olaf")
    connected.sendall(request[:20].encode())
    assert ended(connected)


def test_a_stream_of_events_goes_on_while_nothing_happens(
    site: Site, stack: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "IDLE_S", 0.05)
    stream = connect(site, stack, whole(site, "/v1/events", "observer"))
    for _ in range(3):
        assert ended(connect(site, stack))
    site.ask("POST", "/v1/stop")
    told = b""
    while b"event: all_stopped" not in told:
        piece = stream.recv(65_536)
        assert piece
        told += piece
    site.ask("POST", "/v1/release")


def test_strangers_and_observers_keep_no_operator_out(
    site: Site, stack: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "MOST", MANY)
    operator = connect(site, stack, whole(site, "/v1/events", "operator"))
    until(operator, b"the session's events")
    observer = connect(site, stack, whole(site, "/v1/events", "observer"))
    until(observer, b"the session's events")
    strangers = [connect(site, stack) for _ in range(3 * MANY)]
    assert all(ended(stranger) for stranger in strangers[:MANY])
    for _ in range(3):
        assert site.ask("POST", "/v1/stop").status_code == 204
        assert site.ask("POST", "/v1/release").status_code == 204
    for _ in range(MANY):
        until(connect(site, stack, whole(site, "/v1/events", "observer")), b"the session's events")
    assert ended(observer)
    until(operator, b"all_stopped")
    assert site.ask("POST", "/v1/stop").status_code == 204
    assert site.ask("POST", "/v1/release").status_code == 204


def test_a_request_is_read_however_many_connections_come_after_it(
    site: Site, stack: ExitStack
) -> None:
    request = whole(site, "/v1/stop", "operator").replace("GET", "POST", 1)
    with site.at_rest():
        strangers = [connect(site, stack)]
        operator = connect(site, stack, request)
        strangers += [connect(site, stack) for _ in range(2 * connections.MOST)]
    assert b" 204 " in until(operator, b"\r\n")
    assert ended(strangers[0])
    assert site.ask("POST", "/v1/release").status_code == 204


def until(connected: socket.socket, found: bytes) -> bytes:
    """Return what is received until `found` is in it."""
    told = b""
    while found not in told:
        piece = connected.recv(65_536)
        assert piece, told
        told += piece
    return told


EXHAUSTED = """\
import asyncio, json, os, resource, socket, sys
from pa_console.http.connections import Listening

async def main():
    failures = []
    listening = Listening(0)
    listening.failed = failures.append
    address = listening.getsockname()
    async def answer(reader, writer):
        writer.write(await reader.readline())
        writer.close()
    server = await asyncio.start_server(answer, sock=listening)
    clients = [socket.socket() for _ in range(20)]
    resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))
    filled = []
    try:
        while True:
            filled.append(os.open(os.devnull, os.O_RDONLY))
    except OSError:
        pass
    loop = asyncio.get_running_loop()
    told = []
    loop.set_exception_handler(lambda _, context: told.append(context["message"]))
    turned_away = 0
    for client in clients:
        client.setblocking(False)
        await loop.sock_connect(client, address)
        try:
            turned_away += await loop.sock_recv(client, 1) == b""
        except ConnectionResetError:
            turned_away += 1
    for number in filled:
        os.close(number)
    reader, writer = await asyncio.open_connection(*address)
    writer.write(b"again\\n")
    again = (await reader.read()).decode()
    print(json.dumps([turned_away, len(failures), str(failures[0]), told, again]))

asyncio.run(main())
"""


def test_without_descriptors_connections_are_turned_away_and_that_is_reported_once() -> None:
    run = subprocess.run(
        (sys.executable, "-c", EXHAUSTED), capture_output=True, text=True, check=False, timeout=60
    )
    assert run.stderr == ""
    turned_away, reported, words, logged, again = json.loads(run.stdout)
    assert (turned_away, reported, logged, again) == (20, 1, [], "again\n")
    assert "open files" in words
