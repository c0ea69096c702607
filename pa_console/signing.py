"""Ed25519 signatures: this machine's key (made on first use), verification, and signed lines."""

import base64
import hashlib
import json
import os
import re
from pathlib import Path
from typing import Any, ClassVar, Self

from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import serialization as form
from cryptography.hazmat.primitives.asymmetric import ed25519
from filelock import FileLock, Timeout
from platformdirs import user_config_path
from pydantic import ValidationError

from pa_console.private_files import (
    FILE_MODE,
    NotPrivateError,
    make_private_folder,
    read_private,
    replace_private,
)
from pa_console.schema.base import Hex32, Hex64, StrictModel

KEY_VARIABLE = "PA_CONSOLE_SIGNING_KEY"
PASSPHRASE_VARIABLE = "PA_CONSOLE_PASSPHRASE"
"""The variable with the passphrase of a site's keys, for machines on which nobody can type it."""

SITE_OWNER = "owner.pub"
"""The file with the public key of the site's owner, in the folder of the site's keys. A site has
keys if this file exists."""

KEY_FILE = "signing-key.pem"
KNOWN_FILE = "known-keys"
LOCK_SECONDS = 10.0
_FINGERPRINT = re.compile(r"SHA256:[A-Za-z0-9+/]{43}")


class SigningError(ValueError):
    """An error for a key that cannot be made or read; the message names its path and a remedy."""


class Signer:
    """A private key for signing; `public` is its public key, 32 bytes in hexadecimal."""

    def __init__(self, key: ed25519.Ed25519PrivateKey) -> None:
        self._key = key
        self.public = key.public_key().public_bytes_raw().hex()

    @property
    def fingerprint(self) -> str:
        """The fingerprint of the public key."""
        return fingerprint(self.public)

    def sign(self, message: bytes) -> str:
        """Return the signature of `message`, 64 bytes in hexadecimal; takes about 50 µs."""
        return self._key.sign(message).hex()


class SignedLine(StrictModel):
    """One line of canonical JSON whose signature covers PURPOSE and every other field.

    A subclass sets PURPOSE, which makes the signature of one kind of line invalid for another, and
    TITLE, its name in error messages.
    """

    PURPOSE: ClassVar[bytes]
    TITLE: ClassVar[str]

    key: Hex32
    signature: Hex64

    @classmethod
    def signed(cls, signer: Signer, **fields: Any) -> Self:
        """Return the line with `fields`, signed by `signer`."""
        fields["key"] = signer.public
        signature = signer.sign(cls.PURPOSE + _text_line(fields))
        return cls(signature=signature, **fields)

    @classmethod
    def parse(cls, content: bytes) -> Self:
        """Parse `content`, a line with its line break; ValueError if its signature is invalid."""
        try:
            read = cls.model_validate_json(content)
        except ValidationError as error:
            raise ValueError(f"not {cls.TITLE}") from error
        message = cls.PURPOSE + _text_line(read.model_dump(exclude={"signature"}))
        # The bytes are compared as well, because other spellings of the JSON match the signature.
        if content != read.line or not is_signature(read.signature, message, read.key):
            raise ValueError("this line was changed: its signature does not match its content")
        return read

    @property
    def line(self) -> bytes:
        """The line as it is written, with its line break."""
        return _text_line(self.model_dump())


def _text_line(fields: dict[str, Any]) -> bytes:
    return canonical_json(fields).encode("utf-8", "surrogatepass") + b"\n"


def canonical_json(value: object) -> str:
    """Return `value` as JSON with sorted keys and no spaces, the form that is hashed and signed."""
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"), sort_keys=True)


def key_path() -> Path:
    """Return the path of this machine's private key; PA_CONSOLE_SIGNING_KEY overrides it."""
    given = os.environ.get(KEY_VARIABLE)
    return Path(given).expanduser() if given else user_config_path("pa-console") / KEY_FILE


def site_keys() -> Path:
    """Return the folder of the keys of this machine's site, beside the signing key."""
    return key_path().with_name("site-keys")


