"""The signed head of a log, `LOG.head`: how long the log is at least, so that no cut goes unseen.

One line of canonical JSON with the fields of `Head`, written after the records that it vouches for
are on the disk, under another name first: a crash leaves the head before it, which is as good.
"""

import json
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from pa_console.private_files import replace_private, sync_folder
from pa_console.schema.base import Hex32, Hex64
from pa_console.session.chain import LogError, os_error
from pa_console.signing import Signer, is_signature

PURPOSE = b"pa-console session log, head\n"


@dataclass(frozen=True)
class Head:
    """`seq` records, the last with `hash`, are there by the word of `key`; `closed`: and no more.

    A log that was only just opened has `seq` 0 and the hash GENESIS.
    """

    closed: bool
    hash: Hex32
    key: Hex32
    seq: int
    session: str
    signature: Hex64


_HEAD = TypeAdapter(Head)


def head_path(log: Path) -> Path:
    """Return where the head of `log` is."""
    return log.with_name(log.name + ".head")


def sign_head(session: str, seq: int, head: str, closed: bool, signer: Signer) -> Head:
    """Return the signed head of a log of `seq` records, the last of them with the hash `head`."""
    session = session.encode("utf-8", "replace").decode()
    unsigned = Head(closed, head, signer.public, seq, session, "")
    return Head(closed, head, signer.public, seq, session, signer.sign(_signed_part(unsigned)))


def write_head(log: Path, head: Head, *, lasting: bool) -> None:
    """Put `head` beside `log`; `lasting` also makes its name safe. Raises OSError, the old kept.

    The records that it speaks of must be on the disk by now.
    """
    path = head_path(log)
    replace_private(path, head_line(head))
    if lasting:
        with suppress(OSError):
            sync_folder(path.parent)


def read_head(log: Path) -> Head | None:
    """Return the head beside `log`, None when there is none.

    Raises ValueError that says what is wrong with it, LogError when it cannot be read.
    """
    path = head_path(log)
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise os_error(path, "read the signed head", error) from error
    return parse_head(content)


def head_line(head: Head) -> bytes:
    """Return `head` as it is written: one line, with its end."""
    return _text(asdict(head))


def parse_head(content: bytes) -> Head:
    """Return the head that a line says; raises ValueError for what no key has signed."""
    try:
        head = _HEAD.validate_json(content, strict=True)
    except ValidationError as error:
        raise ValueError("not a signed head of a session log") from error
    if content != _text(asdict(head)) or not is_signature(
        head.signature, _signed_part(head), head.key
    ):
        raise ValueError("the signed head was changed: its signature is not of what it says")
    return head


def require_head(log: Path, session: str, seq: int, public: str | None) -> Head | None:
    """Return the head of a log that is to go on after `seq` records, signed by `public` or not.

    The head that a deleted log of another session left behind is as good as none for a new log.
    Raises LogError when they are not the log and the session that the head vouches for.
    """
    try:
        head = read_head(log)
    except ValueError as error:
        raise LogError(str(head_path(log)), 0, f"{error}; start a new log instead") from error
    problem, mine = "", session.encode("utf-8", "replace").decode()
    if head is None or (seq == 0 and head.session != mine):
        return None
    if head.session != mine:
        problem = f"it is the head of the log of session {head.session!r}"
    elif head.seq > seq:
        problem = f"the log was cut short: {head.seq} records were signed and {seq} are there"
    elif public is not None and head.key != public:
        problem = "the log was signed by another key"
    if problem:
        raise LogError(str(head_path(log)), 0, f"{problem}; start a new log instead")
    return head


def _signed_part(head: Head) -> bytes:
    rest = {key: value for key, value in asdict(head).items() if key != "signature"}
    return PURPOSE + _text(rest)


def _text(fields: dict[str, Any]) -> bytes:
    text = json.dumps(fields, ensure_ascii=False, separators=(",", ":"), sort_keys=True)
    return text.encode("utf-8", "surrogatepass") + b"\n"
