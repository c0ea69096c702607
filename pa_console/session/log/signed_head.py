"""The signed head of a log, `LOG.head`: how long the log is at least: no cut goes unseen.

One line of canonical JSON with the fields of `Head`, written after the records that it vouches for
are on the disk, under another name first: a crash leaves the head before it, which is as good.
"""

import json
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from pa_console.private_files import replace_private, sync_folder
from pa_console.schema.base import Hex32, Hex64
from pa_console.session.log.chain import LogError, os_error
from pa_console.signing import Signer, is_signature

PURPOSE = b"pa-console session log, head\n"


@dataclass(frozen=True)
class SignedHead:
    """`seq` records, the last with `hash`, are there by the word of `key`; `closed`: and no more.

    A log that was only just opened has `seq` 0 and the hash GENESIS.
    """

    closed: bool
    hash: Hex32
    key: Hex32
    seq: int
    session: str
    signature: Hex64


_HEAD = TypeAdapter(SignedHead)


def head_path(log: Path) -> Path:
    """Return where the head of `log` is."""
    return log.with_name(log.name + ".head")


def sign_head(session: str, seq: int, head: str, closed: bool, signer: Signer) -> SignedHead:
    """Return the signed head of a log of `seq` records, the last of them with the hash `head`."""
    session = session.encode("utf-8", "replace").decode()
    unsigned = SignedHead(closed, head, signer.public, seq, session, "")
    return SignedHead(
        closed, head, signer.public, seq, session, signer.sign(_signed_part(unsigned))
    )


def write_head(log: Path, head: SignedHead, *, lasting: bool) -> None:
    """Put `head` beside `log`; `lasting` also makes its name safe. Raises OSError, the old kept.

    The records that it speaks of must be on the disk by now.
    """
    path = head_path(log)
    replace_private(path, head_line(head))
    if lasting:
        with suppress(OSError):
            sync_folder(path.parent)


def read_head(log: Path) -> SignedHead | None:
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


def head_line(head: SignedHead) -> bytes:
    """Return `head` as it is written: one line, with its end."""
    return _text(asdict(head))


def parse_head(content: bytes) -> SignedHead:
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


def require_head(log: Path, session: str, seq: int, public: str | None) -> SignedHead | None:
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
        problem = f"it is the head of the log of session “{head.session}”"
    elif head.seq > seq:
        problem = f"the log was cut short: {head.seq} records were signed and {seq} are there"
    elif public is not None and head.key != public:
        problem = "the log was signed by another key"
    if problem:
        raise LogError(str(head_path(log)), 0, f"{problem}; start a new log instead")
    return head


def _signed_part(head: SignedHead) -> bytes:
    rest = {key: value for key, value in asdict(head).items() if key != "signature"}
    return PURPOSE + _text(rest)


def _text(fields: dict[str, Any]) -> bytes:
    text = json.dumps(fields, ensure_ascii=False, separators=(",", ":"), sort_keys=True)
    return text.encode("utf-8", "surrogatepass") + b"\n"


class HeadKeeper:
    """Writes heads in a thread of its own, each once the records it speaks of are on the disk.

    A disk may take a second for that; the console's screen stands still as long as its log waits.
    """

    def __init__(
        self, log: Path, sync: Callable[[], None], seen: Callable[[SignedHead, bool], None]
    ) -> None:
        """`sync` waits until the disk has what was written to `log`; it raises OSError.

        `seen` is given every head whose records are on the disk, and whether somebody waited.
        """
        self._log, self._sync, self._seen = log, sync, seen
        self._thread = ThreadPoolExecutor(1, "log-head")
        self._writing: Future[None] | None = None

    def keep(self, head: SignedHead) -> None:
        """Write `head` soon, or not at all while an earlier one is written: the next says more.

        Raises the OSError that the last one ended with.
        """
        before = self._writing
        if before is not None and not before.done():
            return
        self._writing = self._thread.submit(self._write, head)
        if before is not None:
            before.result()

    def keep_now(self, head: SignedHead) -> None:
        """Write `head`, whose records are on the disk, and make its name safe; raises OSError."""
        self._wait()
        self._seen(head, True)
        write_head(self._log, head, lasting=True)

    def close(self) -> None:
        """Wait for a head that is being written, and write no other."""
        self._wait()
        self._thread.shutdown()

    def _wait(self) -> None:
        """Wait for a head that is being written; how that ended does not matter any more."""
        if self._writing is not None:
            self._writing.exception()
            self._writing = None

    def _write(self, head: SignedHead) -> None:
        self._sync()
        self._seen(head, False)
        write_head(self._log, head, lasting=False)
