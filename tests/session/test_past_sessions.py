"""What a recorded session was about is told from its log, and whether the log can be relied on."""

from pathlib import Path

import pytest

from pa_console.session.log.chain import LogError
from pa_console.session.log.writer import LogWriter
from pa_console.session.past_sessions import (
    find_session,
    past_sessions,
    soundness,
    summarise,
)
from pa_console.signing import KEY_VARIABLE, load_signer
from pa_console.views.status_words import outcomes_in_words
from tests.session.logs import kept, write_log


@pytest.fixture(autouse=True)
def _own_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:  # pyright: ignore[reportUnusedFunction]
    monkeypatch.setenv(KEY_VARIABLE, str(tmp_path / "key" / "key.pem"))


def test_a_session_is_summed_up_by_its_orders_and_their_ends(tmp_path: Path) -> None:
    happened = kept()
    found = summarise(write_log(tmp_path / "a.jsonl", happened))
    received = [e.data.mission for e in happened if e.data.kind == "mission_received"]
    finished = [e.data.status for e in happened if e.data.kind == "mission_finished"]
    assert [mission.said for mission in found.missions] == [m.said for m in received]
    assert [m.status for m in found.missions if m.status] == finished
    own = [m.said for m in received if m.source == "operator"]
    assert found.title == own[0]
    assert found.length_s == (happened[-1].t - happened[0].t).total_seconds()
    assert sum(found.outcomes.values()) == len(received)
    assert outcomes_in_words(found.outcomes)


def test_a_log_without_the_end_of_its_session_is_open_and_one_with_a_bad_line_damaged(
    tmp_path: Path,
) -> None:
    happened = [event for event in kept() if event.data.kind != "session_ended"]
    log = write_log(tmp_path / "a.jsonl", happened)
    assert summarise(log).ending == "open"
    with log.open("a") as file:
        file.write('{"seq":99\n')
    found = summarise(log)
    assert found.ending == "damaged"
    assert f"a.jsonl:{len(happened) + 1}" in found.reason


def test_what_is_no_log_is_an_error_and_left_out_of_the_list(tmp_path: Path) -> None:
    (tmp_path / "notes.jsonl").write_text('{"a": 1}\n')
    (tmp_path / "empty.jsonl").write_text("")
    log = write_log(tmp_path / "good.jsonl", kept())
    for name in ("notes.jsonl", "empty.jsonl"):
        with pytest.raises(LogError):
            summarise(tmp_path / name)
    assert [found.log for found in past_sessions(tmp_path)] == [log]


def test_a_log_is_verified_running_open_unsigned_or_damaged(tmp_path: Path) -> None:
    happened, log = kept(), tmp_path / "a.jsonl"
    writer = LogWriter(log, "S1", signer=load_signer())
    for event in happened:
        writer.append(event)
    writer.flush()
    assert soundness(log).standing == "running"
    writer.close()
    assert soundness(log).standing == "verified"
    assert soundness(write_log(tmp_path / "b.jsonl", happened)).standing == "unsigned"
    lines = log.read_bytes().splitlines(keepends=True)
    log.write_bytes(b"".join(lines[:-3]))
    assert soundness(log).standing == "damaged"
    assert soundness(tmp_path / "none.jsonl").standing == "damaged"


def test_a_session_is_found_by_its_id_by_how_it_begins_and_as_the_last(tmp_path: Path) -> None:
    logs = [write_log(tmp_path / f"2026{day}.jsonl", kept()) for day in ("0101", "0102")]
    assert find_session(tmp_path, "20260101") == logs[0]
    assert find_session(tmp_path, str(logs[0])) == logs[0]
    assert find_session(tmp_path, "last") == logs[1]
    with pytest.raises(ValueError, match="2 sessions: 20260101, 20260102"):
        find_session(tmp_path, "2026")
    with pytest.raises(ValueError, match="there is no session “x”"):
        find_session(tmp_path, "x")
