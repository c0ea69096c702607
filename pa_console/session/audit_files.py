"""Which files are part of an audit, so that nothing else is ever written in their place."""

from pathlib import Path

from pa_console.session.session_index import INDEX_NAME
from pa_console.signing import KNOWN_FILE, key_path

_BY_ENDING = {
    ".head": "the signed head of a session log",
    ".head.new": "the signed head of a session log",
    ".torn": "what a crash left of a session log",
    ".sig": "the signature of a rule set",
}
_FIRST_RECORD, _FIRST_HEAD = b'{"seq":', b'{"closed":'


def refuse_audit_file(path: Path) -> None:
    """Raise ValueError when `path` is a file of an audit, or would be taken for one."""
    if part := audit_part(path):
        raise ValueError(f"{path}: this is {part}, which is never written over; name another file")


def audit_part(path: Path) -> str:
    """Return which part of an audit the file `path` is, or would be by its name; else empty."""
    name = path.name.casefold()
    for ending, part in _BY_ENDING.items():
        if name.endswith(ending):
            return part
    if name == INDEX_NAME:
        return "the index of sessions"
    key = key_path()
    if any(_same(path, own) for own in (key, key.with_name(KNOWN_FILE))):
        return "the signing key, or one of the files beside it"
    if _lies_beside(path):
        return "a session log"
    return {_FIRST_RECORD: "a session log", _FIRST_HEAD: "a witness of session logs"}.get(
        _beginning(path), ""
    )


def _same(path: Path, other: Path) -> bool:
    return path.absolute() == other.absolute() or (
        path.exists() and other.exists() and path.samefile(other)
    )


def _lies_beside(path: Path) -> bool:
    """Whether a signed head that lies there is that of `path`, which may be gone."""
    return path.with_name(path.name + ".head").exists()


def _beginning(path: Path) -> bytes:
    """Return the sign of a log or a witness with which the file begins, if it does."""
    try:
        with path.open("rb") as file:
            found = file.read(len(_FIRST_HEAD))
    except OSError:
        return b""
    return next((sign for sign in (_FIRST_RECORD, _FIRST_HEAD) if found.startswith(sign)), b"")
