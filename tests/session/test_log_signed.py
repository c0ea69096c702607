"""A signed log says how far it is signed, whatever became of the console that wrote it."""

import os
import resource
import subprocess
import sys
import threading
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

from pa_console.schema.events import event as ev
from pa_console.session.log.chain import LogError, read_log
from pa_console.session.log.signed_head import SignedHead, head_path, read_head, write_head
from pa_console.session.log.verification import verify
from pa_console.session.log.writer import SIGN_RECORDS, LogWriter, new_log_path
from pa_console.session.recording import Player
from tests.session.logs import kept
from tests.session.story import at, story, telemetry
from tests.session.tamper import KNOWN, MINE, OTHER, is_signed, long_story, write_signed


def signed_lines(log: Path) -> list[int]:
    lines = log.read_bytes().splitlines()
    return [number for number, line in enumerate(lines, start=1) if is_signed(line)]


def test_a_closed_log_is_vouched_for_to_its_end(tmp_path: Path) -> None:
    log = write_signed(tmp_path / "s.jsonl")
    found = verify(log, KNOWN)
    assert found.intact
    assert (found.standing, found.note, found.key) == ("signed", "", MINE.fingerprint)
    assert found.vouched == found.lines == signed_lines(log)[-1]
    head = read_head(log)
    assert head is not None
    assert (head.closed, head.seq, head.hash) == (True, found.lines, found.head)


def test_signatures_are_no_part_of_what_the_log_tells(tmp_path: Path) -> None:
    log = write_signed(tmp_path / "s.jsonl")
    told = [event for event in long_story() if not event.data.transient]
    assert len(signed_lines(log)) > 2
    assert list(read_log(log)) == told
    player = Player.open(log)
    assert [player.recording[n] for n in range(len(player.recording))] == told


def test_a_log_without_signatures_says_so_and_reads_as_ever(tmp_path: Path) -> None:
    log = tmp_path / "old.jsonl"
    with LogWriter(log, "S1") as writer:
        for event in story():
            writer.append(event)
    found = verify(log, KNOWN)
    assert (found.ok, found.intact, found.standing) == (True, False, "not signed")
    assert not head_path(log).exists()


def test_a_key_that_is_not_known_is_told(tmp_path: Path) -> None:
    log = write_signed(tmp_path / "s.jsonl", signer=OTHER)
    found = verify(log, KNOWN)
    assert (found.damage, found.first_bad_line) == ("unknown-key", 2)
    assert OTHER.fingerprint in found.problem
    assert MINE.fingerprint in found.problem
    assert verify(log, {OTHER.fingerprint}).intact


def test_it_is_signed_every_so_many_records_and_seconds(tmp_path: Path) -> None:
    log, now = tmp_path / "s.jsonl", 0.0
    with LogWriter(log, "s", signer=MINE, clock=lambda: now) as writer:
        for number in range(SIGN_RECORDS + 1):
            writer.append(telemetry(number))
        assert signed_lines(log) == [2, 2 + SIGN_RECORDS + 1]
        now = 5.0
        writer.append(telemetry(200))
        assert signed_lines(log)[2:] == [2 + SIGN_RECORDS + 3]


def test_a_console_that_dies_leaves_a_log_that_is_signed_up_to_a_line(tmp_path: Path) -> None:
    log = tmp_path / "s.jsonl"
    writer = LogWriter(log, "S1", signer=MINE, clock=lambda: 0.0)
    empty = verify(log, KNOWN)
    assert (empty.ok, empty.standing, empty.note) == (True, "open", "the log is empty")
    for event in long_story()[:-1]:
        writer.append(event)
    writer.flush()
    found = verify(log, KNOWN)
    last = signed_lines(log)[-1]
    assert 2 < last < found.lines
    assert (found.ok, found.intact, found.standing, found.vouched) == (True, False, "open", last)
    assert f"{found.lines - last} unsigned records" in found.note
    writer.close()
    assert verify(log, KNOWN).intact


