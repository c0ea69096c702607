"""The files of a site: an authority, certificates for all clients, and Mosquitto's configuration.

The name in a certificate is also the client id of its connection. Therefore, no client can pretend
to be another or end its connection. A robot may write and read only its own topics.
"""

import getpass
import ipaddress
import re
import socket
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from pa_console.fleets.vda5050.additions import (
    SIGNED,
    SITE,
    TRUST,
    Countersignature,
    RecordsAsked,
    SessionRecords,
    StopAsked,
)
from pa_console.fleets.vda5050.broker import CA_FILE, NUMBERS
from pa_console.fleets.vda5050.wire import Topic
from pa_console.private_files import make_private_folder, replace_private

CA_KEY, BROKER = "ca.key", "broker"
STATION, TELEMETRY, JOINED = "station", "telemetry", "joined"
"""The roles of a console.

A station commands over one connection and receives reports over another. A joined console watches,
countersigns and asks for stops.
"""

ROLES = (STATION, TELEMETRY, JOINED)
RESERVED = ("ca", BROKER, *ROLES, SITE.serial_number, TRUST.serial_number)
CONFIGURATION, ACCESS = "mosquitto.conf", "access.txt"
CA_YEARS, YEARS = 10, 2
EARLIER = timedelta(days=1)
"""The age with which a certificate is issued, so that a machine with a slow clock accepts it."""

ROBOT_WRITES = ("connection", "state", "factsheet", "detections", "visualization")
ROBOT_READS = ("order", "instantActions", "zoneSet", "responses")
SITE_WRITES = ("connection", "site", "clockDone", "incidentDone", "told")
SITE_READS = ("clock", "incident")
BINDING = ("use_identity_as_username true", "use_username_as_clientid true")
"""The lines that tie a client id to a certificate.

Without them, a client can connect with the client id of another one. The broker then ends the
connection of the other client, which misses its stops.
"""

_CONFIGURATION = """\
# Mosquitto for the site {site}: start it with  mosquitto -c {folder}/{file}
listener {port}
cafile {folder}/{ca}
certfile {folder}/{broker}.crt
keyfile {folder}/{broker}.key
require_certificate true
{binding}
allow_anonymous false
acl_file {folder}/{access}
user {user}
set_tcp_nodelay true
persistence false
max_packet_size 300000
max_queued_messages 10000
"""


@dataclass(frozen=True)
class SiteFiles:
    """The certificates in `folder` that were made, and those that were kept unchanged."""

    folder: Path
    made: tuple[str, ...]
    kept: tuple[str, ...]


@dataclass(frozen=True)
class Machines:
    """Further machines, each with certificates in a folder inside the site's folder.

    Machines in `joined` watch and countersign. Machines in `stations` may command as well.
    """

    stations: tuple[str, ...] = ()
    joined: tuple[str, ...] = ()

    def of(self, role: str) -> tuple[str, ...]:
        """Return the machines with certificates of `role`; "" is the site's own machine."""
        others = self.stations if role != JOINED else (*self.stations, *self.joined)
        return ("", *dict.fromkeys(others))

    def and_those_in(self, access_list: str) -> "Machines":
        """Return these machines together with the machines in an earlier access list."""

        def named(role: str) -> tuple[str, ...]:
            return tuple(re.findall(rf"^user {role}-([A-Za-z]\w*)$", access_list, re.MULTILINE))

        return Machines((*self.stations, *named(STATION)), (*self.joined, *named(JOINED)))


def write_site(
    folder: Path,
    site: str,
    names: Sequence[str],
    hosts: Sequence[str],
    port: int,
    *,
    machines: Machines = Machines(),
) -> SiteFiles:
    """Make or complete the files of a site for robots and cameras with these `names`.

    Only the user can read the files. Raises OSError if the folder cannot be written.
    """
    folder = folder.expanduser().absolute()
    make_private_folder(folder)
    authority = _authority(folder, site)
    made: list[str] = []
    kept: list[str] = []
    people = [(machine, role) for role in ROLES for machine in machines.of(role)]
    certificates = [
        (BROKER, BROKER),
        *(each for machine, role in people for each in _certificates(machine, role)),
        *((name, name) for name in (SITE.serial_number, *names)),
    ]
    for machine in machines.of(JOINED):
        make_private_folder(folder / machine)
        _write(folder / machine / CA_FILE, (folder / CA_FILE).read_text("ascii"))
    for file, name in certificates:
        if (folder / f"{file}.crt").exists():
            kept.append(file)
            continue
        _issue(folder / file, authority, name, hosts if name == BROKER else ())
        made.append(file)
    before = (folder / ACCESS).read_text("utf-8") if (folder / ACCESS).exists() else ""
    _write(folder / ACCESS, access(site, machines.and_those_in(before)))
    configuration = _CONFIGURATION.format(
        site=site,
        folder=folder,
        file=CONFIGURATION,
        port=port,
        ca=CA_FILE,
        broker=BROKER,
        binding="\n".join(BINDING),
        access=ACCESS,
        user=getpass.getuser(),
    )
    _write(folder / CONFIGURATION, configuration)
    return SiteFiles(folder, tuple(made), tuple(kept))


