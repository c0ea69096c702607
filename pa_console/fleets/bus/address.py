"""Where a site's broker is, and with which certificates one is let in."""

import ipaddress
import ssl
from dataclasses import dataclass
from pathlib import Path
from typing import Self
from urllib.parse import urlsplit

from pydantic import TypeAdapter, ValidationError

from pa_console.fleets.vda5050.wire import Token

PORTS = {"mqtt": 1883, "mqtts": 8883}
INTERFACE = "vda5050"
CA_FILE = "ca.crt"
FORM = "mqtts://HOST[:PORT][/SITE]"


@dataclass(frozen=True)
class Credentials:
    """A certificate with its key, and that of the authority which vouches for the broker."""

    ca: Path
    certificate: Path
    key: Path

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


def _is_this_machine(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
