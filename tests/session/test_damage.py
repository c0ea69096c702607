"""Every kind of damage to a signed log is detected and named, with its line."""

from pathlib import Path
from typing import get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.session.log.signed_head import head_path
from pa_console.session.log.verification import DamageKind, verify
from pa_console.session.stills import stills_folder
from tests.session.tamper import (
    KNOWN,
    TAMPERS,
    Tamper,
    damaged,
    write_signed,
    write_with_picture,
)

pytestmark = pytest.mark.invariant


@pytest.mark.parametrize("tamper", TAMPERS, ids=lambda tamper: tamper.name)
def test_each_kind_of_damage_is_named_with_its_line(tamper: Tamper, tmp_path: Path) -> None:
    found = damaged(tamper, tmp_path)
    assert not found.ok
    assert not found.intact
    assert (found.damage, found.first_bad_line) == (tamper.kind, tamper.line)
    assert found.problem
    assert found.vouched <= found.lines < (tamper.line or 100)


def test_every_kind_that_can_be_named_is_among_them() -> None:
    assert {tamper.kind for tamper in TAMPERS} == set(get_args(DamageKind))


def test_a_log_without_its_stills_is_sound_and_says_so(tmp_path: Path) -> None:
    still = write_with_picture(log := tmp_path / "s.jsonl")
    assert verify(log, KNOWN).intact
    (stills_folder(log) / still.file_name).unlink()
    found = verify(log, KNOWN)
    assert found.intact
    assert "1 of 1 stills" in found.note


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a sound log in a folder of its own."""
    return write_signed(tmp_path_factory.mktemp("signed") / "s.jsonl")


@pytest.fixture(scope="module")
def original(log: Path) -> bytes:
    return log.read_bytes()


def flipped(content: bytes, data: st.DataObject) -> tuple[int, bytes]:
    place = data.draw(st.integers(0, len(content) - 1))
    byte = content[place] ^ data.draw(st.integers(1, 255))
    line = content[:place].count(b"\n") + 1
    return line, content[:place] + bytes([byte]) + content[place + 1 :]


@given(st.data())
@settings(max_examples=100, deadline=None)
def test_a_changed_byte_anywhere_in_a_log_is_found_on_its_line(
    log: Path, original: bytes, data: st.DataObject
) -> None:
    line, changed = flipped(original, data)
    log.write_bytes(changed)
    found = verify(log, KNOWN)
    log.write_bytes(original)
    assert (found.ok, found.first_bad_line) == (False, line)


@given(st.data())
@settings(max_examples=40, deadline=None)
def test_a_changed_byte_anywhere_in_a_head_is_found(log: Path, data: st.DataObject) -> None:
    head = head_path(log)
    content = head.read_bytes()
    _, changed = flipped(content, data)
    head.write_bytes(changed)
    found = verify(log, KNOWN)
    head.write_bytes(content)
    assert found.damage == "head-damaged"


def test_a_cut_before_the_first_signature_is_a_cut(log: Path, original: bytes) -> None:
    log.write_bytes(original[: original.index(b"\n") + 1])
    found = verify(log, KNOWN)
    log.write_bytes(original)
    assert (found.damage, found.first_bad_line) == ("cut-short", 2)


@given(st.data())
@settings(max_examples=60, deadline=None)
def test_a_cut_of_a_closed_log_is_found_wherever_it_is(
    log: Path, original: bytes, data: st.DataObject
) -> None:
    cut = data.draw(st.integers(0, len(original) - 1))
    log.write_bytes(original[:cut])
    found = verify(log, KNOWN)
    log.write_bytes(original)
    assert found.damage == "cut-short"
    assert found.first_bad_line == original[:cut].count(b"\n") + 1
