"""The wire format of messages: strict, limited in size, of this version, on numbered topics."""

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
"""The largest message, bytes; no message of the protocol needs more."""
MOST_ITEMS = 1000


class UnreadableError(ValueError):
    """An invalid message for its topic; the text has the reason in one line."""


def in_milliseconds(time: datetime) -> datetime:
    """Return `time` as it reads once it has been on the bus."""
    return time.replace(microsecond=time.microsecond // 1000 * 1000)


def _written(time: datetime) -> str:
    return time.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z"


def _of_this_version(version: str) -> str:
    if version.split(".", maxsplit=1)[0] != VERSION.split(".", maxsplit=1)[0]:
        raise ValueError(f"version {version!r} of the protocol, only 3 is understood")
    return version


Stamp = Annotated[AwareDatetime, PlainSerializer(_written, when_used="json")]
"""When a message was sent, UTC; milliseconds on the bus."""

Text = Annotated[str, StringConstraints(max_length=2000)]
Token = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_.:-]+$", max_length=64)]
"""A part of a topic: a manufacturer or a serial number."""

Id = Annotated[str, StringConstraints(pattern=r"^[ -~]*$", max_length=128)]
"""An identifier chosen by another program: printable ASCII, "" for none."""

T = TypeVar("T")
Items = Annotated[tuple[T, ...], FailFast()]
"""A list in a message; the first wrong item ends its reading, so that none costs much to refuse."""

Count = Annotated[int, Field(ge=0, lt=2**63)]
Finite = Annotated[float, Field(ge=-1e7, le=1e7)]
"""A coordinate in metres or a speed; nothing on this planet is farther away."""


class Wire(BaseModel):
    """An immutable part of a message, named in camel case on the bus.

    A field that we do not know is left out: the standard lets a manufacturer add some. A known one
    of another type, or a number that is none, makes the message unreadable.
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
    """The header of every message; `header_id` counts the messages of one topic."""

    TOPIC: ClassVar[str]

    header_id: Count
    timestamp: Stamp
    version: Annotated[str, AfterValidator(_of_this_version)] = VERSION
    manufacturer: Token
    serial_number: Token

    @classmethod
    def read(cls, payload: bytes) -> Self:
        """Return the message in `payload`; raises UnreadableError that describes the problem."""
        if len(payload) > MOST_BYTES:
            raise UnreadableError(f"{len(payload)} bytes, more than {MOST_BYTES} are not read")
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
        """Return the message as it goes on the bus; what is not set is left out."""
        return self.model_dump_json(exclude_none=True).encode()


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


class Numbers:
    """Counts messages by `<serial number>/<topic>`."""

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
        """Return the number of the last message by topic, of those sent since the last call."""
        fresh, self._fresh = self._fresh, {}
        return fresh

    def saw(self, identity: Identity, topic: str, number: int) -> None:
        """Note that the message of this number has come."""
        self._seen[f"{identity.serial_number}/{topic}"] = number

    def has_seen(self, numbers: Mapping[str, int]) -> bool:
        """Return whether every one of the messages has come, or a later one of its topic."""
        return all(self._seen.get(key, 0) >= number for key, number in numbers.items())
