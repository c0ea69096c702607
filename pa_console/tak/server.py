"""The address of a TAK server and the client certificate for it."""

import ipaddress
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Self
from urllib.parse import urlsplit

PORTS = {"tcp": 8087, "tls": 8089}
FORM = "tcp://HOST[:PORT] or tls://HOST[:PORT]"
PASSWORD_VARIABLE = "PA_CONSOLE_TAK_PASSWORD"
"""The password of a certificate's key."""
CIPHERS = "DEFAULT"


@dataclass(frozen=True)
class Certificate:
    """A client's certificate and key, and the authority whose servers it trusts.

    Certificate and key are PEM, also in one file, or one PKCS #12 file as TAK servers issue it.
    """

    certificate: Path
    key: Path
    ca: Path

    @classmethod
    def of(cls, certificate: Path | None, key: Path | None, ca: Path | None) -> Self | None:
        """Return the certificate, None without any option; raise ValueError for a part of them."""
        if certificate is None and key is None and ca is None:
            return None
        if certificate is None or ca is None:
            missing = "--tls-cert" if certificate is None else "--tls-ca"
            raise ValueError(
                f"{missing} is missing: TLS takes the client's certificate (--tls-cert) and that "
                "of the authority which vouches for the server (--tls-ca)"
            )
        found = cls(certificate, key or certificate, ca)
        for option, path in (
            ("--tls-cert", found.certificate),
            ("--tls-key", found.key),
            ("--tls-ca", found.ca),
        ):
            if not path.is_file():
                raise ValueError(f"{option} {path}: there is no such file")
        if not os.environ.get(PASSWORD_VARIABLE) and found.locked:
            raise ValueError(f"{found.key} is encrypted: set {PASSWORD_VARIABLE}")
        return found

    @property
    def locked(self) -> bool:
        """True if the key needs a password."""
        return self.key.suffix == ".p12" or b"ENCRYPTED" in self.key.read_bytes()


@dataclass(frozen=True)
class TakServer:
    """A TAK server that takes CoT as a stream of XML."""

    host: str
    port: int
    certificate: Certificate | None = None

    @classmethod
    def parse(cls, text: str, certificate: Certificate | None = None) -> Self:
        """Read `tls://host:8089`; raise ValueError that names the problem."""
        try:
            parts = urlsplit(text)
            port = parts.port
        except ValueError as error:
            raise ValueError(f"{text}: {error}; the form is {FORM}") from None
        if parts.scheme not in PORTS or not parts.hostname:
            raise ValueError(f"{text} is no address of a TAK server; the form is {FORM}")
        if parts.path.strip("/") or parts.query or parts.fragment or parts.username:
            raise ValueError(f"{text}: only host and port are understood; {FORM}")
        if parts.scheme == "tls" and certificate is None:
            raise ValueError(f"{text} needs --tls-cert and --tls-ca")
        if parts.scheme == "tcp" and certificate is not None:
            raise ValueError(f"{text} is not encrypted, so --tls-cert is in vain; use tls://")
        if ":" in parts.hostname and certificate is None:
            raise ValueError(f"{text}: without TLS give the name of the host, or its IPv4 address")
        return cls(parts.hostname, port or PORTS[parts.scheme], certificate)

    @property
    def open_to_all(self) -> bool:
        """True if events leave this machine without encryption."""
        if self.certificate is not None or self.host == "localhost":
            return False
        try:
            return not ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return True

    @property
    def warning(self) -> str:
        """The warning about a server without encryption."""
        return f"what goes to {self} can be read and altered on the way; use tls://"

    def settings(self) -> dict[str, str]:
        """Return the server as settings of PyTAK, which needs `%` escaped."""
        found = {"COT_URL": str(self)}
        if self.certificate is not None:
            given = {
                "PYTAK_TLS_CLIENT_CERT": str(self.certificate.certificate),
                "PYTAK_TLS_CLIENT_KEY": str(self.certificate.key),
                "PYTAK_TLS_CLIENT_CAFILE": str(self.certificate.ca),
                "PYTAK_TLS_CLIENT_CIPHERS": CIPHERS,
                "PYTAK_TLS_CLIENT_PASSWORD": os.environ.get(PASSWORD_VARIABLE, ""),
            }
            found |= {name: value.replace("%", "%%") for name, value in given.items()}
        return found

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'tcp' if self.certificate is None else 'tls'}://{host}:{self.port}"
