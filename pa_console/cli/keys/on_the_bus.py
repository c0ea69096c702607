"""The signed messages of a site, taken from its bus and retained there."""

import secrets
from collections.abc import Generator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from pa_console.cli.fleet import STATION, claim_credentials
from pa_console.cli.output import errors
from pa_console.fleets.authorization import SignedMessages
from pa_console.fleets.key_folder import KeyFolder

CONNECT_S = 5.0


@contextmanager
def on_bus(folder: KeyFolder, url: str, certificates: Path | None) -> Generator[None]:
    """Take newer messages on the bus at `url` into `folder`; retain the newest there afterwards.

    Does nothing without a `url`. Raises ValueError when no broker lets us in.
    """
    if not url:
        yield
        return
    from pa_console.fleets.vda5050.additions import SIGNED, TRUST, SignedMessage  # noqa: PLC0415
    from pa_console.fleets.vda5050.broker import BrokerAddress  # noqa: PLC0415 - with a bus only
    from pa_console.fleets.vda5050.joining import take_retained  # noqa: PLC0415
    from pa_console.fleets.vda5050.sharing import signed_messages  # noqa: PLC0415
    from pa_console.fleets.vda5050.station_link import StationLink  # noqa: PLC0415
    from pa_console.fleets.vda5050.wire import Numbers  # noqa: PLC0415

    address = BrokerAddress.parse(url)
    name = f"keys-{secrets.token_hex(4)}"
    link = StationLink(address, name, SIGNED, claim_credentials(address, certificates, STATION))
    try:
        if not link.wait_connected(CONNECT_S):
            raise ValueError(f"no broker lets us in at {address}: {link.problem}")
        found = SignedMessages(folder.take)
        for delivery in take_retained(link):
            if isinstance(delivery.message, SignedMessage) and delivery.topic.identity == TRUST:
                found.hear(delivery.message.message)
        yield
        newest = folder.newest
        link.publish(*signed_messages(address.site, newest, Numbers(), datetime.now(UTC)))
    finally:
        link.close()
    errors.print(f"retained at {address}: {', '.join(newest)}", markup=False, soft_wrap=True)
