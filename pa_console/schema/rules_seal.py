"""Which rule set is in force, by its version and content, and who vouches for it."""

from typing import Literal

from pa_console.schema.base import Hex32, Hex64, StrictModel
from pa_console.schema.rule import Version

Standing = Literal["shipped", "own key", "known key", "unknown key", "not signed", "altered"]

_WORDS: dict[Standing, str] = {
    "shipped": "as shipped",
    "own key": "signed by this machine's key",
    "known key": "signed by a known key",
    "unknown key": "signed by an unknown key",
    "not signed": "not signed",
    "altered": "ALTERED since it was signed",
}
SHORT = 12


class RulesSeal(StrictModel):
    """A rule set's version, the hash of its content, and its standing.

    `key` is the fingerprint of the key of an intact signature, `signer` the name that it has among
    the known keys; `problem` says what is wrong with an altered set. `accepted` says why the
    operator had to accept the set, empty when it was taken by itself. `core` is the hash of the
    core that is in force besides, empty for none. A set with `no_critical_check` has no critical
    rule of its own that software decides.
    """

    version: Version = ""
    content_sha256: str = ""
    standing: Standing = "not signed"
    key: str = ""
    signer: str = ""
    problem: str = ""
    accepted: str = ""
    core: str = ""
    no_critical_check: bool = False

    @property
    def altered(self) -> bool:
        """Whether it was signed, and is not what was signed."""
        return self.standing == "altered"

    @property
    def words(self) -> str:
        """The standing as people read it."""
        return _WORDS[self.standing] + (f" ({self.signer})" if self.signer else "")

    @property
    def warnings(self) -> tuple[str, ...]:
        """What people must be told of the set in red wherever it is shown."""
        told: list[str] = []
        if self.accepted:
            told.append(f"accepted by the operator although: {self.accepted}")
        if self.no_critical_check:
            told.append("no critical rule of this set is checked by software")
        return tuple(told)

    @property
    def title(self) -> str:
        """The version, if there is one, and the beginning of the hash."""
        version = f"version {self.version}" if self.version else ""
        return f"{version} {self.content_sha256[:SHORT]}".strip()


class RulesSignature(StrictModel):
    """A signature file: what was signed, the public key, and its signature, in hexadecimal."""

    name: str
    version: Version
    content_sha256: Hex32
    key: Hex32
    signature: Hex64
