"""The address of a site's broker, and the certificates of its clients."""

import fcntl
import ipaddress
import ssl
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import BinaryIO, Self
from urllib.parse import urlsplit

from pydantic import TypeAdapter, ValidationError

from pa_console.fleets.vda5050.wire import Token

PORTS = {"mqtt": 1883, "mqtts": 8883}
INTERFACE = "vda5050"
CA_FILE = "ca.crt"
FORM = "mqtts://HOST[:PORT][/SITE]"
NUMBERS = ("", "-2", "-3")
"""The endings of the certificates that one machine has for a role, such as `station` and
`station-2`: a console, a script beside it, and a verb of `keys` beside both."""


@dataclass(frozen=True)
class Credentials:
    """A certificate, its key, and the certificate of the authority that signed the broker's."""

    ca: Path
    certificate: Path
    key: Path
    claimed: BinaryIO | None = field(default=None, compare=False, repr=False)
    """The file of the key, which no other program of this machine claims while it is open."""

    @classmethod
    def of(cls, folder: Path, name: str) -> Self:
        """Return those of `name` in a folder that `site init` made; raises ValueError."""
        found = cls(folder / CA_FILE, folder / f"{name}.crt", folder / f"{name}.key")
        for path in (found.ca, found.certificate, found.key):
            if not path.is_file():
                raise ValueError(
                    f"{path} is not there; 'pa-console site init {folder}' makes certificates"
                )
        return found

    @classmethod
    def claim(cls, folder: Path, role: str) -> Self:
        """Return those of `role` in a folder that no other program of this machine uses.

        The broker lets one connection in by each certificate: a second one would end the first,
        and with it that program's stops. Raises ValueError when there are none, or none is free.
        """
        alike = [f"{role}{number}" for number in NUMBERS]
        names = [name for name in alike if (folder / f"{name}.crt").is_file()]
        for name in names or [role]:
            found = cls.of(folder, name)
            with suppress(BlockingIOError):
                return replace(found, claimed=_lock(found.key))
        raise ValueError(
            f"other programs of this machine use {', '.join(f'{name}.crt' for name in names)} "
            f"in {folder}, and each connection needs a certificate of its own; end one of them, or "
            "make more where ca.key is: 'pa-console site init FOLDER --station NAME' makes a "
            "folder NAME in it, to be given with --certificates"
        )

    def release(self) -> None:
        """Let other programs of this machine use them."""
        if self.claimed is not None:
            self.claimed.close()

    def context(self) -> ssl.SSLContext:
        """Return how a client with these speaks TLS; raises ValueError for files that do not."""
        try:
            context = ssl.create_default_context(cafile=str(self.ca))
            context.minimum_version = ssl.TLSVersion.TLSv1_2
            context.load_cert_chain(str(self.certificate), str(self.key))
        except (OSError, ssl.SSLError) as error:
            raise ValueError(f"the certificates beside {self.ca} cannot be used: {error}") from None
        return context


@dataclass(frozen=True)
class BrokerAddress:
    """A broker and the site on it; a site's name is the first part of all its topics."""

    host: str
    port: int
    site: str = INTERFACE
    tls: bool = False

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read `mqtts://host:8883/site`; raises ValueError saying what is wrong with it.

        Without encryption only this machine is spoken to.
        """
        try:
            parts = urlsplit(text)
            port = parts.port
        except ValueError as error:
            raise ValueError(f"{text}: {error}; the form is {FORM}") from None
        if parts.scheme not in PORTS or not parts.hostname:
            raise ValueError(f"{text} is no address of a broker; the form is {FORM}")
        if parts.query or parts.fragment or parts.username or parts.password:
            raise ValueError(f"{text}: only host, port and site are understood; {FORM}")
        tls = parts.scheme == "mqtts"
        if not tls and not _is_this_machine(parts.hostname):
            raise ValueError(f"{text}: mqtt:// is for this machine alone; use mqtts://")
        site = parts.path.strip("/") or INTERFACE
        try:
            TypeAdapter(Token).validate_python(site)
        except ValidationError:
            raise ValueError(f"{text}: {site!r} cannot be the name of a site") from None
        return cls(parts.hostname, port or PORTS[parts.scheme], site, tls)

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'mqtts' if self.tls else 'mqtt'}://{host}:{self.port}/{self.site}"


def _lock(key: Path) -> BinaryIO | None:
    """Return the file of a key, locked until it is closed; BlockingIOError when another has it."""
    try:
        file = key.open("rb")
    except OSError:  # `context` says why it cannot be read
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise
    except OSError:  # a disk without locks: there the broker alone keeps programs apart
        pass
    return file


def _is_this_machine(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
