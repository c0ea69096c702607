"""No change to a log goes unnoticed, and the first bad line is named."""

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.schema.document import DocumentError
from pa_console.session.log.chain import LogError, read_log
from pa_console.session.log.verification import VerifyResult, verify
from tests.session.logs import write_log
from tests.session.story import story
from tests.session.tamper import rehashed

pytestmark = pytest.mark.invariant

Tamper = Callable[[bytes], VerifyResult]


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The bytes of a sound log."""
    return write_log(tmp_path_factory.mktemp("log") / "s.jsonl", story()).read_bytes()


@pytest.fixture(scope="module")
def check(tmp_path_factory: pytest.TempPathFactory) -> Tamper:
    """Verify the given bytes as a log."""
    path = tmp_path_factory.mktemp("tampered") / "t.jsonl"

    def verified(content: bytes) -> VerifyResult:
        path.write_bytes(content)
        return verify(path)

    return verified


def lines_of(content: bytes) -> list[bytes]:
    return content.splitlines(keepends=True)


def test_a_sound_log_is_sound(original: bytes, check: Tamper) -> None:
    result = check(original)
    assert result.ok
    assert result.lines == len(lines_of(original))
    assert (result.first_bad_line, result.problem, result.note) == (None, "", "")
    assert result.session == "S1"


def test_the_hash_is_sha256_of_the_canonical_json_of_the_rest(original: bytes) -> None:
    before = "0" * 64
    for number, line in enumerate(lines_of(original), start=1):
        record: dict[str, Any] = json.loads(line)
        stated = record.pop("hash")
        assert list(record) == ["seq", "t", "tick", "session", "mission", "kind", "data", "prev"]
        canonical = json.dumps(
            record, sort_keys=True, separators=(",", ":"), ensure_ascii=False
        ).encode()
        assert hashlib.sha256(canonical).hexdigest() == stated
        assert (record["seq"], record["prev"]) == (number, before)
        assert record["t"].endswith("Z")
        before = stated


@given(st.data())
@settings(max_examples=100, deadline=None)
def test_any_changed_byte_is_found_on_its_line(
    original: bytes, check: Tamper, data: st.DataObject
) -> None:
    place = data.draw(st.integers(0, len(original) - 1))
    byte = data.draw(st.integers(0, 255).filter(lambda value: value != original[place]))
    result = check(original[:place] + bytes([byte]) + original[place + 1 :])
    assert not result.ok
    before = original[:place].count(b"\n")
    assert (result.lines, result.first_bad_line) == (before, before + 1)
    assert result.problem


@given(st.data())
@settings(max_examples=100, deadline=None)
def test_any_inserted_or_deleted_byte_is_found(
    original: bytes, check: Tamper, data: st.DataObject
) -> None:
    place = data.draw(st.integers(0, len(original) - 1))
    deleted = data.draw(st.booleans())
    inserted = b"" if deleted else bytes([data.draw(st.integers(0, 255))])
    result = check(original[:place] + inserted + original[place + deleted :])
    assert not result.ok
    line = original[:place].count(b"\n") + 1
    assert result.first_bad_line in (line, line + 1)


@given(st.data())
@settings(max_examples=100, deadline=None)
def test_removed_repeated_and_swapped_lines_are_found(
    original: bytes, check: Tamper, data: st.DataObject
) -> None:
    lines = lines_of(original)
    first = data.draw(st.integers(0, len(lines) - 2))
    second = data.draw(st.integers(first + 1, len(lines) - 1))
    removed = lines[:first] + lines[second:]
    assert check(b"".join(removed)).first_bad_line == first + 1
    repeated = [*lines[: second + 1], lines[first], *lines[second + 1 :]]
    assert check(b"".join(repeated)).first_bad_line == second + 2
    swapped = lines.copy()
    swapped[first], swapped[second] = lines[second], lines[first]
    assert check(b"".join(swapped)).first_bad_line == first + 1


@given(st.data())
@settings(max_examples=100, deadline=None)
def test_a_cut_is_found_or_noted(original: bytes, check: Tamper, data: st.DataObject) -> None:
    cut = data.draw(st.integers(0, len(original) - 1))
    result = check(original[:cut])
    whole = original[:cut].count(b"\n")
    assert result.lines == whole
    if cut == 0 or original[cut - 1 : cut] == b"\n":
        assert result.ok
        assert result.note == "the log is empty" if cut == 0 else "no session end" in result.note
    else:
        assert result.first_bad_line == whole + 1
        assert "cut short" in result.problem


@pytest.mark.parametrize(
    ("changes", "line", "problem"),
    [
        ({"tick": 1}, 3, "the record was replaced and its hash recomputed"),
        ({"kind": "explosion"}, 3, "unknown kind of event “explosion”"),
        ({"kind": ["x"]}, 3, "unknown kind"),
        ({"kind": "session_ended"}, 3, "reason"),
        ({"data": []}, 3, "data must be an object"),
        ({"seq": 9}, 3, "seq is 9, not 3"),
        ({"prev": "0" * 64}, 3, "prev is not"),
        ({"session": "S2"}, 3, "another session"),
        ({"t": "yesterday"}, 3, "t: "),
        ({"mission": float("nan")}, 3, "NaN is not a JSON number"),
    ],
)
def test_a_forged_record_is_found(
    original: bytes, check: Tamper, changes: dict[str, Any], line: int, problem: str
) -> None:
    lines = lines_of(original)
    lines[2] = rehashed(lines[2], **changes)
    result = check(b"".join(lines))
    assert result.first_bad_line == line
    assert problem in result.problem


@pytest.mark.parametrize(
    ("written", "respelled"),
    [
        (b'"seq":3,', b'"seq": 3,'),
        (b'"seq":3,', b'"seq":03,'),
        (b'"seq":3,', b'"seq":3,"seq":3,'),
        (b'"speed_mps":5.0', b'"speed_mps":5.00'),
        (b'"gate":"GateA"', b'"gate":"G\\u0061teA"'),
        (b'"tick":7,"session":"S1",', b'"session":"S1","tick":7,'),
    ],
)
def test_the_same_said_in_other_letters_is_found(
    original: bytes, check: Tamper, written: bytes, respelled: bytes
) -> None:
    lines = lines_of(original)
    assert written in lines[2]
    lines[2] = lines[2].replace(written, respelled)
    assert check(b"".join(lines)).first_bad_line == 3


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"null",
        b"[]",
        b"{}",
        b"{",
        b'"seq"',
        b"\xff\xfe",
        b"NaN",
        b"[" * 5000,
        b"1" * 5000,
        b'{"seq":1,"t":"\\ud800","tick":0,"session":"","mission":null,"kind":"mission_started",'
        b'"data":{},"prev":"","hash":""}',
        b'{"seq":1,"t":"","tick":1e999,"session":"","mission":null,"kind":"mission_started",'
        b'"data":{"a":' + b"[" * 300 + b"]" * 300 + b'},"prev":"","hash":""}',
    ],
)
def test_rubbish_is_an_error_with_its_line_and_never_a_crash(
    original: bytes, check: Tamper, tmp_path: Path, line: bytes
) -> None:
    content = b"".join(lines_of(original)[:2]) + line + b"\n"
    assert check(content).first_bad_line == 3
    path = tmp_path / "s.jsonl"
    path.write_bytes(content)
    events = read_log(path)
    assert [next(events), next(events)] == story()[:2]
    with pytest.raises(LogError) as caught:
        next(events)
    assert (caught.value.source, caught.value.line) == (str(path), 3)
    assert str(caught.value).startswith(f"{path}:3: ")


@given(st.binary(max_size=200))
@settings(max_examples=100, deadline=None)
def test_any_bytes_are_refused_politely(check: Tamper, content: bytes) -> None:
    result = check(content)
    assert result.ok == (content == b"")


def test_a_missing_log_is_an_error_for_files(tmp_path: Path) -> None:
    with pytest.raises(DocumentError, match="No such file"):
        verify(tmp_path / "none.jsonl")
    with pytest.raises(DocumentError, match="No such file"):
        next(read_log(tmp_path / "none.jsonl"))
