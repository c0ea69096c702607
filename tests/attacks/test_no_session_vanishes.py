"""A session log that is deleted, cut, swapped or rolled back is missed by the index of sessions."""

import shutil
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pa_console.cli.verbs.doctor.checks import check_sessions
from pa_console.session.log.session_index import (
    INDEX_NAME,
    IndexLine,
    IndexReport,
    SessionIndex,
    anchor_path,
    check_index,
)
from pa_console.session.log.signed_head import head_path, sign_head, write_head
from pa_console.session.log.writer import LogWriter, new_log_path
from pa_console.signing import KEY_VARIABLE, Signer, load_signer
from tests.cli.inside import Call
from tests.session.story import story
from tests.session.tamper import OTHER, long_story


@pytest.fixture(autouse=True)
def signer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Signer:
    """Return this machine's key, whose folder no attacker on the logs can write to."""
    monkeypatch.setenv(KEY_VARIABLE, str(tmp_path / "config" / "key.pem"))
    return load_signer()


@pytest.fixture
def folder(tmp_path: Path, signer: Signer) -> Path:
    """Return a folder with the logs of three sessions that ended in order."""
    for number in range(3):
        write(tmp_path / "sessions", f"S{number}", signer)
    return tmp_path / "sessions"


def write(folder: Path, session: str, signer: Signer, *, crash: bool = False) -> Path:
    log = new_log_path(folder, session)
    index = SessionIndex(folder, signer)
    writer = LogWriter(log, session, signer=signer, index=index, clock=lambda: 0.0)
    for event in long_story():
        writer.append(event)
    if crash:
        files = (*folder.iterdir(), anchor_path(folder))
        kept = {path: path.read_bytes() for path in files}
        writer.close()
        for path, content in kept.items():
            path.write_bytes(content)
    else:
        writer.close()
    return log


def checked(folder: Path, signer: Signer) -> IndexReport:
    return check_index(folder, {signer.fingerprint})


def test_sessions_that_are_all_there_are_told_as_such(folder: Path, signer: Signer) -> None:
    report = checked(folder, signer)
    assert report.all_problems == ()
    assert [(found.log, found.ended) for found in report.sessions] == [
        (f"S{n}.jsonl", True) for n in range(3)
    ]
    crashed = write(folder, "S9", signer, crash=True)
    report = checked(folder, signer)
    assert report.all_problems == ()
    assert (report.sessions[-1].log, report.sessions[-1].ended) == (crashed.name, False)
    assert check_sessions(folder).state == "ok"


def test_a_log_that_vanished_is_named(folder: Path, signer: Signer, call: Call) -> None:
    gone = folder / "S1.jsonl"
    gone.unlink()
    head_path(gone).unlink()
    assert checked(folder, signer).all_problems == ("S1.jsonl: the log of session S1 is missing",)
    found = check_sessions(folder)
    assert found.state == "warning"
    assert "S1.jsonl" in found.found
    done = call("replay", str(folder / "S0.jsonl"), "--verify", "--chain-only")
    assert done.code == 0
    assert "S1.jsonl: the log of session S1 is missing" in done.said


def test_a_log_that_was_rolled_back_with_its_head_is_damaged(
    folder: Path, signer: Signer, call: Call
) -> None:
    """An older copy of log and head is sound by itself: only the index knows of the rest."""
    log = folder / "S1.jsonl"
    lines = log.read_bytes().splitlines(keepends=True)
    assert IndexLine.parse((folder / INDEX_NAME).read_bytes().splitlines(keepends=True)[3]).ended
    with LogWriter(folder.parent / "old.jsonl", "S1", signer=signer, clock=lambda: 0.0) as writer:
        for event in long_story()[:5]:
            writer.append(event)
    cut = lines[:2]
    log.write_bytes(b"".join(cut))
    write_head(log, sign_head("S1", 2, cut[1].split(b'"hash":"')[1][:64].decode(), False, signer),
               lasting=False)  # fmt: skip
    done = call("replay", str(log), "--verify", "--chain-only")
    assert done.code == 2
    assert "S1.jsonl: cut short: session S1 ended with" in done.said


def test_a_log_in_the_place_of_another_is_named(folder: Path, signer: Signer) -> None:
    for name in ("S1.jsonl", "S1.jsonl.head"):
        shutil.copy(folder / name.replace("1", "2"), folder / name)
    assert "record 1 is not the one that session S1 had" in checked(folder, signer).all_problems[0]


