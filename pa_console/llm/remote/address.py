"""The address of a model's server, the permission to send prompts to it, and its key.

A model on a server is named as `openai:BASE_URL#NAME`. Requests go only to the named server.
"""

import os
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from urllib.parse import urlsplit

from pa_console.llm.backend import ModelError
from pa_console.network_address import is_this_machine
from pa_console.schema.events.event import ServerUse

PREFIX = "openai:"
FORM = "openai:BASE_URL#NAME, as in openai:http://127.0.0.1:8080/v1#qwen2.5-7b"
USUAL_PATH = "/v1"
KEY_VARIABLE = "PA_CONSOLE_SERVER_KEY"
KEY_VARIABLES: dict[ServerUse, str] = {
    "planner": KEY_VARIABLE,
    "judge": "PA_CONSOLE_JUDGE_SERVER_KEY",
    "second reader": "PA_CONSOLE_READER_SERVER_KEY",
}
"""The environment variables with the servers' keys, by the use of the model."""
KEYRING_SERVICE = "pa-console"


@dataclass(frozen=True)
class ServerAddress:
    """The model `name` of the server at `base_url`."""

    base_url: str
    name: str

    @classmethod
    def parse(cls, text: str) -> "ServerAddress":
        """Parse `openai:BASE_URL#NAME`; raises ModelError for an invalid address.

        An address with a password or a query is refused, because addresses are written to the
        session log.
        """
        try:
            parts = urlsplit(text.removeprefix(PREFIX))
            whole = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
        except ValueError as error:
            raise ModelError(f"not a model on a server: {error}; write {FORM}") from error
        if parts.username is not None or parts.password is not None or parts.query:
            raise ModelError(
                "the address of a model's server must not contain a key: write "
                f"openai:BASE_URL#NAME, and put the key in {KEY_VARIABLE} or the keyring"
            )
        if not text.startswith(PREFIX) or not whole or not parts.fragment:
            raise ModelError(f"{text!r} is not a model on a server: write {FORM}")
        path = parts.path.rstrip("/") or USUAL_PATH
        return cls(f"{parts.scheme}://{parts.netloc}{path}", parts.fragment)

    def __str__(self) -> str:
        return f"{PREFIX}{self.base_url}#{self.name}"

    @property
    def private(self) -> bool:
        """True if no other host can read the traffic, because it uses loopback or https."""
        parts = urlsplit(self.base_url)
        return parts.scheme == "https" or is_this_machine(parts.hostname or "")

    def allow(self, *, plain: bool) -> None:
        """Raise ModelError if prompts would be sent in clear text, unless `plain` allows it."""
        if not self.private and not plain:
            raise ModelError(
                f"{self}: the operator's words and the picture would cross the network in clear "
                "text; use an https address, or allow clear text with the setting plain_servers"
            )


@dataclass(frozen=True)
class ServerKey:
    """The key for a server, and its source; the key itself is never shown."""

    source: str = "none"
    secret: str = field(default="", repr=False)

    @classmethod
    def find(cls, address: ServerAddress, variable: str = KEY_VARIABLE) -> "ServerKey":
        """Return the key from the environment's `variable`, or else from the keyring, or else none.

        The keyring is searched only if the package `keyring` is installed. The key is stored under
        the service pa-console, with the address of the server as the user.
        """
        if secret := os.environ.get(variable, "").strip():
            return cls(variable, secret)
        if find_spec("keyring") is None:
            return cls()
        try:
            keyring = import_module("keyring")
            secret = str(keyring.get_password(KEYRING_SERVICE, address.base_url) or "").strip()
        except Exception:  # a keyring that is locked or has no backend may raise anything
            return cls()
        return cls("the keyring", secret) if secret else cls()

    def hidden_in(self, text: str) -> str:
        """Return `text` with `[key]` in place of the key."""
        return text.replace(self.secret, "[key]") if self.secret else text
