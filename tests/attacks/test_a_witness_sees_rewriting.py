"""A log that its own user wrote anew and signed is not the one that its witness has seen."""

import json
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pa_console.schema.events import event as ev
from pa_console.session.log.signed_head import (
    EVERY_S,
    SignedHead,
    Witness,
    WitnessResult,
    check_witness,
    head_path,
)
from pa_console.session.log.verification import verify
from pa_console.session.log.writer import LogWriter
from pa_console.signing import load_signer
from pa_console.station.station import ControlStation
from tests.cli.inside import Call
from tests.rig import Rig, rig, site
from tests.scripted import ScriptedEngine, plan
from tests.session.story import at, story, telemetry
from tests.session.tamper import KNOWN, MINE, OTHER, write_signed

__all__ = ["rig", "site"]
COMMAND = next(event for event in story() if isinstance(event.data, ev.CommandSent))


def session(decisions: int) -> list[ev.Event]:
    """So many stops with telemetry in between."""
    middle = [
        event
        for number in range(decisions)
        for event in (telemetry(number), at(number, ev.AllStopped(by=f"operator {number}")))
    ]
    return [story()[0], *middle, at(99, ev.SessionEnded(reason="quit"))]


def witnessed(folder: Path, events: list[ev.Event]) -> tuple[Path, Path]:
    """Write a log, its heads into a witness as soon as they are made; return both."""
    log, file = folder / "s.jsonl", folder / "witness.heads"
    for path in (log, head_path(log), file):
        path.unlink(missing_ok=True)
    arrived = threading.Event()

    def send(line: bytes) -> None:
        with file.open("ab") as stream:
            stream.write(line)
        arrived.set()

    with LogWriter(log, "S1", signer=MINE, witness=Witness(str(file), send=send)) as writer:
        for event in events:
            arrived.clear()
            writer.append(event)
            if event.data.binding:
                assert arrived.wait(300)
    return log, file


def anew(log: Path, events: list[ev.Event]) -> None:
    """Write the log again as whoever has its key can: everything signed, nothing damaged."""
    log.unlink()
    head_path(log).unlink()
    write_signed(log, events=events)
    assert verify(log, KNOWN).intact


def held(log: Path, witness: Path) -> WitnessResult:
    return check_witness(log, "S1", witness, KNOWN)


def test_a_log_as_it_was_has_all_that_its_witness_saw(tmp_path: Path) -> None:
    log, witness = witnessed(tmp_path, session(4))
    found = held(log, witness)
    assert (found.ok, found.records) == (True, verify(log, KNOWN).lines)
    assert found.heads >= 5


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_rewriting_by_the_same_key_shows_at_the_first_head_after_it(
    tmp_path: Path, data: st.DataObject
) -> None:
    decisions = data.draw(st.integers(2, 6))
    events = session(decisions)
    log, witness = witnessed(tmp_path, events)
    decided = [n for n, event in enumerate(events) if event.data.binding]
    at_event = data.draw(st.sampled_from(decided))
    before = decided.index(at_event)
    how = data.draw(st.sampled_from(["edit", "remove", "insert", "cut"]))
    other = at(0, ev.AllStopped(by="somebody else"))
    changed = {
        "edit": [*events[:at_event], other, *events[at_event + 1 :]],
        "remove": [*events[:at_event], *events[at_event + 1 :]],
        "insert": [*events[:at_event], COMMAND, *events[at_event:]],
        "cut": events[:at_event],
    }[how]
    anew(log, changed)
    found = held(log, witness)
    assert not found.ok
    assert found.line is not None
    heads = [SignedHead.parse(line) for line in witness.read_bytes().splitlines(keepends=True)]
    assert found.line <= before + 2  # one of the session's start, one for each decision before
    assert f"record {heads[found.line - 1].seq}" in found.problem


def test_heads_of_other_keys_and_sessions_and_rubbish_say_nothing(tmp_path: Path) -> None:
    log, witness = witnessed(tmp_path, session(3))
    (tmp_path / "x").mkdir()
    foreign = write_signed(tmp_path / "x" / "o.jsonl", "S1", OTHER)
    other = write_signed(tmp_path / "x" / "p.jsonl", "S2")
    noise = head_path(foreign).read_bytes() + head_path(other).read_bytes() + b"rubbish\n{\n"
    sound = held(log, witness).heads
    witness.write_bytes(noise + witness.read_bytes() + noise)
    assert held(log, witness) == WitnessResult(sound, verify(log, KNOWN).lines)
    witness.write_bytes(noise)
    assert "no head of session “S1”" in held(log, witness).problem


