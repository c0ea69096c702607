"""The signed head of a log, `LOG.head`, which states the log's least length and reveals a cut.

The head is replaced once the records that it covers are on the disk. A crash in between leaves the
previous head, which is still true.

The owner of the signing key can rewrite and sign a log, but cannot change the heads that a witness
on another disk or machine has received. Heads are appended to a file, or posted to a web address
whose server appends them to a file: one line of JSON each, as in `LOG.head`.
"""

import os
import threading
import time
import urllib.request
from collections.abc import Callable, Collection
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from http.client import HTTPException
from pathlib import Path
from typing import ClassVar
from urllib.error import HTTPError

from pa_console.private_files import make_private_folder, open_private, replace_private, sync_folder
from pa_console.schema.base import Hex32
from pa_console.session.log.chain import LogError, encodable, os_error, parse, read_lines
from pa_console.signing import SignedLine, Signer, fingerprint

EVERY_S = 10.0
"""The least time between two heads for the witness that are not urgent, in seconds."""
TIMEOUT_S = 5.0
RETRY_S = 10.0
URLS = ("http://", "https://")
Send = Callable[[bytes], None]


class SignedHead(SignedLine):
    """A statement signed by `key`: the log has at least `seq` records, and record `seq` has `hash`.

    A `closed` log has no further records. A log without records has `seq` 0 and the hash GENESIS.
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
    """Return the signed head of a log with `seq` records, the last one with the hash `head`."""
    fields = {"closed": closed, "hash": head, "seq": seq, "session": encodable(session)}
    return SignedHead.signed(signer, **fields)


def write_head(log: Path, head: SignedHead, *, lasting: bool) -> None:
    """Replace the head of `log`; the records that `head` covers must already be on the disk.

    With `lasting`, the folder is synced too. If this raises OSError, the old head is kept.
    """
    path = head_path(log)
    replace_private(path, head.line)
    if lasting:
        with suppress(OSError):
            sync_folder(path.parent)


def read_head(log: Path) -> SignedHead | None:
    """Return the head of `log`, or None if there is none.

    Raises ValueError if the head is invalid, LogError if it cannot be read.
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
    """Return the head of a log that is continued after `seq` records, or None if it has none.

    For a new log, the head of a deleted log of another session is ignored. Otherwise raises
    LogError if the head is of another session. Raises LogError also if the head covers more than
    `seq` records, or is not signed by the key `public`, if that is given.
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
        problem = f"the log was cut short: {head.seq} records were signed, {seq} are left"
    elif public is not None and head.key != public:
        problem = "the log was signed by another key"
    if problem:
        raise LogError(str(head_path(log)), 0, f"{problem}; start a new log instead")
    return head


class HeadKeeper:
    """A thread that writes each head after the records that it covers are on the disk.

    Syncing can take a second; without the thread, the screen would freeze for that time.
    """

    def __init__(
        self, log: Path, sync: Callable[[], None], seen: Callable[[SignedHead, bool], None]
    ) -> None:
        """Start the thread for `log`; `sync` waits until the log's records are on the disk.

        `sync` may raise OSError. `seen` is called with each head whose records are on the disk, and
        with True if the head is urgent.
        """
        self._log, self._sync, self._seen = log, sync, seen
        self._thread = ThreadPoolExecutor(1, "log-head")
        self._writing: Future[None] | None = None

    def keep(self, head: SignedHead) -> None:
        """Write `head` soon, unless an earlier head is being written; a later head covers more.

        Raises OSError if the last write failed.
        """
        before = self._writing
        if before is not None and not before.done():
            return
        self._writing = self._thread.submit(self._write, head)
        if before is not None:
            before.result()

    def keep_now(self, head: SignedHead) -> None:
        """Write `head` now, whose records are on the disk, and sync its folder; raises OSError."""
        self._wait()
        self._seen(head, True)
        write_head(self._log, head, lasting=True)

    def close(self) -> None:
        """Wait for a head that is being written, then end the thread."""
        self._wait()
        self._thread.shutdown()

    def _wait(self) -> None:
        # The error of an earlier head no longer matters, because the next head replaces that head.
        if self._writing is not None:
            self._writing.exception()
            self._writing = None

    def _write(self, head: SignedHead) -> None:
        self._sync()
        self._seen(head, False)
        write_head(self._log, head, lasting=False)


class Witness:
    """A thread that sends heads to a witness; only `close` waits for it, at most TIMEOUT_S.

    Of several waiting heads, only the last is sent, because it covers the records of the others.
    `problem` is the error of the last attempt, or '' if it succeeded.
    """

    def __init__(
        self, target: str, *, send: Send | None = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Start the thread; `target` is the path of a file, or an http(s) address."""
        self.target, self.problem = target, ""
        self._send = send or (_to_url(target) if target.startswith(URLS) else _to_file(target))
        self._clock = clock
        self._changed = threading.Condition()
        self._next: SignedHead | None = None
        self._closing = False
        self._seen_at = -EVERY_S
        self._reported = ""
        self._thread = threading.Thread(target=self._serve, name="witness", daemon=True)
        self._thread.start()

    def see(self, head: SignedHead, *, urgent: bool) -> None:
        """Send `head` soon; if it is not `urgent`, skip it within EVERY_S of the last head."""
        now = self._clock()
        if not urgent and now - self._seen_at < EVERY_S:
            return
        with self._changed:
            self._seen_at, self._next = now, head
            self._changed.notify()

    def news(self) -> str | None:
        """Return `problem` if it has changed since the last call, else None."""
        before, self._reported = self._reported, self.problem
        return None if before == self._reported else self._reported

    def close(self) -> None:
        """Try once more to send a waiting head; after that, `problem` is final."""
        with self._changed:
            self._closing = True
            self._changed.notify()
        self._thread.join(TIMEOUT_S)
        if self._thread.is_alive():
            self.problem = self.problem or f"no answer within {TIMEOUT_S:.0f} s"

    def _serve(self) -> None:
        while True:
            with self._changed:
                while self._next is None and not self._closing:
                    self._changed.wait()
                head, last = self._next, self._closing
            if head is None:
                return
            try:
                self._send(head.line)
            except (OSError, HTTPException, ValueError) as error:
                self.problem = _words(error)
            else:
                self.problem = ""
            with self._changed:
                # A newer head may have arrived while this one was sent.
                if not self.problem and self._next is head:
                    self._next = None
                if last:
                    return
                if self.problem and not self._closing:
                    self._changed.wait(RETRY_S)


