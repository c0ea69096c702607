"""Alerts reach real receivers, one that hangs is given up, and no secret is ever shown."""

import json
import logging
import socket
from collections.abc import Iterator
from dataclasses import dataclass, field
from email import message_from_bytes, policy
from http.server import BaseHTTPRequestHandler, HTTPServer
from queue import Queue
from threading import Thread
from time import monotonic
from typing import Any

import pytest
from aiosmtpd.controller import Controller

from pa_console.cli.options import SessionOptions
from pa_console.cli.sessions.observing import observing
from pa_console.observability.alert_delivery import AlertDelivery, receivers
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Alarm
from pa_console.settings.schema import Settings
from pa_console.station.alarms.alerts import Message
from tests.cli.inside import Call, caller
from tests.fleets.mavlink.drones import free_port
from tests.session.story import at

SECRET = "s3cr3tT0k3n"
MESSAGE = Message(
    "PA Console: emergency alarm: Track_04", "hostile vehicle at EastGate", "emergency"
)
LATE = Message("PA Console: NOBODY ACTS", "plan of M1 waits, for 5 min", None, later=True)


@dataclass
class WebReceiver:
    """A web server that keeps what is posted to it."""

    answer: int = 200
    posted: "Queue[dict[str, Any]]" = field(default_factory=Queue[dict[str, Any]])
    port: int = 0

    def __enter__(self) -> "WebReceiver":
        posted, answer = self.posted, self.answer

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                length = int(self.headers["Content-Length"])
                posted.put(json.loads(self.rfile.read(length)))
                self.send_response(answer)
                self.end_headers()

            def log_message(self, format: str, *args: object) -> None:  # noqa: A002
                pass

        self._server = HTTPServer(("127.0.0.1", 0), Handler)
        self.port = self._server.server_address[1]
        Thread(target=self._server.serve_forever, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()

    @property
    def address(self) -> str:
        """Its address for Apprise, with secrets."""
        return f"json://ann:{SECRET}@127.0.0.1:{self.port}/{SECRET}"


class Mailbox:
    """A handler of a mail server that keeps what arrives."""

    def __init__(self) -> None:
        self.mails: Queue[bytes] = Queue()

    async def handle_DATA(self, _server: object, _session: object, envelope: Any) -> str:  # noqa: N802
        """Keep one mail."""
        self.mails.put(envelope.content)
        return "250 OK"


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    """Return what runs a verb in this process."""
    return caller(monkeypatch, capsys)


@pytest.fixture
def silent() -> Iterator[str]:
    """Yield the address of a receiver that lets everybody in and never answers."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield f"json://127.0.0.1:{server.getsockname()[1]}/{SECRET}"


def news_of(delivery: AlertDelivery) -> list[str]:
    """Let a delivery end; return what it reports."""
    delivery.close(20.0)
    return list(delivery.news())


def test_a_web_receiver_and_a_mailbox_are_told_while_another_one_hangs(silent: str) -> None:
    mailbox, port = Mailbox(), free_port()
    mail = Controller(mailbox, hostname="127.0.0.1", port=port)
    with WebReceiver() as web:
        mail.start()
        try:
            mailto = f"mailto://127.0.0.1:{port}?from=site@example.org&to=ann@example.org"
            to = receivers([silent, web.address, mailto])
            delivery = AlertDelivery(to, limit_s=0.5, tries_after_s=(0.0,))
            began = monotonic()
            delivery.give(MESSAGE)
            assert monotonic() - began < 0.2, "nobody waits for a receiver"
            posted = web.posted.get(timeout=10)
            letter = message_from_bytes(mailbox.mails.get(timeout=10), policy=policy.default)
            told = news_of(delivery)
        finally:
            mail.stop()
    assert posted["title"] == MESSAGE.title
    assert posted["message"] == MESSAGE.body
    assert letter["subject"] == MESSAGE.title
    assert MESSAGE.body in str(letter)
    assert sorted(told) == [
        f"receiver 1 (JSON) not alerted, no answer within 0.5 s: {MESSAGE.title}",
        f"receiver 2 (JSON) alerted: {MESSAGE.title}",
        f"receiver 3 (E-Mail) alerted: {MESSAGE.title}",
    ]


def test_a_receiver_that_refuses_is_tried_again_and_then_reported() -> None:
    with WebReceiver(answer=500) as web:
        delivery = AlertDelivery(receivers([web.address]), tries_after_s=(0.0, 0.0, 0.0))
        delivery.give(MESSAGE)
        told = news_of(delivery)
        assert web.posted.qsize() == 3
    assert told == [f"receiver 1 (JSON) not alerted, refused, or not reached: {MESSAGE.title}"]


def test_those_for_later_are_told_only_that_nobody_acts() -> None:
    with WebReceiver() as web, WebReceiver() as later:
        delivery = AlertDelivery(receivers([web.address], [later.address]))
        delivery.give(MESSAGE)
        delivery.give(LATE)
        news_of(delivery)
        assert web.posted.qsize() == 2
        assert later.posted.qsize() == 1
        assert later.posted.get()["title"] == LATE.title


def test_a_receiver_that_always_hangs_is_not_tried_without_end(silent: str) -> None:
    [receiver] = receivers([silent])
    found = [receiver.try_once(MESSAGE, 0.01) for _ in range(5)]
    assert found[2] == "no answer within 0.01 s"
    assert found[3:] == ["3 earlier tries still hang"] * 2


@pytest.mark.parametrize("wrong", [f"nosuch://{SECRET}@host", SECRET, f"slack://{SECRET}"])
def test_an_address_that_is_none_is_refused_without_being_shown(
    wrong: str, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    with caplog.at_level(logging.DEBUG), pytest.raises(ValueError, match="receiver 2") as refused:
        receivers(["json://127.0.0.1", wrong])
    assert SECRET not in str(refused.value) + caplog.text + "".join(capfd.readouterr())


def test_a_session_tells_people_and_hears_of_it() -> None:
    urgent = Alarm(
        id="a1", kind="hostile_track", priority="emergency", subject="Track_04", text="a hostile "
        "vehicle at EastGate", raised_s=1.0,
    )  # fmt: skip
    with WebReceiver() as web:
        with observing(Settings(), SessionOptions(alert=[web.address])) as beside:
            beside.observer(at(0, ev.AlarmRaised(alarm=urgent)))
            assert web.posted.get(timeout=10)["title"].endswith("emergency alarm: Track_04")
        assert beside.outside is not None
        [told] = beside.outside.news()
    assert isinstance(told, ev.Noticed)
    assert told.text == "receiver 1 (JSON) alerted: PA Console: emergency alarm: Track_04"
    assert SECRET not in told.text


def test_the_verb_tells_who_is_reached_and_shows_no_secret(
    call: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    with WebReceiver() as web, WebReceiver(answer=403) as closed:
        monkeypatch.setenv("PA_CONSOLE_ALERT", f"{web.address} {closed.address}")
        done = call("alert")
        assert web.posted.get()["title"] == "PA Console: test alert"
    assert "✔ receiver 1 (JSON): delivered" in done.out
    assert "✘ receiver 2 (JSON): refused, or not reached" in done.out
    assert done.code == 1
    assert SECRET not in done.out + done.err


def test_the_verb_asks_for_an_address_where_there_is_none(call: Call) -> None:
    done = call("alert")
    assert done.code == 2
    assert "give --alert URL" in done.err
