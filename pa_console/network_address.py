"""The network addresses of servers: how one is read and written, and which are this machine's."""

import ipaddress
from collections.abc import Mapping
from urllib.parse import SplitResult, urlsplit


def server_address(
    text: str, ports: Mapping[str, int], server: str, form: str
) -> tuple[SplitResult, str, int]:
    """Read `scheme://host[:port]` and what follows; return its parts, the host and the port.

    `ports` has the usual port of each scheme that is understood. Raises ValueError saying what is
    wrong, with `server` as the words for what is meant and `form` as what to write.
    """
    try:
        parts = urlsplit(text)
        port = parts.port
    except ValueError as error:
        raise ValueError(f"{text}: {error}; the form is {form}") from None
    if parts.scheme not in ports or not parts.hostname:
        raise ValueError(f"{text} is no address of {server}; the form is {form}")
    return parts, parts.hostname, port or ports[parts.scheme]


def host_and_port(host: str, port: int) -> str:
    """Return the two as they stand in an address, an IPv6 host in brackets."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def is_this_machine(host: str) -> bool:
    """Return whether data sent to `host` stays on this machine; other names are not looked up."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