def test_a_slow_disk_keeps_no_record_waiting(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, awake = tmp_path / "s.jsonl", threading.Event()

    def slow(path: Path, head: SignedHead, *, lasting: bool) -> None:
        if not lasting:
            awake.wait()
        write_head(path, head, lasting=lasting)

    monkeypatch.setattr("pa_console.session.log.signed_head.write_head", slow)
    with LogWriter(log, "s", signer=MINE, clock=lambda: 0.0) as writer:
        for number in range(2 * SIGN_RECORDS):
            writer.append(telemetry(number))
        assert len(signed_lines(log)) == 2
        behind = read_head(log)
        assert behind is not None
        assert behind.seq == 2
        assert verify(log, KNOWN).ok
        awake.set()
    assert verify(log, KNOWN).intact


def test_a_log_that_is_opened_again_says_what_was_not_signed_then(tmp_path: Path) -> None:
    log, session = tmp_path / "s.jsonl", long_story()
    dying = LogWriter(log, "S1", signer=MINE, clock=lambda: 0.0)
    for event in session[:9]:
        dying.append(event)
    dying.flush()
    content, head = log.read_bytes(), head_path(log).read_bytes()
    dying.close()
    log.write_bytes(content + b'{"seq":10,"t":')
    head_path(log).write_bytes(head)
    lines = content.count(b"\n")
    with LogWriter(log, "S1", signer=MINE, clock=lambda: 0.0) as writer:
        for event in session[9:]:
            writer.append(event)
    found = verify(log, KNOWN)
    assert found.intact
    assert f"{lines - 2} records before line {lines + 2} were still unsigned" in found.note
    assert list(read_log(log)) == [event for event in session if not event.data.transient]


def test_a_head_that_is_older_than_the_last_signature_is_a_crash(tmp_path: Path) -> None:
    log = tmp_path / "s.jsonl"
    writer = LogWriter(log, "S1", signer=MINE)
    writer.append(long_story()[0])
    head = head_path(log).read_bytes()
    writer.close()
    head_path(log).write_bytes(head)
    found = verify(log, KNOWN)
    assert found.intact
    assert "older" in found.note


@pytest.mark.parametrize("keep", [-1, -100])
def test_a_log_that_was_cut_short_is_not_gone_on_with(tmp_path: Path, keep: int) -> None:
    log = write_signed(tmp_path / "s.jsonl")
    lines = log.read_bytes().splitlines(keepends=True)
    cut = b"".join(lines[:-1]) + (lines[-1][:50] if keep == -100 else b"")
    log.write_bytes(cut)
    with pytest.raises(LogError, match=r"cut short.*start a new log"):
        LogWriter(log, "S1", signer=MINE)
    assert log.read_bytes() == cut
    assert sorted(path.name for path in tmp_path.iterdir()) == ["s.jsonl", "s.jsonl.head"]


def test_a_log_is_not_gone_on_with_by_another_key_or_with_another_head(tmp_path: Path) -> None:
    log = write_signed(tmp_path / "s.jsonl")
    with pytest.raises(LogError, match="another key"):
        LogWriter(log, "S1", signer=OTHER)
    other = write_signed(tmp_path / "other.jsonl", "S2")
    head_path(other).replace(head_path(log))
    with pytest.raises(LogError, match="session “S2”"):
        LogWriter(log, "S1", signer=MINE)
    head_path(log).write_bytes(b"{}")
    with pytest.raises(LogError, match="not a signed head"):
        LogWriter(log, "S1", signer=MINE)


def test_a_new_log_in_the_place_of_a_deleted_one_has_a_head_of_its_own(tmp_path: Path) -> None:
    log = write_signed(tmp_path / "s.jsonl")
    log.unlink()
    with pytest.raises(LogError, match="cut short"):
        LogWriter(log, "S1", signer=MINE)
    assert verify(write_signed(log, "S2"), KNOWN).intact


def test_a_head_that_cannot_be_written_is_reported_once_and_loses_no_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, reported = tmp_path / "s.jsonl", list[LogError]()

    def refused(*_: object) -> None:
        raise OSError(28, "No space left on device")

    session = long_story()
    writer = LogWriter(log, "S1", signer=MINE, on_error=reported.append)
    with monkeypatch.context() as patched:
        patched.setattr(os, "replace", refused)
        writer.append(session[0])
        for event in session[1:]:
            writer.append(event)
        assert len(reported) == 1
        assert "signed head" in str(reported[0])
    writer.close()
    assert verify(log, KNOWN).intact
    assert list(read_log(log)) == [event for event in session if not event.data.transient]


PROBE = """
import os, resource, signal, sys
from pathlib import Path
from pa_console.session.log.chain import LogError
from pa_console.session.log.writer import LogWriter
from tests.session.story import at, telemetry
from tests.session.tamper import MINE
from pa_console.schema.events.event import AllStopped

def die(_):
    os.kill(os.getpid(), signal.SIGKILL)

log = LogWriter(Path(sys.argv[1]), "S1", signer=MINE, on_error=die)
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
for number in range(1000):
    log.append(telemetry(number))
    log.append(at(number, AllStopped(by=f"operator {number}")))
    print(number, flush=True)
"""
"""Stops again and again, tells each stop that the log has, and dies in the middle of a line."""


@contextmanager
def no_file_longer_than(size: int) -> Generator[None]:
    """Let the system refuse what would make a file longer, after writing what still fits."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("room", [1000, 3001, 6000])
def test_a_disk_that_fills_up_and_is_freed_loses_nothing(tmp_path: Path, room: int) -> None:
    log, reported = tmp_path / "s.jsonl", list[LogError]()
    *told, last = kept(long_story())
    with LogWriter(log, "S1", signer=MINE, on_error=reported.append) as writer:
        with no_file_longer_than(room):
            for event in told:
                writer.append(event)
            assert len(reported) == 1
            assert str(log) in str(reported[0])
            assert writer.error is not None
            assert log.stat().st_size == room
            assert not verify(log, KNOWN).intact
        writer.append(last)
        assert writer.error is None
    assert verify(log, KNOWN).intact
    assert list(read_log(log)) == kept(long_story())


def test_a_disk_that_stays_full_says_what_is_lost_and_the_log_opens_again(tmp_path: Path) -> None:
    log = tmp_path / "s.jsonl"
    writer = LogWriter(log, "S1", signer=MINE, on_error=lambda _: None)
    with no_file_longer_than(3000):
        for event in kept(long_story()):
            writer.append(event)
        with pytest.raises(LogError, match=r"\d+ records at its end could not be written"):
            writer.close()
    found = verify(log, KNOWN)
    assert found.damage == "half-line"
    assert found.first_bad_line == found.lines + 1
    with LogWriter(log, "S1", signer=MINE) as writer:
        for event in kept(long_story())[-2:]:
            writer.append(event)
    assert verify(log, KNOWN).intact


def test_a_console_killed_in_the_middle_of_a_line_has_lost_nothing_it_acknowledged(
    tmp_path: Path,
) -> None:
    log = tmp_path / "s.jsonl"
    command = [sys.executable, "-c", PROBE, str(log)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == -9, done.stderr
    acknowledged = [f"operator {number}" for number in done.stdout.split()]
    assert acknowledged
    assert verify(log, KNOWN).damage == "half-line"
    with LogWriter(log, "S1", signer=MINE) as writer:
        stops = [e.data.by for e in read_log(log) if isinstance(e.data, ev.AllStopped)]
        assert stops[: len(acknowledged)] == acknowledged
        writer.append(at(1000, ev.SessionEnded(reason="quit")))
    assert verify(log, KNOWN).intact
    torn = log.with_name("s.jsonl.torn").read_bytes()
    assert torn.startswith(b'{"seq":')


def test_two_consoles_in_one_folder_leave_two_intact_logs(tmp_path: Path) -> None:
    paths = [new_log_path(tmp_path, "S 1/x") for _ in range(2)]
    assert {path.parent for path in paths} == {tmp_path}
    writers = [LogWriter(path, "S1", signer=MINE) for path in paths]
    for event in long_story():
        for writer in writers:
            writer.append(event)
    with pytest.raises(LogError, match="another console"):
        LogWriter(paths[0], "S1", signer=MINE)
    for writer, path in zip(writers, paths, strict=True):
        writer.close()
        assert verify(path, KNOWN).intact
        assert list(read_log(path)) == kept(long_story())


def test_a_copy_under_another_name_needs_its_head(tmp_path: Path) -> None:
    log = write_signed(tmp_path / "s.jsonl")
    copy = tmp_path / "copy.jsonl"
    copy.write_bytes(log.read_bytes())
    assert verify(copy, KNOWN).damage == "head-missing"
    copy.with_name("copy.jsonl.head").write_bytes(log.with_name("s.jsonl.head").read_bytes())
    assert verify(copy, KNOWN).intact
