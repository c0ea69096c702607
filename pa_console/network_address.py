"""The network addresses of servers: parsing, formatting, and a test for this machine."""

import ipaddress
from collections.abc import Mapping
from urllib.parse import SplitResult, urlsplit


def server_address(
    text: str, ports: Mapping[str, int], server: str, form: str
) -> tuple[SplitResult, str, int]:
    """Parse an address `scheme://host[:port]...`; return its parts, its host and its port.

    `ports` has the default port of each supported scheme. Raises ValueError if the address is not
    valid; the message contains `server`, the kind of server, and `form`, the expected form.
    """
    try:
        parts = urlsplit(text)
        port = parts.port
    except ValueError as error:
        raise ValueError(f"{text}: {error}; the form is {form}") from None
    if parts.scheme not in ports or not parts.hostname:
        raise ValueError(f"{text} is not an address of {server}; the form is {form}")
    return parts, parts.hostname, port or ports[parts.scheme]


def host_and_port(host: str, port: int) -> str:
    """Return host and port in the form of an address, with an IPv6 host in brackets."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def is_this_machine(host: str) -> bool:
    """Return whether data sent to `host` stays on this machine; host names are not resolved."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
