"""The log keeps every event, on the disk when it matters, and never loses one silently."""

import errno
import os
import stat
from pathlib import Path
from unittest.mock import Mock

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pa_console.schema.events import event as ev
from pa_console.session.log.chain import LogError, read_log
from pa_console.session.log.verification import verify
from pa_console.session.log.writer import FLUSH_RECORDS, LogWriter, new_log_path
from tests.schema.strategies import events
from tests.session.logs import kept, write_log
from tests.session.story import at, session_started, telemetry

pytestmark = pytest.mark.invariant


class Clock:
    """A clock that the test sets."""

    now = 0.0

    def __call__(self) -> float:
        """Return the time as set."""
        return self.now


def logged(path: Path) -> list[ev.Event]:
    return list(read_log(path))


@given(st.lists(events(), max_size=6))
@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_any_events_come_back_as_they_went_in(tmp_path: Path, session: list[ev.Event]) -> None:
    path = write_log(new_log_path(tmp_path, "any"), session, "any")
    assert logged(path) == kept(session)
    assert verify(path).ok


def test_maps_come_back_in_the_order_they_had(tmp_path: Path) -> None:
    path = tmp_path / "s.jsonl"
    started = session_started().model_copy(update={"packages": {"z": "1", "a": "2", "m": "3"}})
    with LogWriter(path, "s") as log:
        log.append(at(0, started))
    back = logged(path)[0].data
    assert isinstance(back, ev.SessionStarted)
    assert list(back.packages) == ["z", "a", "m"]


def test_text_that_utf8_cannot_hold_is_logged_all_the_same(tmp_path: Path) -> None:
    path = tmp_path / "s.jsonl"
    with LogWriter(path, "s") as log:
        log.append(at(0, ev.MissionReported(text="broken \ud800 text")))
    assert verify(path).ok
    assert logged(path)[0].data == ev.MissionReported(text="broken ? text")


def test_a_decision_is_in_the_file_at_once_and_telemetry_soon(tmp_path: Path) -> None:
    path, clock = tmp_path / "s.jsonl", Clock()
    with LogWriter(path, "s", clock=clock) as log:
        log.append(telemetry(0.5))
        assert logged(path) == []
        clock.now = 1.0
        log.append(telemetry(1.0))
        assert len(logged(path)) == 2
        log.append(telemetry(1.5))
        log.append(at(1.6, ev.AllStopped(by="operator")))
        assert len(logged(path)) == 4
        for _ in range(FLUSH_RECORDS):
            log.append(telemetry(2.0))
        assert len(logged(path)) == 4 + FLUSH_RECORDS


def test_a_decision_waits_for_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[int] = []
    monkeypatch.setattr(os, "fsync", synced.append)
    with LogWriter(tmp_path / "s.jsonl", "s") as log:
        log.append(telemetry(0.5))
        assert not synced
        log.append(at(1, ev.AllStopped(by="operator")))
        assert synced


def test_a_log_goes_on_where_it_ended(tmp_path: Path) -> None:
    path, session = tmp_path / "s.jsonl", kept()
    for part in (session[:4], session[4:]):
        with LogWriter(path, "s") as log:
            for event in part:
                log.append(event)
    assert logged(path) == session
    assert verify(path).ok


@pytest.mark.parametrize("kept_bytes", [1, 40, -1])
def test_a_torn_last_line_is_set_aside_and_the_chain_goes_on(
    tmp_path: Path, kept_bytes: int
) -> None:
    path, session = tmp_path / "s.jsonl", kept()
    with LogWriter(path, "s") as log:
        for event in session[:4]:
            log.append(event)
    *whole, last = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(whole) + last[:kept_bytes])
    with LogWriter(path, "s") as log:
        log.append(session[4])
    assert logged(path) == [*session[:3], session[4]]
    assert verify(path).ok
    assert (tmp_path / "s.jsonl.torn").read_bytes() == last[:kept_bytes] + b"\n"


def test_a_log_of_one_torn_line_starts_over(tmp_path: Path) -> None:
    path = tmp_path / "s.jsonl"
    path.write_bytes(b'{"seq":1,"t":')
    with LogWriter(path, "s") as log:
        log.append(kept()[0])
    assert verify(path).lines == 1


def test_a_log_that_does_not_end_soundly_is_not_written_to(tmp_path: Path) -> None:
    path = tmp_path / "s.jsonl"
    with LogWriter(path, "s") as log:
        for event in kept()[:3]:
            log.append(event)
    good = path.read_bytes()
    for bad in (good.replace(b'"seq":3', b'"seq":4'), good + b"{}\n", good + b"\n"):
        path.write_bytes(bad)
        with pytest.raises(LogError, match="start a new log") as caught:
            LogWriter(path, "s")
        assert caught.value.line == bad.count(b"\n")
        assert path.read_bytes() == bad
    path.write_bytes(good)
    with pytest.raises(LogError, match="belongs to session “s”"):
        LogWriter(path, "another")


def test_without_a_listener_a_full_disk_raises_and_keeps_the_event(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, full = tmp_path / "s.jsonl", OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    stopped = at(0, ev.AllStopped(by="operator"))
    log = LogWriter(path, "s")
    with monkeypatch.context() as patch:
        patch.setattr(os, "write", Mock(side_effect=full))
        with pytest.raises(LogError, match=r"No space left.*free some space"):
            log.append(stopped)
    log.close()
    assert logged(path) == [stopped]
    with pytest.raises(LogError, match="closed"):
        log.append(stopped)


def test_a_folder_that_cannot_be_written_to_is_named(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("")
    with pytest.raises(LogError, match="file"):
        new_log_path(file, "s")
    with pytest.raises(LogError, match="file"):
        LogWriter(file / "s.jsonl", "s")


def test_a_log_is_not_executable_and_has_one_line_a_record(tmp_path: Path) -> None:
    path = tmp_path / "s.jsonl"
    with LogWriter(path, "s") as log:
        log.append(at(0, ev.MissionReported(text="line one\nline two\u2028three\r")))
    assert path.read_bytes().count(b"\n") == 1
    assert not path.stat().st_mode & stat.S_IXUSR
