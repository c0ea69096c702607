"""The wire format of messages: strict types, size limits, headers, topics and message numbers."""

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Annotated, Any, ClassVar, NamedTuple, Self, TypeVar

from pydantic import (
    AfterValidator,
    AwareDatetime,
    BaseModel,
    ConfigDict,
    FailFast,
    Field,
    PlainSerializer,
    StringConstraints,
    TypeAdapter,
    ValidationError,
)
from pydantic.alias_generators import to_camel

VERSION = "3.0.0"
MOST_BYTES = 256 * 1024
"""The largest accepted message, in bytes; no message of the protocol needs more."""
MOST_ITEMS = 1000
"""The largest accepted number of items in a list of a message."""
MAJOR = "v3"
"""The part of a topic that names the version."""


class UnreadableError(ValueError):
    """Raised with a reason of one line if a message is not valid for its topic."""


def in_milliseconds(time: datetime) -> datetime:
    """Return `time` with the precision of the bus, which is milliseconds."""
    return time.replace(microsecond=time.microsecond // 1000 * 1000)


def _written(time: datetime) -> str:
    return time.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z"


def _of_this_version(version: str) -> str:
    if version.split(".", maxsplit=1)[0] != VERSION.split(".", maxsplit=1)[0]:
        raise ValueError(f"version {version!r} of the protocol is not understood, only 3")
    return version


Stamp = Annotated[AwareDatetime, PlainSerializer(_written, when_used="json")]
"""The time at which a message was sent, in UTC with milliseconds on the bus."""

Text = Annotated[str, StringConstraints(max_length=2000)]
Token = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_.:-]+$", max_length=64)]
"""A part of a topic: a manufacturer or a serial number."""

Id = Annotated[str, StringConstraints(pattern=r"^[ -~]*$", max_length=128)]
"""An identifier chosen by another program, in printable ASCII; "" for none."""

T = TypeVar("T")
Items = Annotated[tuple[T, ...], FailFast()]
"""A list in a message; validation stops at the first wrong item, so that a refusal costs little."""

Count = Annotated[int, Field(ge=0, lt=2**63)]
Finite = Annotated[float, Field(ge=-1e7, le=1e7)]
"""A coordinate in metres or a speed; the limit is larger than any distance on earth."""


class Wire(BaseModel):
    """An immutable part of a message, with field names in camel case on the bus.

    Unknown fields are ignored, because the standard allows manufacturers to add fields. A known
    field of the wrong type, or a number that is not finite, makes the message invalid.
    """

    model_config = ConfigDict(
        alias_generator=to_camel,
        validate_by_name=True,
        validate_by_alias=True,
        serialize_by_alias=True,
        extra="ignore",
        frozen=True,
        strict=True,
        allow_inf_nan=False,
    )


class Header(Wire):
    """The header of every message; `header_id` counts the messages on one topic."""

    TOPIC: ClassVar[str]

    header_id: Count
    timestamp: Stamp
    version: Annotated[str, AfterValidator(_of_this_version)] = VERSION
    manufacturer: Token
    serial_number: Token

    @classmethod
    def read(cls, payload: bytes) -> Self:
        """Return the message in `payload`; raises UnreadableError if it is not valid."""
        if len(payload) > MOST_BYTES:
            raise UnreadableError(f"it has {len(payload)} bytes; at most {MOST_BYTES} are read")
        try:
            return cls.model_validate_json(payload)
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False, include_context=False)[0]
            place = ".".join(str(part) for part in first["loc"][:6])
            at = f"{place[:80]}: " if place else ""
            raise UnreadableError(f"{at}{first['msg'][:200]}") from None
        except RecursionError:
            raise UnreadableError("nested too deep") from None

    def write(self) -> bytes:
        """Return the message in the form for the bus, without fields that are None."""
        return self.model_dump_json(exclude_none=True).encode()


_TOKEN: TypeAdapter[str] = TypeAdapter(Annotated[str, Token])


class Identity(NamedTuple):
    """The manufacturer and serial number of a mobile robot."""

    manufacturer: str
    serial_number: str


class Topic(NamedTuple):
    """A topic of the form `<interface>/v3/<manufacturer>/<serial number>/<name>`."""

    interface: str
    identity: Identity
    name: str

    @classmethod
    def of(cls, text: str) -> Self | None:
        """Return the parts of the topic `text`; None if it does not have this form."""
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


class Numbers:
    """The numbers of sent and received messages, by `<serial number>/<topic>`."""

    def __init__(self) -> None:
        self._sent: dict[str, int] = {}
        self._seen: dict[str, int] = {}
        self._fresh: dict[str, int] = {}

    def header(self, identity: Identity, topic: str, sent: datetime) -> dict[str, Any]:
        """Return the header of the next message to, or from, `identity` on a topic."""
        key = f"{identity.serial_number}/{topic}"
        number = self._sent[key] = self._fresh[key] = self._sent.get(key, 0) + 1
        return {
            "header_id": number,
            "timestamp": sent,
            "version": VERSION,
            "manufacturer": identity.manufacturer,
            "serial_number": identity.serial_number,
        }

    def fresh(self) -> dict[str, int]:
        """Return the number of the last message on each topic that had one since the last call."""
        fresh, self._fresh = self._fresh, {}
        return fresh

    def saw(self, identity: Identity, topic: str, number: int) -> None:
        """Record that the message with this number has arrived."""
        self._seen[f"{identity.serial_number}/{topic}"] = number

    def has_seen(self, numbers: Mapping[str, int]) -> bool:
        """Return whether each of the messages, or a later one on its topic, has arrived."""
        return all(self._seen.get(key, 0) >= number for key, number in numbers.items())
