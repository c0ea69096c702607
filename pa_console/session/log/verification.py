"""Verification of a session log: its chain, signatures, signed head and stills, and any damage."""

import re
from collections.abc import Collection
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import Literal, cast

from pa_console.schema.events.event import CameraStill, LogSigned
from pa_console.session.log.chain import (
    TORN,
    LogError,
    LogRecord,
    digest,
    lines_of,
    link_problem,
    own_problem,
    parse,
    read_lines,
    signed_part,
)
from pa_console.session.log.signed_head import SignedHead, head_path, read_head
from pa_console.session.stills import is_changed, stills_folder
from pa_console.signing import fingerprint, is_signature, known_keys

DamageKind = Literal[
    "half-line", "cut-short", "removed", "inserted", "duplicated", "swapped", "moved", "garbage",
    "edited-field", "edited-hash", "edited", "respelled", "replaced", "header-replaced",
    "rewritten", "signature", "signatures-removed", "unknown-key",
    "head-missing", "head-damaged", "head-of-another-log", "picture-changed",
]  # fmt: skip
_SEQ = re.compile(rb'\{"seq":(\d{1,18}),')

ADJUSTED = timedelta(seconds=1)
"""The smallest step back of the clock that is noted; time synchronization makes smaller steps."""
FIRST_SIGNED = 2
"""The line of a log's first signature, after the line that names the session."""
Standing = Literal["signed", "open", "not signed"]
"""How far a log is signed: up to its closing, without a closing, or not at all."""


@dataclass(frozen=True)
class Damage:
    """Damage to a log on `line`, or somewhere from `line` to `through`.

    `line` is None if the head beside the log is damaged.
    """

    kind: DamageKind
    line: int | None
    problem: str
    through: int | None = None


@dataclass
class SoundPart:
    """The undamaged beginning of a log.

    `before` is its last record and `before_that` the one before; `vouched` counts signed lines.
    """

    lines: int = 0
    before: LogRecord | None = None
    before_that: LogRecord | None = None
    vouched: int = 0

    def add(self, record: LogRecord) -> None:
        """Add the next undamaged record."""
        self.lines += 1
        self.before_that, self.before = self.before, record


@dataclass
class _NearbyLines:
    """Lines that explain a bad line: equal lines, the next line, and lines with the same numbers.

    `wanted_after` is the later line that has the number of the bad line's place. `own_number_after`
    is True if a later line has the same number as the bad line.
    """

    following: LogRecord | None = None
    same_before: int | None = None
    same_after: int | None = None
    wanted_after: int | None = None
    own_number_after: bool = False


def find_damage(
    path: Path, sound: SoundPart, line: bytes, problem: str, head: SignedHead | None
) -> Damage:
    """Return the damage to `line`, the first line after the sound ones, which has a `problem`."""
    number, record = sound.lines + 1, _record(line)
    context = _look_around(path, number, line)
    following = context.following
    if context.same_before is not None:
        return Damage("duplicated", number, f"this line repeats line {context.same_before}")
    rejoined = following is not None and not link_problem(following, sound.before)
    if record is not None and not own_problem(record):
        return _misplaced(record, sound, context, rejoined, problem)
    if rejoined:
        return Damage("inserted", number, f"a line was inserted here: {problem}")
    if record is None:
        return Damage("garbage", number, problem)
    return _edited(record, sound, following, head)


def find_forgery(path: Path, sound: SoundPart, line: bytes, record: LogRecord) -> Damage:
    """Return the damage to a signature record that is linked but has an invalid signature.

    An attacker who changes an earlier line can recompute every hash, but not the signatures.
    """
    number = sound.lines + 1
    following = _look_around(path, number, line).following
    if following is not None and following.fields["prev"] != record.hash:
        problem = "the signature does not match the record: one of them was changed"
        return Damage("signature", number, problem)
    first = sound.vouched + 1
    problem = f"lines {first} to {number} were rewritten with recomputed hashes: the signature on "
    return Damage("rewritten", first, f"{problem}line {number} does not match them", number)


