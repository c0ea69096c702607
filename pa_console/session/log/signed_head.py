"""The signed head of a log, `LOG.head`: a least length of the log, so that no cut goes unseen.

The head is replaced after the records that it covers are on the disk. A crash in between leaves
the head before it, which is still true.
"""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import ClassVar

from pa_console.private_files import replace_private, sync_folder
from pa_console.schema.base import Hex32
from pa_console.session.log.chain import LogError, encodable, os_error
from pa_console.signing import SignedLine, Signer


class SignedHead(SignedLine):
    """A statement by `key`: the log has `seq` records or more, and that one has `hash`.

    A `closed` log has no further records. A log that was only opened has `seq` 0 and the hash
    GENESIS.
    """

    PURPOSE: ClassVar = b"pa-console session log, head\n"
    TITLE: ClassVar = "a signed head of a session log"

    closed: bool
    hash: Hex32
    seq: int
    session: str


def head_path(log: Path) -> Path:
    """Return the path of the head of `log`."""
    return log.with_name(log.name + ".head")


def sign_head(session: str, seq: int, head: str, closed: bool, signer: Signer) -> SignedHead:
    """Return the signed head of a log of `seq` records, the last of them with the hash `head`."""
    fields = {"closed": closed, "hash": head, "seq": seq, "session": encodable(session)}
    return SignedHead.signed(signer, **fields)


def write_head(log: Path, head: SignedHead, *, lasting: bool) -> None:
    """Replace the head of `log`, whose records up to `head` must be on the disk by now.

    `lasting` also syncs the folder. Raises OSError, and the old head is kept.
    """
    path = head_path(log)
    replace_private(path, head.line)
    if lasting:
        with suppress(OSError):
            sync_folder(path.parent)


def read_head(log: Path) -> SignedHead | None:
    """Return the head of `log`, or None if there is none.

    Raises ValueError for a head that is not valid, LogError if it cannot be read.
    """
    path = head_path(log)
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise os_error(path, "read the signed head", error) from error
    return SignedHead.parse(content)


def require_head(log: Path, session: str, seq: int, public: str | None) -> SignedHead | None:
    """Return the head of a log that is to continue after `seq` records, or None if there is none.

    A head that a deleted log of another session left behind does not count for a new log. Raises
    LogError if the head is of another session, of more than `seq` records, or not signed by the
    key `public`, if that is given.
    """
    try:
        head = read_head(log)
    except ValueError as error:
        raise LogError(str(head_path(log)), 0, f"{error}; start a new log instead") from error
    problem, own = "", encodable(session)
    if head is None or (seq == 0 and head.session != own):
        return None
    if head.session != own:
        problem = f"it is the head of the log of session “{head.session}”"
    elif head.seq > seq:
        problem = f"the log was cut short: {head.seq} records were signed and {seq} are there"
    elif public is not None and head.key != public:
        problem = "the log was signed by another key"
    if problem:
        raise LogError(str(head_path(log)), 0, f"{problem}; start a new log instead")
    return head


class HeadKeeper:
    """A thread that writes heads, each after the records that it covers are on the disk.

    A disk may take a second for that, and the screen stands still while its log waits.
    """

    def __init__(
        self, log: Path, sync: Callable[[], None], seen: Callable[[SignedHead, bool], None]
    ) -> None:
        """`sync` waits until the records of `log` are on the disk, or raises OSError.

        `seen` gets each head whose records are on the disk, and True if its caller waits for it.
        """
        self._log, self._sync, self._seen = log, sync, seen
        self._thread = ThreadPoolExecutor(1, "log-head")
        self._writing: Future[None] | None = None

    def keep(self, head: SignedHead) -> None:
        """Write `head` soon; skip it while an earlier one is written, since the next covers more.

        Raises the OSError that the last one ended with.
        """
        before = self._writing
        if before is not None and not before.done():
            return
        self._writing = self._thread.submit(self._write, head)
        if before is not None:
            before.result()

    def keep_now(self, head: SignedHead) -> None:
        """Write `head`, whose records are on the disk, and sync its folder; raises OSError."""
        self._wait()
        self._seen(head, True)
        write_head(self._log, head, lasting=True)

    def close(self) -> None:
        """Wait for a head that is being written, and write no other."""
        self._wait()
        self._thread.shutdown()

    def _wait(self) -> None:
        # The error of an earlier head no longer matters: the next head replaces it.
        if self._writing is not None:
            self._writing.exception()
            self._writing = None

    def _write(self, head: SignedHead) -> None:
        self._sync()
        self._seen(head, False)
        write_head(self._log, head, lasting=False)
