"""Which rule set is in force, by its version and content, and who vouches for it."""

from typing import Literal

from pa_console.schema.base import Hex32, Hex64, StrictModel
from pa_console.schema.rule import Version

Standing = Literal["own key", "known key", "unknown key", "not signed", "altered"]

_WORDS: dict[Standing, str] = {
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
    the known keys; `problem` says what is wrong with an altered set.
    """

    version: Version = ""
    content_sha256: str = ""
    standing: Standing = "not signed"
    key: str = ""
    signer: str = ""
    problem: str = ""

    @property
    def altered(self) -> bool:
        """Whether it was signed, and is not what was signed."""
        return self.standing == "altered"

    @property
    def words(self) -> str:
        """The standing as people read it."""
        return _WORDS[self.standing] + (f" ({self.signer})" if self.signer else "")

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