def test_verify_names_the_first_head_that_is_gone(tmp_path: Path, call: Call) -> None:
    log, witness = tmp_path / "s.jsonl", tmp_path / "w" / "heads"
    signer = load_signer()
    with LogWriter(log, "S1", signer=signer, witness=Witness(str(witness))) as writer:
        for event in session(3):
            writer.append(event)
    words = ("replay", str(log), "--verify", "--chain-only", "--witness", str(witness))
    done = call(*words)
    assert done.code == 0, done.said
    assert f"that {witness} received" in done.said
    log.unlink()
    head_path(log).unlink()
    write_signed(log, signer=signer, events=session(2))
    assert call(*words[:4]).code == 0
    done = call(*words)
    assert done.code == 2
    assert f"{witness}:" in done.said
    assert "were removed or rewritten" in done.said
    assert call(*words, "--json").json["witness"]["line"] is not None


class Receiver:
    """A web server that keeps what is posted, and answers with `status`."""

    def __init__(self) -> None:
        self.bodies: list[bytes] = []
        self.status = 204
        self.came = threading.Event()
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["Content-Length"]))
                self.send_response(outer.status)
                if outer.status == 302:
                    self.send_header("Location", "/elsewhere")
                self.end_headers()
                outer.bodies.append(body)
                outer.came.set()

            def do_GET(self) -> None:
                self.send_response(200)
                self.end_headers()

            def log_message(self, *_: object) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
                pass

        self.server = HTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}/heads"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    found = Receiver()
    yield found
    found.server.shutdown()
    found.server.server_close()


def test_an_address_is_given_the_heads_and_its_file_is_the_witness(
    tmp_path: Path, receiver: Receiver
) -> None:
    log = tmp_path / "s.jsonl"
    witness = Witness(receiver.url)
    with LogWriter(log, "S1", signer=MINE, witness=witness) as writer:
        for event in session(3):
            receiver.came.clear()
            writer.append(event)
            if event.data.binding:
                assert receiver.came.wait(300)
    assert witness.problem == ""
    file = tmp_path / "received"
    file.write_bytes(b"".join(receiver.bodies))
    found = held(log, file)
    assert (found.ok, found.records) == (True, verify(log, KNOWN).lines)


def only(station: ControlStation) -> Callable[..., ControlStation]:
    """Return what opens no station but `station`."""
    return lambda *_: station


@pytest.mark.parametrize(("status", "words"), [(500, "answered 500"), (302, "answered 302")])
def test_an_address_that_keeps_nothing_is_told(
    tmp_path: Path, receiver: Receiver, status: int, words: str
) -> None:
    receiver.status = status
    witness = Witness(receiver.url)
    with LogWriter(tmp_path / "s.jsonl", "S1", signer=MINE, witness=witness) as writer:
        writer.append(story()[0])
        assert receiver.came.wait(300)
    assert words in witness.problem
    assert verify(tmp_path / "s.jsonl", KNOWN).intact


async def test_a_witness_that_is_not_there_is_told_and_keeps_no_mission_waiting(
    tmp_path: Path, rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    engine = ScriptedEngine([plan(("Drone_T04", "move_to EastGate"))])
    station = rig.station(engine)
    log, failed = tmp_path / "s.jsonl", threading.Event()

    def nobody(_: bytes) -> None:
        failed.set()
        raise ConnectionRefusedError(111, "Connection refused")

    witness = Witness("http://127.0.0.1:9/", send=nobody)
    with LogWriter(log, station.session, signer=MINE, witness=witness) as writer:
        station.write_to(writer)
        monkeypatch.setattr(rig, "station", only(station))

        def wait(*_: object) -> None:
            assert failed.wait(300)

        trace = await rig.run(engine, on_event=wait)
    assert trace.status == "verified"
    told = [e.data.text for e in rig.events if isinstance(e.data, ev.Noticed)]
    assert "does not get the log's signed heads: Connection refused" in told
    assert "Connection refused" in writer.witness_problem
    assert verify(log, KNOWN).intact


def test_heads_that_no_decision_calls_for_are_sent_every_ten_seconds(tmp_path: Path) -> None:
    now, sent = [0.0], list[int]()
    some = threading.Semaphore(0)

    def send(line: bytes) -> None:
        sent.append(json.loads(line)["seq"])
        some.release()

    witness = Witness("w", send=send, clock=lambda: now[0])
    _, file = witnessed(tmp_path, session(1))
    head = SignedHead.parse(file.read_bytes().splitlines(keepends=True)[0])
    for number in range(1, 41):
        now[0] = number / 2
        seen = head.model_copy(update={"seq": number})
        before = len(sent)
        witness.see(seen, urgent=number == 5)
        if number in (1, 5, 25):
            assert some.acquire(timeout=300)
        else:
            assert len(sent) == before
    witness.close()
    assert sent == [1, 5, 25]
    assert EVERY_S == 10.0
