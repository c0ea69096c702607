"""The roster, revocations and takeovers of a site as retained messages on its bus."""

from collections.abc import Mapping
from datetime import datetime
from typing import Protocol

from pa_console.fleets.bus.client import Sent
from pa_console.fleets.vda5050 import additions
from pa_console.fleets.vda5050.numbers import Numbers
from pa_console.fleets.vda5050.topics import Topic
from pa_console.schema.command import DeviceCommand


class Keys(Protocol):
    """The keys and the trust of a station; `StationAuthority` is one."""

    @property
    def refusal(self) -> str:
        """The reason why this station may move nothing at present, '' when it may."""
        ...

    @property
    def newest(self) -> Mapping[str, str]:
        """The newest signed message of each kind, which vehicles go by."""
        ...

    def authorize(self, command: DeviceCommand) -> str | None:
        """Return the token that a command travels with, None for one without."""
        ...

    def take(self, message: str) -> str:
        """Accept a signed roster, revocation or takeover; return why not, '' when it is taken."""
        ...

    def objection_to(self, request_id: str, person: str, signature: str) -> str:
        """Return why a signature from elsewhere does not count for a request here, '' if it may."""
        ...


def signed_messages(
    site: str, messages: Mapping[str, str], numbers: Numbers, sent: datetime
) -> list[Sent]:
    """Return the signed `messages` by kind as they are retained on the bus, in the right order."""
    found: list[Sent] = []
    for kind in additions.SIGNED:
        if (message := messages.get(kind.TOPIC)) is not None:
            header = numbers.header(additions.TRUST, kind.TOPIC, sent)
            topic = Topic(site, additions.TRUST, kind.TOPIC)
            found.append(Sent(str(topic), kind(**header, message=message).write(), 1, retain=True))
    return found