def test_a_copy_of_a_log_under_another_name_is_named(
    folder: Path, signer: Signer, call: Call
) -> None:
    """The copy is signed and whole by itself: only the index knows that it is no session more."""
    copy = folder / "S1-again.jsonl"
    for name in ("", ".head"):
        shutil.copy(f"{folder / 'S1.jsonl'}{name}", f"{copy}{name}")
    problem = "S1-again.jsonl: a copy of S1.jsonl, the log of session S1"
    assert checked(folder, signer).all_problems == (problem,)
    assert problem in check_sessions(folder).found
    done = call("replay", str(copy), "--verify", "--chain-only")
    assert done.code == 2
    assert problem in done.said
    assert call("replay", str(folder / "S1.jsonl"), "--verify", "--chain-only").code == 0
    (folder / "S1.jsonl").unlink()
    assert problem in checked(folder, signer).all_problems


def test_a_log_that_no_index_has_is_no_copy(folder: Path, signer: Signer) -> None:
    with LogWriter(folder / "own-name.jsonl", "S7", signer=signer, clock=lambda: 0.0) as writer:
        writer.append(long_story()[0])
    (folder / "notes.jsonl").write_text("[1]\n")
    (folder / "empty.jsonl").write_text("")
    (folder / "folder.jsonl").mkdir()
    assert checked(folder, signer).all_problems == ()


@settings(
    max_examples=200,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=st.data())
def test_no_line_of_the_index_goes_unseen(
    folder: Path, signer: Signer, data: st.DataObject
) -> None:
    """Cut, removed, swapped, doubled, edited, forged by another key, with or without a log."""
    index = folder / INDEX_NAME
    good = index.read_bytes()
    lines = good.splitlines(keepends=True)
    number = data.draw(st.integers(0, len(lines) - 1))
    how = data.draw(st.sampled_from(["cut", "remove", "swap", "double", "edit", "forge", "all"]))
    entry = IndexLine.parse(lines[number])
    match how:
        case "cut":
            lines = lines[:number]
        case "remove":
            del lines[number]
        case "swap":
            other = data.draw(st.integers(0, len(lines) - 1).filter(lambda n: n != number))
            lines[number], lines[other] = lines[other], lines[number]
        case "double":
            lines.insert(number, lines[number])
        case "edit":
            at = data.draw(st.integers(0, len(lines[number]) - 2))
            bad = lines[number][at : at + 1]
            lines[number] = lines[number][:at] + bytes([bad[0] ^ 1]) + lines[number][at + 1 :]
        case "forge":
            fields = entry.model_dump(exclude={"key", "signature"}) | {"session": "S7"}
            lines[number] = IndexLine.signed(OTHER, **fields).line
        case _:
            lines = []
    index.write_bytes(b"".join(lines))
    try:
        assert checked(folder, signer).problems
    finally:
        index.write_bytes(good)


@pytest.mark.parametrize("left", [0, 2, 5])
def test_what_was_cut_off_the_index_stays_known_when_the_next_session_comes(
    folder: Path, signer: Signer, left: int
) -> None:
    index = folder / INDEX_NAME
    lines = index.read_bytes().splitlines(keepends=True)
    index.write_bytes(b"".join(lines[:left]))
    write(folder, "S8", signer)
    told = " ".join(checked(folder, signer).problems)
    assert f"lines {left + 1} to 6 of the index are gone" in told


def test_a_torn_line_keeps_no_session_from_its_log(folder: Path, signer: Signer) -> None:
    with (folder / INDEX_NAME).open("ab") as file:
        file.write(b'{"ended":fal')
    assert checked(folder, signer).problems == (), "power failed while it was written"
    write(folder, "S8", signer)
    report = checked(folder, signer)
    assert [found.log for found in report.sessions][-1] == "S8.jsonl"
    assert report.problems == ()
    assert (folder / f"{INDEX_NAME}.torn").read_bytes() == b'{"ended":fal\n'


def test_a_line_that_was_written_and_then_cut_in_two_is_missed(
    folder: Path, signer: Signer
) -> None:
    index = folder / INDEX_NAME
    index.write_bytes(index.read_bytes()[:-9])
    assert "its last line that this machine wrote is gone" in checked(folder, signer).problems[0]
    write(folder, "S8", signer)
    assert "lines 6 to 6 of the index are gone" in checked(folder, signer).problems[0]


def test_a_session_before_its_first_event_is_not_in_the_index(
    tmp_path: Path, signer: Signer
) -> None:
    log = new_log_path(tmp_path / "new", "S1")
    with LogWriter(log, "S1", signer=signer, index=SessionIndex(log.parent, signer)) as writer:
        assert not (log.parent / INDEX_NAME).exists()
        writer.append(story()[0])
        report = checked(log.parent, signer)
        assert [(found.log, found.ended) for found in report.sessions] == [("S1.jsonl", False)]
    assert checked(log.parent, signer).sessions[-1].ended
    assert anchor_path(log.parent).is_file()