def _edited(
    record: LogRecord, sound: SoundPart, following: LogRecord | None, head: SignedHead | None
) -> Damage:
    """Return the damage to a record whose hash does not match its content."""
    number, true = sound.lines + 1, digest(record.fields)
    if record.hash == true:
        problem = "the record was edited: it has the same content in another notation"
        return Damage("respelled", number, problem)
    for field, value in _wanted(sound).items():
        if digest({**record.fields, field: value}) == record.hash:
            return Damage("edited-field", number, f"the field {field} was edited: it was “{value}”")
    witness = head.hash if head is not None and head.seq == number else ""
    if following is not None:
        witness = str(following.fields["prev"])
    if witness == true:
        return Damage("edited-hash", number, "the hash was edited: the next record has another")
    problem = "the record was edited: its hash does not match its content"
    if witness != record.hash:
        return Damage("edited", number, problem)
    if isinstance(record.event.data, LogSigned):
        return Damage("signature", number, f"{problem}, so its signature proves nothing")
    return Damage("edited-field", number, problem)


def _wanted(sound: SoundPart) -> dict[str, object]:
    """Return the values that the record after the last sound record must have."""
    if sound.before is None:
        return {"seq": 1, "prev": "0" * 64}
    session = sound.before.fields["session"]
    return {"seq": sound.lines + 1, "prev": sound.before.hash, "session": session}


def _misplaced(
    record: LogRecord, sound: SoundPart, context: _NearbyLines, rejoined: bool, problem: str
) -> Damage:
    """Return the damage at a record that is valid by itself but does not follow its predecessor."""
    number, seq = sound.lines + 1, cast(object, record.fields["seq"])
    if isinstance(seq, int) and seq > number:
        return _too_early(seq, number, rejoined, context, problem)
    if rejoined:
        return Damage("inserted", number, f"a record was inserted here: {problem}")
    if seq == number:
        return _broken_link(record, sound, context.following, problem)
    if sound.vouched < sound.lines and not link_problem(record, sound.before_that):
        return Damage("inserted", sound.lines, "a record was inserted here, with a fitting hash")
    return Damage("inserted", number, f"a record was inserted here: {problem}")


def _too_early(
    seq: int, number: int, rejoined: bool, context: _NearbyLines, problem: str
) -> Damage:
    """Return the damage if record `seq` is on the earlier line `number`."""
    if context.same_after is not None:
        return Damage("duplicated", number, f"this line repeats line {context.same_after}")
    if context.wanted_after is not None and not context.own_number_after:
        if context.wanted_after == seq:
            return Damage("swapped", number, f"lines {number} and {seq} were swapped")
        problem = f"lines were moved: record {number} is on line {context.wanted_after}"
        return Damage("moved", number, problem)
    if rejoined:
        return Damage("inserted", number, f"a record was inserted here: {problem}")
    if context.following is not None and context.following.fields["seq"] == number + 1:
        return Damage("replaced", number, f"the record was replaced: {problem}")
    count = f"{seq - number} records" if seq > number + 1 else "one record"
    return Damage("removed", number, f"{count} removed before this line, whose seq is {seq}")


def _broken_link(
    record: LogRecord, sound: SoundPart, following: LogRecord | None, problem: str
) -> Damage:
    """Return the damage by which two valid records are not linked: one of them was replaced."""
    number = sound.lines + 1
    linked = sound.before is None or record.fields["prev"] == sound.before.hash
    forged = following is not None and following.fields["prev"] != record.hash
    if linked or forged or sound.vouched == sound.lines:
        bad = number
    else:
        bad = number - 1
        problem = "the record was replaced and its hash recomputed: the next record has another"
    if bad == 1:
        return Damage("header-replaced", bad, f"the first record was replaced: {problem}")
    return Damage("replaced", bad, problem)


def _look_around(path: Path, number: int, bad: bytes) -> _NearbyLines:
    """Read the log again for the lines that explain the damage to line `number`, the text `bad`."""
    context, own = _NearbyLines(), _SEQ.match(bad)
    with path.open("rb") as file:
        for at, line in enumerate(lines_of(file), start=1):
            if at == number:
                continue
            text = line.removesuffix(b"\n")
            if at < number:
                if text == bad:
                    context.same_before = context.same_before or at
                continue
            if at == number + 1:
                context.following = _record(text)
            if text == bad:
                context.same_after = context.same_after or at
            if seq := _SEQ.match(text):
                if int(seq[1]) == number:
                    context.wanted_after = context.wanted_after or at
                context.own_number_after |= own is not None and own[1] == seq[1]
    return context


def _record(line: bytes) -> LogRecord | None:
    try:
        return parse(line)
    except ValueError:
        return None


