"""Nothing that was acknowledged is lost: a full disk, a console that is killed, two at once."""

import resource
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

from pa_console.schema.events import event as ev
from pa_console.session.log.chain import LogError, read_log
from pa_console.session.log.verification import verify
from pa_console.session.log.writer import LogWriter, new_log_path
from tests.session.logs import kept
from tests.session.story import at
from tests.session.tamper import KNOWN, MINE, long_story, write_signed

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
            assert log.stat().st_size == room
            assert not verify(log, KNOWN).intact
        writer.append(last)
    assert verify(log, KNOWN).intact
    assert list(read_log(log)) == kept(long_story())


def test_a_disk_that_stays_full_says_what_is_lost_and_the_log_opens_again(tmp_path: Path) -> None:
    log = tmp_path / "s.jsonl"
    writer = LogWriter(log, "S1", signer=MINE, on_error=lambda _: None)
    with no_file_longer_than(3000):
        for event in kept(long_story()):
            writer.append(event)
        with pytest.raises(LogError, match="records at its end could not be written"):
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
    paths = [new_log_path(tmp_path, "S1") for _ in range(2)]
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