def _certificates(machine: str, role: str) -> Iterator[tuple[str, str]]:
    """Yield each certificate of a machine: its file without the suffix, and its name."""
    for number in NUMBERS:
        file = f"{role}{number}"
        yield (f"{machine}/{file}", f"{role}-{machine}{number}") if machine else (file, file)


def unbound(configuration: str) -> tuple[str, ...]:
    """Return the lines of BINDING that are missing from a configuration."""
    lines = [line.split() for line in configuration.splitlines()]
    return tuple(line for line in BINDING if line.split() not in lines)


def access(site: str, machines: Machines = Machines()) -> str:
    """Return the access list of the topics, in which %u is the name in a certificate."""
    robot = f"{site}/v3/+/%u"
    own = f"{site}/v3/{SITE.manufacturer}/{SITE.serial_number}"
    station = f"{site}/v3/{SITE.manufacturer}/+"
    trust = [str(Topic(site, TRUST, kind.TOPIC)) for kind in SIGNED]
    everything = f"topic read {site}/v3/#"
    of_role = {
        STATION: (
            everything,
            *(f"topic write {site}/v3/+/+/{topic}" for topic in ROBOT_READS),
            *(f"topic write {own}/{topic}" for topic in SITE_READS),
            *(f"topic write {topic}" for topic in trust),
            f"topic write {station}/{SessionRecords.TOPIC}",
        ),
        TELEMETRY: (everything,),
        JOINED: (
            everything,
            *(
                f"topic write {station}/{kind.TOPIC}"
                for kind in (RecordsAsked, Countersignature, StopAsked)
            ),
        ),
    }
    lines = [
        "# Everybody writes and reads their own topics, which have the name in their certificate.",
        *(f"pattern write {robot}/{topic}" for topic in ROBOT_WRITES),
        *(f"pattern read {robot}/{topic}" for topic in ROBOT_READS),
        "# Everybody reads the members of the site and the station in command.",
        *(f"pattern read {topic}" for topic in trust),
        "",
        f"user {SITE.serial_number}",
        *(f"topic write {own}/{topic}" for topic in SITE_WRITES),
        *(f"topic read {own}/{topic}" for topic in SITE_READS),
    ]
    for role, may in of_role.items():
        for machine in machines.of(role):
            for _, user in _certificates(machine, role):
                lines += ["", f"user {user}", *may]
    return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class _Authority:
    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey


def _authority(folder: Path, site: str) -> _Authority:
    """Return the authority of the folder; make one if there is none."""
    certificate_file, key_file = folder / CA_FILE, folder / CA_KEY
    if certificate_file.exists() and key_file.exists():
        key = serialization.load_pem_private_key(key_file.read_bytes(), None)
        if not isinstance(key, ec.EllipticCurvePrivateKey):
            raise ValueError(f"{key_file} is not the key of an authority that was made here")
        return _Authority(x509.load_pem_x509_certificate(certificate_file.read_bytes()), key)
    key = ec.generate_private_key(ec.SECP256R1())
    name = _name(f"PA Console site {site}")
    certificate = (
        _builder(name, name, key, CA_YEARS)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(signs=True), critical=True)
        .sign(key, hashes.SHA256())
    )
    _keep(folder / CA_FILE.removesuffix(".crt"), certificate, key)
    return _Authority(certificate, key)


def _issue(file: Path, authority: _Authority, name: str, hosts: Sequence[str]) -> None:
    """Make a key and a certificate for `name` in `file`; `hosts` are given for a broker only."""
    key = ec.generate_private_key(ec.SECP256R1())
    purpose = ExtendedKeyUsageOID.SERVER_AUTH if hosts else ExtendedKeyUsageOID.CLIENT_AUTH
    builder = (
        _builder(_name(name), authority.certificate.subject, key, YEARS)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(signs=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage([purpose]), critical=False)
        .add_extension(
            x509.AuthorityKeyIdentifier.from_issuer_public_key(authority.key.public_key()),
            critical=False,
        )
    )
    if hosts:
        names = x509.SubjectAlternativeName([_host(host) for host in hosts])
        builder = builder.add_extension(names, critical=False)
    _keep(file, builder.sign(authority.key, hashes.SHA256()), key)


def default_hosts() -> tuple[str, ...]:
    """Return the host names and addresses of the broker on this machine."""
    return tuple(dict.fromkeys(("localhost", "127.0.0.1", socket.gethostname())))


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePrivateKey, years: int
) -> x509.CertificateBuilder:
    now = datetime.now(UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - EARLIER)
        .not_valid_after(now + timedelta(days=365 * years))
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
    )


def _usage(*, signs: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs,
        key_cert_sign=signs,
        crl_sign=signs,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _name(common: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common)])


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _keep(file: Path, certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey) -> None:
    """Write a key and its certificate to `file` with the suffixes .key and .crt."""
    secret = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    replace_private(file.with_name(f"{file.name}.key"), secret)
    replace_private(
        file.with_name(f"{file.name}.crt"), certificate.public_bytes(serialization.Encoding.PEM)
    )


def _write(path: Path, text: str) -> None:
    replace_private(path, text.encode())