@dataclass(frozen=True)
class VerifyResult:
    """The result of verifying a log; `ok` if no damage was found.

    The damage is on `first_bad_line`, counted from 1, or somewhere from there to `last_bad_line`.
    `lines` counts the undamaged lines. `head` is the hash of an undamaged log's last line, and
    `note` a remark on it. The key with the fingerprint `key` has signed the first `vouched` lines.
    """

    ok: bool
    lines: int
    first_bad_line: int | None = None
    problem: str = ""
    note: str = ""
    session: str = ""
    head: str = ""
    damage: DamageKind | None = None
    last_bad_line: int | None = None
    standing: Standing = "not signed"
    vouched: int = 0
    key: str = ""

    @property
    def intact(self) -> bool:
        """True if an accepted key has signed every line, including the closing of the log."""
        return self.ok and self.standing == "signed"


def verify(path: Path, accepted: Collection[str] | None = None) -> VerifyResult:
    """Check every record, the chain, the signatures, the head and the stills of a log.

    `accepted` are the fingerprints of accepted keys, by default those that this machine knows.
    Raises LogError if a file cannot be read, SigningError if the keys cannot be read.
    """
    try:
        head, head_problem = read_head(path), ""
    except ValueError as error:
        head, head_problem = None, str(error)
    chain = _Chain(path, head)
    damage = chain.read() or chain.key_damage(accepted)
    if damage is None and head_problem:
        damage = Damage("head-damaged", None, head_problem)
    damage = damage or chain.head_damage() or chain.still_damage()
    lines, last = chain.sound.lines, chain.sound.before
    if damage is not None and damage.line is not None:
        lines = min(lines, damage.line - 1)
    return VerifyResult(
        ok=damage is None,
        lines=lines,
        first_bad_line=damage and damage.line,
        problem=damage.problem if damage else "",
        note="" if damage else chain.note(),
        session=last.fields["session"] if last else "",
        head=last.hash if last and not damage else "",
        damage=damage and damage.kind,
        last_bad_line=damage and damage.through,
        standing=chain.standing(),
        vouched=min(chain.sound.vouched, lines),
        key=fingerprint(chain.key) if chain.key else "",
    )