def load_signer() -> Signer:
    """Return this machine's signer; its key is made on first use, readable by its owner only.

    Two consoles that start at the same time get the same key. Raises SigningError if the key can
    be neither read nor made, or if other users can read it.
    """
    path = key_path()
    try:
        if (signer := _read(path)) is not None:
            return signer
        make_private_folder(path.parent)
        with FileLock(f"{path}.lock", timeout=LOCK_SECONDS, mode=FILE_MODE):
            return _read(path) or _make(path)
    except Timeout as error:
        raise SigningError(f"{path}: another console holds {path.name}.lock; try again") from error
    except OSError as error:
        raise _unusable(path, error) from error


def known_keys() -> frozenset[str]:
    """Return the fingerprints of this machine's keys: one, or none before the key is made.

    Raises SigningError if the key file cannot be read.
    """
    try:
        signer = _read(key_path())
    except OSError as error:
        raise _unusable(key_path(), error) from error
    return frozenset((signer.fingerprint,)) if signer is not None else frozenset()


def named_keys() -> dict[str, str]:
    """Return the names that this machine's user has given to keys, by fingerprint.

    The file `known-keys` beside the signing key has a fingerprint and a name on each line; lines
    that begin with # are comments. Raises SigningError, with the line number, for an invalid line,
    and also if other users may change the file.
    """
    path = key_path().with_name(KNOWN_FILE)
    try:
        text = read_private(path, loose=0o022).decode("utf-8")
    except FileNotFoundError:
        return {}
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, NotPrivateError) else error
        raise SigningError(f"{path}: cannot be read: {reason}") from error
    names: dict[str, str] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        key, _, name = line.strip().partition(" ")
        if not key or key.startswith("#"):
            continue
        if not is_fingerprint(key) or not name.strip():
            raise SigningError(f"{path}:{number}: expected SHA256:, 43 characters, and a name")
        names[key] = name.strip()
    return names


def fingerprint(public: str) -> str:
    """Return the short form of a public key that people compare: `SHA256:` and 43 characters."""
    digest = hashlib.sha256(bytes.fromhex(public)).digest()
    return "SHA256:" + base64.b64encode(digest).decode().rstrip("=")


def is_fingerprint(text: str) -> bool:
    """Return True if `text` has the form of a fingerprint."""
    return _FINGERPRINT.fullmatch(text) is not None


def is_public_key(text: str) -> bool:
    """Return True if `text` has the form of a public key: 32 bytes in hexadecimal."""
    return re.fullmatch(r"[0-9a-f]{64}", text) is not None


def is_signature(signature: str, message: bytes, public: str) -> bool:
    """Return True if the key `public` signed `message`; key and signature are hexadecimal."""
    try:
        key = ed25519.Ed25519PublicKey.from_public_bytes(bytes.fromhex(public))
        key.verify(bytes.fromhex(signature), message)
    except (InvalidSignature, ValueError):
        return False
    return True


def _read(path: Path) -> Signer | None:
    """Return the signer of the key at `path`, or None if there is no such file."""
    try:
        key = form.load_pem_private_key(read_private(path), None)
    except FileNotFoundError:
        return None
    except (ValueError, TypeError, UnsupportedAlgorithm) as error:
        problem = "not an unencrypted PEM private key; restore it, or move it away to get a new one"
        raise SigningError(f"{path}: {problem}") from error
    if not isinstance(key, ed25519.Ed25519PrivateKey):
        raise SigningError(f"{path}: not an Ed25519 key; move it away to get a new one")
    return Signer(key)


def _make(path: Path) -> Signer:
    """Make a key and write it to the disk at `path` before it can sign anything."""
    key = ed25519.Ed25519PrivateKey.generate()
    pem = key.private_bytes(form.Encoding.PEM, form.PrivateFormat.PKCS8, form.NoEncryption())
    replace_private(path, pem)
    return Signer(key)


def _unusable(path: Path, error: OSError) -> SigningError:
    if isinstance(error, NotPrivateError):
        return SigningError(
            f"{path}: this signing key is not used: {error.strerror}; otherwise, move it away to "
            f"get a new one, or name another file in {KEY_VARIABLE}"
        )
    return SigningError(
        f"{path}: cannot make or read the signing key: {error.strerror or error}; "
        f"check that folder, or name another file in {KEY_VARIABLE}"
    )
