"""An approval before it is signed, in the very bytes that its signature is made over.

Whoever approves can so be on another machine: the bytes go there, and the signature comes back.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, Self, cast

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from jwt.utils import base64url_decode, base64url_encode

from pa_console.fleets.authorization.messages import (
    APPROVAL_S,
    KINDS,
    MOST_CHARACTERS,
    Approval,
    Claims,
    RefusedError,
    check_time,
    read_claims,
)

_HEADER = {"alg": "EdDSA", "typ": "pa-approval+jwt"}
_TEXTS = ("person", "station", "session", "request", "plan", "rules")


@dataclass(frozen=True)
class UnsignedApproval:
    """An approval ready for signing: `text` is header and claims of a JWT, in ASCII.

    The signature is Ed25519 (RFC 8032) over the bytes of `text`. The signed approval is `text`, a
    full stop, and the 64 bytes of the signature in base64url without padding. `begins` and `ends`
    are in seconds since 1970.
    """

    text: str
    approval: Approval
    begins: float
    ends: float

    @classmethod
    def of(cls, approval: Approval, now: float) -> Self:
        """Return `approval` ready for signing, valid for APPROVAL_S from `now`."""
        ends = now + APPROVAL_S
        claims = {**asdict(approval), "nbf": now, "exp": ends}
        return cls(f"{_packed(_HEADER)}.{_packed(claims)}", approval, now, ends)

    @classmethod
    def read(cls, text: str) -> Self:
        """Return what `text` lets its signer approve; raises RefusedError for anything else.

        A takeover, a roster or a command is never read so: nobody is made to sign one in the belief
        that it is an approval.
        """
        try:
            header, claims = _opened(text)
            if header != _HEADER:
                raise RefusedError("this is a message of another kind than an approval")
            named = {name.name for name in fields(Approval)} | {"nbf", "exp"}
            if claims.keys() != named:
                raise RefusedError("this approval does not say what an approval says")
            check_time(claims, "this approval", APPROVAL_S, claims["nbf"])
            return cls(text, _approval(claims), claims["nbf"], claims["exp"])
        except RefusedError:
            raise
        except (ValueError, KeyError, TypeError) as error:
            raise RefusedError(f"this is nothing to sign: {error}") from error

    @property
    def sha256(self) -> str:
        """The SHA-256 of `text`, in hexadecimal."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    def signed(self, key: Ed25519PrivateKey) -> str:
        """Return the approval signed by the person's own `key`."""
        signature = key.sign(self.text.encode("ascii"))
        return f"{self.text}.{base64url_encode(signature).decode()}"


def _packed(said: Mapping[str, object]) -> str:
    return base64url_encode(json.dumps(said, separators=(",", ":")).encode()).decode()


def _opened(text: str) -> tuple[Claims, Claims]:
    if len(text) > MOST_CHARACTERS or not text.isascii():
        raise RefusedError(f"what is signed is ASCII, of at most {MOST_CHARACTERS} characters")
    first, dot, second = text.partition(".")
    packed = [base64url_encode(base64url_decode(part)).decode() for part in (first, second)]
    if not dot or packed != [first, second]:
        raise RefusedError("this is nothing to sign: it has to be two parts in base64url")
    return read_claims(base64url_decode(first)), read_claims(base64url_decode(second))


def _approval(claims: Claims) -> Approval:
    """Return the approval that `claims` are; raises ValueError where a part is of no right kind."""
    texts = {part: claims[part] for part in _TEXTS}
    if not all(isinstance(value, str) for value in texts.values()) or claims["kind"] not in KINDS:
        raise ValueError("a part of it is of no known kind")
    orders, acts = _texts(claims["orders"], "orders"), _texts(claims["acts"], "acts")
    return Approval(**texts, orders=orders, kind=claims["kind"], acts=acts)


def _texts(value: Any, part: str) -> tuple[str, ...]:
    if not isinstance(value, list):
        raise ValueError(f"{part} is no list")
    items = cast(list[object], value)
    texts = tuple(item for item in items if isinstance(item, str))
    if len(texts) != len(items):
        raise ValueError(f"{part} has more than texts")
    return texts