class _Chain:
    """The chain of a log, read to its end or to its first damage."""

    def __init__(self, path: Path, head: SignedHead | None) -> None:
        self._path, self._head = path, head
        self.sound = SoundPart()
        self.key = ""
        self._key_line = 0
        self._hash_at_head = ""
        self._notes: list[str] = []
        self._stills: list[tuple[CameraStill, int]] = []
        """The stills that an operator was shown, each with its line number."""
        self._set_back: list[tuple[timedelta, int]] = []
        """The steps back of the clock, each with the number of the line after it."""

    def read(self) -> Damage | None:
        """Read every line; return the first damage to the chain or to a signature."""
        try:
            for _, line in read_lines(self._path):
                try:
                    record = parse(line)
                    problem = link_problem(record, self.sound.before)
                except ValueError as error:
                    record, problem = None, str(error)
                if record is None or problem:
                    return find_damage(self._path, self.sound, line, problem, self._head)
                if damage := self._add(record, line):
                    return damage
        except LogError as error:
            if not error.line:
                raise
            if error.problem != TORN:
                return Damage("garbage", error.line, error.problem)
            if self._head is not None and self._head.seq >= error.line:
                problem = f"{error.problem}, but the signed head covers {self._head.seq} lines"
                return Damage("cut-short", error.line, problem)
            problem = "; a crash leaves such a line, which is removed when the log is opened again"
            return Damage("half-line", error.line, error.problem + problem)
        return None

    def _add(self, record: LogRecord, line: bytes) -> Damage | None:
        number, signed = self.sound.lines + 1, record.event.data
        before = self.sound.before
        if before is not None and (back := before.event.t - record.event.t) >= ADJUSTED:
            self._set_back.append((back, number))
        if isinstance(signed, LogSigned):
            if not is_signature(signed.signature, signed_part(record.fields), signed.key):
                return find_forgery(self._path, self.sound, line, record)
            if self.key and signed.key != self.key:
                problem = f"signed by another key than line {self._key_line}"
                return Damage("unknown-key", number, f"{problem}: {fingerprint(signed.key)}")
            if not self.key:
                self.key, self._key_line = signed.key, number
            if signed.found:
                was = f"{signed.found} records before line {number} were still unsigned when"
                self._notes.append(f"{was} the log was opened again")
            self.sound.vouched = number
        elif isinstance(signed, CameraStill) and signed.sha256 is not None:
            self._stills.append((signed, number))
        self.sound.add(record)
        if self._head is not None and number == self._head.seq:
            self._hash_at_head = record.hash
        return None

    def key_damage(self, accepted: Collection[str] | None) -> Damage | None:
        """Return damage if the log is signed by a key that is not accepted."""
        if not self.key:
            return None
        accepted = known_keys() if accepted is None else accepted
        if (used := fingerprint(self.key)) in accepted:
            return None
        own = f"known here: {', '.join(sorted(accepted)) or 'none'}"
        problem = f"signed by an unknown key, {used} ({own}); whoever can rewrite a log can sign "
        problem += "it with a key of their own, so compare the key with that of the log's machine"
        return Damage("unknown-key", self._key_line, problem)

    def head_damage(self) -> Damage | None:
        """Return damage if an otherwise undamaged log does not match its signed head."""
        head, sound, name = self._head, self.sound, head_path(self._path).name
        if head is None:
            problem = f"the log is signed, but its head {name} is gone: its end may be gone, too"
            return Damage("head-missing", None, problem) if self.key else None
        last = sound.before
        if (self.key and head.key != self.key) or (
            last is not None and last.fields["session"] != head.session
        ):
            problem = f"{name} is the head of the log of session “{head.session}”"
            return Damage("head-of-another-log", None, problem)
        if head.seq and not self.key and sound.lines >= FIRST_SIGNED:
            problem = f"its signatures were removed: {name} covers {head.seq} signed lines"
            return Damage("signatures-removed", FIRST_SIGNED, problem, sound.lines)
        if head.seq > sound.lines:
            problem = f"the log was cut short: its signed head covers {head.seq} lines"
            return Damage("cut-short", sound.lines + 1, f"{problem}, but {sound.lines} are left")
        if head.seq and head.hash != self._hash_at_head:
            if head.seq <= sound.vouched:
                problem = f"{name} is the head of another log"
                return Damage("head-of-another-log", None, problem)
            first = sound.vouched + 1
            problem = f"lines {first} to {head.seq} were rewritten: {name} has another hash"
            return Damage("rewritten", first, problem, head.seq)
        return None

    def still_damage(self) -> Damage | None:
        """Return damage if the file of a still beside the log is not the one that was shown.

        Missing stills are only noted, because a log may have been copied without them.
        """
        missing = 0
        for still, line in self._stills:
            changed = is_changed(self._path, still)
            if changed:
                problem = f"the still of {still.track} has been changed since it was shown"
                return Damage("picture-changed", line, f"{problem}: {still.file_name}")
            missing += changed is None
        if missing:
            folder = stills_folder(self._path).name
            note = f"{missing} of {len(self._stills)} stills that were shown are not in {folder}"
            self._notes.append(note)
        return None

    def standing(self) -> Standing:
        """Return whether the log is signed and closed, signed but open, or not signed."""
        last = self.sound.before
        if last is not None and isinstance(last.event.data, LogSigned) and last.event.data.closing:
            return "signed"
        return "open" if self.key or self._head is not None else "not signed"

    def note(self) -> str:
        """Return remarks on an undamaged log."""
        last, standing = self.sound.before, self.standing()
        notes = self._notes.copy()
        if self._set_back:
            (back, line), times = self._set_back[0], len(self._set_back)
            often = f"{times} times, first " if times > 1 else ""
            by = timedelta(seconds=round(back.total_seconds()))
            notes.append(f"the clock was set back {often}by {by} before line {line}")
        if last is None:
            notes.append("the log is empty")
        elif standing == "not signed" and last.event.data.kind != "session_ended":
            notes.append(
                "no session end: the session is still running, stopped without warning, "
                f"or its log was cut off after line {self.sound.lines}"
            )
        elif standing == "open":
            rest = self.sound.lines - self.sound.vouched
            notes.append(
                f"it ends after its last signature, on line {self.sound.vouched}, with {rest} "
                "unsigned records: the session is still running or stopped without warning"
            )
        if standing == "signed" and self._head and self._head.seq < self.sound.vouched:
            notes.append("its signed head is older than its last signature, as after a crash")
        return "; ".join(notes)
