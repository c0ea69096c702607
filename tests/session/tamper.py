"""Every kind of damage to a signed log, as whoever knows the format would do it."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from pa_console.schema.events import event as ev
from pa_console.session.log.signed_head import head_path, sign_head, write_head
from pa_console.session.log.verification import DamageKind, VerifyResult, verify
from pa_console.session.log.writer import LogWriter
from pa_console.session.stills import stills_folder
from pa_console.signing import Signer
from tests.session.story import at, story, telemetry
from tests.stills import kept

Lines = list[bytes]
MINE = Signer(Ed25519PrivateKey.from_private_bytes(bytes(range(32))))
OTHER = Signer(Ed25519PrivateKey.from_private_bytes(bytes(range(1, 33))))
KNOWN = frozenset((MINE.fingerprint,))


def write_signed(
    path: Path, session: str = "S1", signer: Signer = MINE, events: list[ev.Event] | None = None
) -> Path:
    """Write a closed log that was signed after its first record and after every seventh or so."""
    with LogWriter(path, session, signer=signer, clock=ticking()) as log:
        for event in long_story() if events is None else events:
            log.append(event)
    return path


def ticking() -> Callable[[], float]:
    """Return a clock that is a third of a second later every time it is read."""
    times = iter(range(10**9))
    return lambda: next(times) / 3


def long_story() -> list[ev.Event]:
    """The story, with more telemetry before its end: 30 records, several signatures."""
    *told, end = story()
    return [*told, *(telemetry(9.0 + n) for n in range(15)), at(30.0, end.data)]


def rehashed(line: bytes, **changes: Any) -> bytes:
    """The record changed and given a fitting hash."""
    record: dict[str, Any] = {**json.loads(line), **changes}
    rest = {key: value for key, value in record.items() if key != "hash"}
    canonical = json.dumps(rest, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    record["hash"] = hashlib.sha256(canonical.encode()).hexdigest()
    return json.dumps(record, separators=(",", ":"), ensure_ascii=False).encode() + b"\n"


def relinked(lines: Lines, first: int = 1) -> Lines:
    """All records from line `first` on numbered and linked anew, with fitting hashes."""
    done = lines[: first - 1]
    prev = json.loads(done[-1])["hash"] if done else "0" * 64
    for line in lines[first - 1 :]:
        done.append(rehashed(line, seq=len(done) + 1, prev=prev))
        prev = json.loads(done[-1])["hash"]
    return done


def is_signed(line: bytes) -> bool:
    """Whether the record is a signature."""
    return json.loads(line)["kind"] == "log_signed"


def edited(line: bytes) -> bytes:
    """The record with a tick that it did not have."""
    tick = json.loads(line)["tick"]
    return line.replace(b'"tick":%d' % tick, b'"tick":%d' % (tick + 1), 1)


@dataclass(frozen=True)
class Tamper:
    """One kind of damage: what is done, to the lines or to the files, and what must be named."""

    name: str
    kind: DamageKind
    line: int | None
    lines: Callable[[Lines], Lines] | None = None
    files: Callable[[Path], None] | None = None

    def apply(self, log: Path) -> None:
        """Damage `log`, or its head."""
        if self.lines is not None:
            log.write_bytes(b"".join(self.lines(log.read_bytes().splitlines(keepends=True))))
        if self.files is not None:
            self.files(log)


def _changed(number: int, change: Callable[[bytes], bytes]) -> Callable[[Lines], Lines]:
    """Return what changes one line."""
    return lambda ls: [*ls[: number - 1], change(ls[number - 1]), *ls[number:]]


def _swapped(ls: Lines, first: int, second: int) -> Lines:
    ls[first - 1], ls[second - 1] = ls[second - 1], ls[first - 1]
    return ls


def _crash(log: Path) -> None:
    """Leave the log as a console does that dies in the middle of a line."""
    head, lines = head_path(log), log.read_bytes().splitlines(keepends=True)
    hashes = {json.loads(line)["seq"]: json.loads(line)["hash"] for line in lines}
    write_head(log, sign_head("S1", 2, hashes[2], False, MINE), lasting=False)
    assert head.is_file()
    log.write_bytes(b"".join(lines[:4]) + lines[4][:50])


def _signed_anew(log: Path) -> None:
    """Write the whole log and its head again, one event changed, signed by another key."""
    events = long_story()
    events[4] = events[4].model_copy(update={"tick": 99})
    log.unlink()
    head_path(log).unlink()
    write_signed(log, signer=OTHER, events=events)


def _other_head(log: Path) -> None:
    other = write_signed(log.with_name("other.jsonl"), "S2")
    head_path(other).replace(head_path(log))


def _head_of_the_same_session(log: Path) -> None:
    other = write_signed(log.with_name("other.jsonl"), events=long_story()[1:])
    head_path(other).replace(head_path(log))


def _shorter_head(log: Path) -> None:
    path = head_path(log)
    path.write_bytes(path.read_bytes().replace(b'"seq":', b'"seq":1', 1))


def _other_signature(line: bytes) -> bytes:
    data = json.loads(line)["data"]
    return line.replace(data["signature"].encode(), b"0" * 128)


def _rehashed_signature(line: bytes) -> bytes:
    return rehashed(line, data={**json.loads(line)["data"], "signature": "0" * 128})


def _other_hash(line: bytes) -> bytes:
    return line.replace(json.loads(line)["hash"].encode(), b"0" * 64)


def _other_link(line: bytes) -> bytes:
    return line.replace(json.loads(line)["prev"].encode(), b"0" * 64)


def _foreign(line: bytes) -> bytes:
    return rehashed(line, session="S9")


def write_with_picture(log: Path) -> ev.CameraStill:
    """Write a signed log anew, with a picture on line 4 whose file is beside it."""
    for file in log.parent.glob(f"{log.name}*"):
        file.unlink()
    still = kept(log, "Track_01")
    first, second, *rest = long_story()
    write_signed(log, events=[first, second, at(0.6, still), *rest])
    return still


def _changed_still(log: Path) -> None:
    still = write_with_picture(log)
    (stills_folder(log) / still.file_name).write_bytes(b"another picture")


TAMPERS = (
    Tamper("last lines cut off", "cut-short", 30, lambda ls: ls[:29]),
    Tamper("cut off in the middle of a line", "cut-short", 30, lambda ls: [*ls[:29], ls[29][:80]]),
    Tamper("cut off to nothing", "cut-short", 1, lambda ls: []),
    Tamper("half a last line, by a crash", "half-line", 5, files=_crash),
    Tamper("a line removed", "removed", 7, lambda ls: ls[:6] + ls[7:]),
    Tamper("the first line removed", "removed", 1, lambda ls: ls[1:]),
    Tamper("several lines removed", "removed", 7, lambda ls: ls[:6] + ls[20:]),
    Tamper("a line inserted", "inserted", 7, lambda ls: [*ls[:6], _foreign(ls[20]), *ls[6:]]),
    Tamper("a line inserted, hash fitting", "inserted", 7,
           lambda ls: [*ls[:6], rehashed(ls[6], tick=5), *ls[6:]]),
    Tamper("rubbish inserted", "inserted", 7, lambda ls: [*ls[:6], b"\x00\xff\n", *ls[6:]]),
    Tamper("two lines swapped", "swapped", 7, lambda ls: _swapped(ls, 7, 8)),
    Tamper("two distant lines swapped", "swapped", 7, lambda ls: _swapped(ls, 7, 20)),
    Tamper("a line moved down", "moved", 7, lambda ls: [*ls[:6], *ls[7:12], ls[6], *ls[12:]]),
    Tamper("a line moved up", "moved", 7, lambda ls: [*ls[:6], ls[11], *ls[6:11], *ls[12:]]),
    Tamper("a line duplicated", "duplicated", 8, lambda ls: [*ls[:7], ls[6], *ls[7:]]),
    Tamper("a line repeated later", "duplicated", 21, lambda ls: [*ls[:20], ls[6], *ls[20:]]),
    Tamper("a line repeated earlier", "duplicated", 7, lambda ls: [*ls[:6], ls[20], *ls[6:]]),
    Tamper("a field edited", "edited-field", 7, _changed(7, edited)),
    Tamper("the link edited", "edited-field", 7, _changed(7, _other_link)),
    Tamper("a hash edited", "edited-hash", 7, _changed(7, _other_hash)),
    Tamper("a field and its hash edited", "edited", 7,
           _changed(7, lambda li: edited(_other_hash(li)))),
    Tamper("the same in other letters", "respelled", 7,
           _changed(7, lambda li: li.replace(b'"tick":', b'"tick": ', 1))),
    Tamper("a record edited, hash recomputed", "replaced", 7,
           _changed(7, lambda li: rehashed(li, tick=5))),
    Tamper("the header replaced", "header-replaced", 1,
           _changed(1, lambda li: rehashed(li, session="S9"))),
    Tamper("a line overwritten with rubbish", "garbage", 7, _changed(7, lambda _: b"\x00\xff\n")),
    Tamper("two lines joined", "garbage", 7, _changed(7, lambda li: li[:-1] + b" ")),
    Tamper("whole log rewritten, hashes recomputed", "rewritten", 1,
           lambda ls: relinked([rehashed(ls[0], tick=9), *ls[1:]])),
    Tamper("rewritten from the middle on", "rewritten", 3,
           lambda ls: relinked([*ls[:6], edited(ls[6]), *ls[7:]], 7)),
    Tamper("an event taken out, hashes recomputed", "rewritten", 3,
           lambda ls: relinked([*ls[:6], *ls[7:]], 7)),
    Tamper("rewritten without its signatures", "signatures-removed", 2,
           lambda ls: relinked([li for li in ls if not is_signed(li)])),
    Tamper("whole log rewritten, signed by another", "unknown-key", 2, files=_signed_anew),
    Tamper("a signature changed", "signature", 2, _changed(2, _other_signature)),
    Tamper("a signature changed, hash recomputed", "signature", 2,
           _changed(2, _rehashed_signature)),
    Tamper("head file removed", "head-missing", None, files=lambda log: head_path(log).unlink()),
    Tamper("head file edited", "head-damaged", None, files=_shorter_head),
    Tamper("head file emptied", "head-damaged", None,
           files=lambda log: head_path(log).open("wb").close()),
    Tamper("head of another log", "head-of-another-log", None, files=_other_head),
    Tamper("head of another log of its session", "head-of-another-log", None,
           files=_head_of_the_same_session),
    Tamper("a still changed", "picture-changed", 4, files=_changed_still),
)  # fmt: skip


def damaged(tamper: Tamper, folder: Path) -> VerifyResult:
    """Write a sound log into the empty `folder`, damage it, and verify it."""
    log = write_signed(folder / "s.jsonl")
    tamper.apply(log)
    return verify(log, KNOWN)
