"""The pin on a user's rule set: the first set used is pinned, and a weaker one is refused.

The pin is stored in the user's state folder. The shipped set is always accepted: the package
contains the hash of its content. Any other set must be signed by the signer of the pinned set, have
the same name, and have a version that is not lower. The operator can accept a set that does not
meet these conditions; its seal then records the acceptance.
"""

import json
import re
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from platformdirs import user_state_path
from pydantic import ValidationError

from pa_console.private_files import make_private_folder, replace_private
from pa_console.schema.base import StrictModel
from pa_console.schema.rule import RulesSeal, Version

PIN_FILE = "rules-pin.json"
SHIPPED = "shipped"


class RefusedRulesError(ValueError):
    """A rule set that is weaker than the pinned one; the message gives the reason and remedies."""


class RulesPin(StrictModel):
    """The last accepted set; `signer` is its key's fingerprint, "shipped", or "" if unsigned.

    `accepted` is the reason why the operator had to accept it, or "" if it was accepted
    automatically.
    """

    name: str
    version: Version = ""
    content_sha256: str
    signer: str = ""
    accepted: str = ""

    @property
    def words(self) -> str:
        """A description of the set."""
        by = {"": "not signed", SHIPPED: "as shipped"}.get(self.signer, f"signed by {self.signer}")
        return f"{self.name!r}{f' version {self.version}' if self.version else ''}, {by}"


def pin_of(name: str, seal: RulesSeal) -> RulesPin:
    """Return the pin that a set with this name and seal would get."""
    signer = SHIPPED if seal.standing == SHIPPED else seal.key
    return RulesPin(
        name=name,
        version=seal.version,
        content_sha256=seal.content_sha256,
        signer=signer,
        accepted=seal.accepted,
    )


def downgrade(pinned: RulesPin, other: RulesPin) -> str:
    """Return why `other` is weaker than `pinned`, or "" if it is not."""
    if other.signer == SHIPPED:
        return ""
    if pinned.signer and not other.signer:
        return f"{other.words}, but the set used before is {pinned.words}"
    if pinned.signer and other.signer != pinned.signer:
        return f"{other.words}, but the set used before is {pinned.words}"
    if pinned.signer and other.name != pinned.name:
        return f"{other.words}, but the set used before is another one, {pinned.words}"
    if other.name == pinned.name and _order(other.version) < _order(pinned.version):
        lower = other.version or "none"
        return f"its version is {lower}, lower than {pinned.version} of the set used before"
    if pinned.accepted and not other.signer and other.content_sha256 != pinned.content_sha256:
        return f"{other.words}, but not with the content that was accepted before"
    return ""


class RulesPins:
    """The pin of the user, stored at `path` or, if that is None, in the user's state folder."""

    def __init__(
        self, path: Path | None = None, now: Callable[[], datetime] = lambda: datetime.now(UTC)
    ) -> None:
        self._path = path if path is not None else user_state_path("pa-console") / PIN_FILE
        self._now = now

    def read(self) -> RulesPin | None:
        """Return the pin, or None before the first; raises RefusedRulesError for a broken file."""
        try:
            return RulesPin.model_validate_json(self._path.read_bytes())
        except FileNotFoundError:
            return None
        except (OSError, ValidationError) as error:
            raise RefusedRulesError(
                f"{self._path}: the pin of the rules used before is unreadable ({_first(error)}). "
                "Restore the file, or remove it and review the rules that are used next"
            ) from error

    def refusal(self, name: str, seal: RulesSeal) -> str:
        """Return why the set is refused, or "" if it is accepted; raises the errors of `read`."""
        pinned = self.read()
        return "" if pinned is None else downgrade(pinned, pin_of(name, seal))

    def admit(self, name: str, seal: RulesSeal, *, accept: bool) -> RulesSeal:
        """Return the seal of a set that is put in force, and pin the set.

        With `accept`, the operator accepts a refused set, and the seal records this for later
        sessions too. Raises RefusedRulesError, and OSError if the pin cannot be written.
        """
        pinned = self.read()
        pin = pin_of(name, seal)
        if pinned is not None and pin.signer == SHIPPED:
            return seal
        why = "" if pinned is None else downgrade(pinned, pin)
        if why and not accept:
            raise RefusedRulesError(
                f"the rules {name!r} are refused: {why}. Restore the set that was used, use the "
                "shipped set (--rules checkpoint), or review this set and start console or mission "
                "with --accept-rules, which the log and every report will state"
            )
        note = f"{why} (accepted {self._now():%Y-%m-%d})" if why else ""
        if pinned is not None and not why and _same(pinned, pin):
            note = pinned.accepted
        sealed = seal.model_copy(update={"accepted": note})
        self._write(pin_of(name, sealed), pinned)
        return sealed

    def _write(self, pin: RulesPin, before: RulesPin | None) -> None:
        """Write the pin, readable by its owner only; until it is complete, the old file stays."""
        if pin != before:
            make_private_folder(self._path.parent)
            replace_private(self._path, json.dumps(pin.model_dump(), indent=2).encode())


def _same(pin: RulesPin, other: RulesPin) -> bool:
    return (pin.signer, pin.name, pin.content_sha256) == (
        other.signer, other.name, other.content_sha256,
    )  # fmt: skip


def _order(version: str) -> tuple[tuple[int, int, str], ...]:
    """Return a sort key for versions: numbers compare as numbers and come after words."""
    parts = re.findall(r"\d+|[A-Za-z]+", version)
    return tuple((1, int(part), "") if part.isdigit() else (0, 0, part.lower()) for part in parts)


def _first(error: Exception) -> str:
    if isinstance(error, ValidationError):
        return str(error.errors(include_url=False)[0]["msg"])
    return str(getattr(error, "strerror", "") or error)