def _to_file(target: str) -> Send:
    path = Path(target).expanduser().absolute()

    def send(line: bytes) -> None:
        make_private_folder(path.parent)
        file = open_private(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        with os.fdopen(file, "ab") as stream:
            stream.write(line)
            stream.flush()
            os.fsync(file)

    return send


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    """A handler that treats a redirection as an error, because a redirected GET stores no head."""

    def redirect_request(  # pyright: ignore[reportIncompatibleMethodOverride] - arguments unused
        self, *_: object
    ) -> None:
        """Refuse to follow the redirection."""


def _to_url(target: str) -> Send:
    opener = urllib.request.build_opener(_NoRedirect)

    def send(line: bytes) -> None:
        kind = {"Content-Type": "application/json"}
        request = urllib.request.Request(target, line, kind, method="POST")
        with opener.open(request, timeout=TIMEOUT_S) as answer:
            answer.read(0)

    return send


def _words(error: Exception) -> str:
    if isinstance(error, HTTPError):
        return f"answered {error.code} {error.reason}"
    reason = getattr(error, "reason", None) or getattr(error, "strerror", None) or error
    return str(reason) or type(error).__name__


@dataclass(frozen=True)
class WitnessResult:
    """The comparison of a log with a witness's heads of its session; `heads` is their number.

    The heads before the first mismatch cover `records` records. `line` is the line in the witness's
    file with the first head that does not match the log.
    """

    heads: int
    records: int = 0
    line: int | None = None
    problem: str = ""

    @property
    def ok(self) -> bool:
        """True if the witness has heads of the session and all of them match the log."""
        return not self.problem


def check_witness(
    log: Path, session: str, witness: Path, accepted: Collection[str]
) -> WitnessResult:
    """Compare `log`, which is of `session`, with the heads in the file `witness`.

    Heads count only if they are signed by keys whose fingerprints are `accepted`. Raises LogError
    if a file cannot be read.
    """
    heads = _heads(witness, session, accepted)
    if not heads:
        problem = f"the witness has no head of session “{session}” that a known key has signed"
        return WitnessResult(0, problem=problem)
    hashes = _hashes(log, {head.seq for _, head in heads})
    good = 0
    for line, head in heads:
        if head.seq and hashes.get(head.seq) != head.hash:
            damage = "that record is gone" if head.seq not in hashes else "that record is different"
            return WitnessResult(
                len(heads),
                good,
                line,
                f"the log does not match the head that the witness has for record {head.seq}: "
                f"{damage}; records {good + 1} to {head.seq} were removed or rewritten since",
            )
        good = max(good, head.seq)
    return WitnessResult(len(heads), good)


def _heads(witness: Path, session: str, accepted: Collection[str]) -> list[tuple[int, SignedHead]]:
    """Return the accepted heads of `session`, each with its line number in the witness's file."""
    heads: list[tuple[int, SignedHead]] = []
    try:
        with witness.open("rb") as file:
            for number, line in enumerate(file, start=1):
                try:
                    head = SignedHead.parse(line)
                except ValueError:
                    continue
                if head.session == session and fingerprint(head.key) in accepted:
                    heads.append((number, head))
    except OSError as error:
        raise os_error(witness, "read the witness", error) from error
    return heads


def _hashes(log: Path, wanted: Collection[int]) -> dict[int, str]:
    """Return the hashes of the records on the `wanted` lines, up to the first bad line."""
    hashes: dict[int, str] = {}
    try:
        for number, line in read_lines(log):
            if number in wanted:
                hashes[number] = parse(line).hash
    except (ValueError, LogError):
        pass
    return hashes
