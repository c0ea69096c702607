"""Names what happened to a log of which one line does not fit, from the lines around it."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast

from pa_console.schema.event import LogSigned
from pa_console.session.chain import Record, digest, lines_of, link_problem, own_problem, parse
from pa_console.session.head import Head

DamageKind = Literal[
    "half-line", "cut-short", "removed", "inserted", "duplicated", "swapped", "moved", "garbage",
    "edited-field", "edited-hash", "edited", "respelled", "replaced", "header-replaced",
    "rewritten", "signature", "signatures-removed", "unknown-key",
    "head-missing", "head-damaged", "head-of-another-log",
]  # fmt: skip
_SEQ = re.compile(rb'\{"seq":(\d{1,18}),')


@dataclass(frozen=True)
class Damage:
    """What is wrong, first on `line`; with `through`, somewhere from there to that line.

    `line` is None when the head beside the log is to blame.
    """

    kind: DamageKind
    line: int | None
    problem: str
    through: int | None = None


@dataclass
class Sound:
    """How far a log is sound: its last two records, and the lines that signatures vouch for."""

    lines: int = 0
    before: Record | None = None
    before_that: Record | None = None
    vouched: int = 0

    def add(self, record: Record) -> None:
        """Take in the next sound record."""
        self.lines += 1
        self.before_that, self.before = self.before, record


@dataclass
class _Around:
    """Lines elsewhere that explain a bad one: byte for byte the same, the next, and by number."""

    following: Record | None = None
    same_before: int | None = None
    same_after: int | None = None
    wanted_after: int | None = None
    own_number_after: bool = False


def find_damage(path: Path, sound: Sound, line: bytes, problem: str, head: Head | None) -> Damage:
    """Return what happened to `line`, which follows the sound lines and has `problem`."""
    number, record = sound.lines + 1, _record(line)
    around = _look_around(path, number, line)
    following = around.following
    if around.same_before is not None:
        return Damage("duplicated", number, f"this line repeats line {around.same_before}")
    rejoined = following is not None and not link_problem(following, sound.before)
    if record is not None and not own_problem(record):
        return _misplaced(record, sound, around, rejoined, problem)
    if rejoined:
        return Damage("inserted", number, f"a line was inserted here: {problem}")
    if record is None:
        return Damage("garbage", number, problem)
    return _edited(record, sound, following, head)


def find_forgery(path: Path, sound: Sound, line: bytes, record: Record) -> Damage:
    """Return what happened to a signed record, in its place in the chain, whose signature is bad.

    Whoever changes an earlier line and recomputes every hash cannot sign the new ones.
    """
    number = sound.lines + 1
    following = _look_around(path, number, line).following
    if following is not None and following.fields["prev"] != record.hash:
        problem = "the signature is not of what the record says: one of them was changed"
        return Damage("signature", number, problem)
    first = sound.vouched + 1
    problem = f"lines {first} to {number} were rewritten with recomputed hashes: the signature on "
    return Damage("rewritten", first, f"{problem}line {number} is of other lines", number)


def _edited(record: Record, sound: Sound, following: Record | None, head: Head | None) -> Damage:
    """Tell what of a record was edited whose hash is not that of what it says."""
    number, true = sound.lines + 1, digest(record.fields)
    if record.hash == true:
        problem = "the record was edited: it says the same in other letters"
        return Damage("respelled", number, problem)
    for field, value in _wanted(sound).items():
        if digest({**record.fields, field: value}) == record.hash:
            return Damage("edited-field", number, f"the field {field} was edited: it was {value!r}")
    witness = head.hash if head is not None and head.seq == number else ""
    if following is not None:
        witness = str(following.fields["prev"])
    if witness == true:
        return Damage("edited-hash", number, "the hash was edited: the record after has another")
    problem = "the record was edited: its hash does not match what it says"
    if witness != record.hash:
        return Damage("edited", number, problem)
    if isinstance(record.event.data, LogSigned):
        return Damage("signature", number, f"{problem}; so the signature is worth nothing")
    return Damage("edited-field", number, problem)


def _wanted(sound: Sound) -> dict[str, object]:
    """Return the fields that the record after the sound ones must have."""
    if sound.before is None:
        return {"seq": 1, "prev": "0" * 64}
    session = sound.before.fields["session"]
    return {"seq": sound.lines + 1, "prev": sound.before.hash, "session": session}


def _misplaced(
    record: Record, sound: Sound, around: _Around, rejoined: bool, problem: str
) -> Damage:
    """Tell why a record that is sound by itself does not follow the one before."""
    number, seq = sound.lines + 1, cast(object, record.fields["seq"])
    if isinstance(seq, int) and seq > number:
        return _too_early(seq, number, rejoined, around, problem)
    if rejoined:
        return Damage("inserted", number, f"a record was inserted here: {problem}")
    if seq == number:
        return _broken_link(record, sound, around.following, problem)
    if sound.vouched < sound.lines and not link_problem(record, sound.before_that):
        return Damage("inserted", sound.lines, "a record was inserted here, with a fitting hash")
    return Damage("inserted", number, f"a record was inserted here: {problem}")


def _too_early(seq: int, number: int, rejoined: bool, around: _Around, problem: str) -> Damage:
    """Tell why record `seq` stands on the earlier line `number`."""
    if around.same_after is not None:
        return Damage("duplicated", number, f"this line repeats line {around.same_after}")
    if around.wanted_after is not None and not around.own_number_after:
        if around.wanted_after == seq:
            return Damage("swapped", number, f"lines {number} and {seq} were swapped")
        problem = f"lines were moved: record {number} is on line {around.wanted_after}"
        return Damage("moved", number, problem)
    if rejoined:
        return Damage("inserted", number, f"a record was inserted here: {problem}")
    if around.following is not None and around.following.fields["seq"] == number + 1:
        return Damage("replaced", number, f"the record was replaced: {problem}")
    count = f"{seq - number} records" if seq > number + 1 else "one record"
    return Damage("removed", number, f"{count} removed before this line: seq is {seq}")


def _broken_link(record: Record, sound: Sound, following: Record | None, problem: str) -> Damage:
    """Tell which of two records was replaced, each sound by itself, that are not linked."""
    number = sound.lines + 1
    linked = sound.before is None or record.fields["prev"] == sound.before.hash
    forged = following is not None and following.fields["prev"] != record.hash
    if linked or forged or sound.vouched == sound.lines:
        bad = number
    else:
        bad = number - 1
        problem = "the record was replaced, its hash recomputed: the next has the hash of another"
    if bad == 1:
        return Damage("header-replaced", bad, f"the first record was replaced: {problem}")
    return Damage("replaced", bad, problem)


def _look_around(path: Path, number: int, bad: bytes) -> _Around:
    """Read the log once more for what the line `number`, which is `bad`, has to do with others."""
    around, own = _Around(), _SEQ.match(bad)
    with path.open("rb") as file:
        for at, line in enumerate(lines_of(file), start=1):
            if at == number:
                continue
            text = line.removesuffix(b"\n")
            if at < number:
                if text == bad:
                    around.same_before = around.same_before or at
                continue
            if at == number + 1:
                around.following = _record(text)
            if text == bad:
                around.same_after = around.same_after or at
            if found := _SEQ.match(text):
                if int(found[1]) == number:
                    around.wanted_after = around.wanted_after or at
                around.own_number_after |= own is not None and own[1] == found[1]
    return around


def _record(line: bytes) -> Record | None:
    try:
        return parse(line)
    except ValueError:
        return None
