"""The topics of messages, and the senders in them."""

from typing import Annotated, NamedTuple, Self

from pydantic import TypeAdapter, ValidationError

from pa_console.fleets.vda5050.wire import Token

MAJOR = "v3"
_TOKEN: TypeAdapter[str] = TypeAdapter(Annotated[str, Token])


class Identity(NamedTuple):
    """The manufacturer and serial number of a mobile robot."""

    manufacturer: str
    serial_number: str


class Topic(NamedTuple):
    """`<interface>/v3/<manufacturer>/<serial number>/<name>`."""

    interface: str
    identity: Identity
    name: str

    @classmethod
    def of(cls, text: str) -> Self | None:
        """Return the parts of a topic, None when it is not of this form."""
        parts = text.split("/")
        if len(parts) != 5 or parts[1] != MAJOR:
            return None
        try:
            for part in parts:
                _TOKEN.validate_python(part)
        except ValidationError:
            return None
        return cls(parts[0], Identity(parts[2], parts[3]), parts[4])

    def __str__(self) -> str:
        return "/".join((self.interface, MAJOR, *self.identity, self.name))
