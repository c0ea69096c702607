"""Events of the session: its start and end, telemetry, command, models, log, and the TAK server."""

from datetime import datetime
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from pa_console.schema.base import (
    Hex32,
    Hex64,
    Name,
    NonNegative,
    Payload,
    Point,
    ServerUse,
    StrictModel,
)
from pa_console.schema.evaluation import Variant
from pa_console.schema.incident import Incident
from pa_console.schema.rule import RuleSet, RulesSeal
from pa_console.schema.telemetry import Picture

Level = Literal["info", "warning", "alarm"]
IncidentSource = Literal["operator", "scenario"]
ServerState = Literal["probing", "ready", "unconstrained", "away"]
WorkerState = Literal["loading", "ready", "unconfined", "slow", "dead", "unavailable"]
"""An `unconfined` worker is ready, in a process that this system does not confine."""


class SessionStarted(Payload):
    """Pins everything needed to run the session again.

    A session whose `rules_seal` is altered was started with --unsigned; one of before there were
    seals has none.
    """

    kind: Literal["session_started"] = "session_started"
    session: str
    version: str
    world: str
    world_sha256: str
    rules: str
    rules_sha256: str
    rules_seal: RulesSeal | None = None
    model: str
    model_sha256: str
    seed: int
    scenario: str = ""
    scenario_sha256: str = ""
    sampler: str
    grammar_sha256: str
    readonly: bool = False
    variant: Variant = Field(default_factory=Variant)
    packages: dict[str, str] = {}
    adapters: dict[str, str] = {}
    second_reader: str = Field(
        default="", description="the model that reads unclear orders again, with its SHA-256"
    )
    second_reader_sha256: str = ""
    servers: dict[ServerUse, str] = Field(
        default={},
        exclude_if=lambda servers: not servers,
        description="models on servers that are asked before the own one, by what they are to be",
    )


class SessionResumed(Payload):
    """The session goes on in its own log, after its console had ended without closing it.

    Nothing is dispatched by that. `interrupted` are the missions that were under way: they end as
    held. What had not begun waits again, open alarms are open, a stop stays latched.
    """

    kind: Literal["session_resumed"] = "session_resumed"
    version: str
    interrupted: tuple[str, ...] = ()


class CommandTaken(Payload):
    """Command of the site was taken from another station, whose session is refused from then on.

    `records` and `head` say how far the log of that session had come here: the number of its last
    record, and the hash of it. `by` is the commander who has signed the `epoch`.
    """

    binding: ClassVar[bool] = True

    kind: Literal["command_taken"] = "command_taken"
    station: str
    session: str
    records: int
    head: str
    epoch: int
    by: str


class AuthorityChanged(Payload):
    """A change of this station's right to command: `refusal` is why not, '' if it may.

    It occurs when another station takes command, and when the key of this one is revoked.
    """

    binding: ClassVar[bool] = True

    kind: Literal["authority_changed"] = "authority_changed"
    refusal: str


class RulesReplaced(Payload):
    """Another rule set is in force; a mission that was begun stays under the set it began with.

    `changes` says rule by rule what is different from the set before; `rule_set` is all of it, so
    that the session can be run again whatever becomes of the file.
    """

    binding: ClassVar[bool] = True

    kind: Literal["rules_replaced"] = "rules_replaced"
    rules: str
    rules_sha256: str
    rules_seal: RulesSeal
    changes: tuple[str, ...]
    rule_set: RuleSet


class TelemetryReceived(Payload):
    """A new common operational picture."""

    kind: Literal["telemetry"] = "telemetry"
    picture: Picture


class IncidentHappened(Payload):
    """Something was injected into the simulation: set-up, scenario or what-if."""

    kind: Literal["incident"] = "incident"
    incident: Incident
    source: IncidentSource = "operator"


class Noticed(Payload):
    """A change worth an operator's eye: a gate lost or covered, a track seen, an asset down."""

    kind: Literal["noticed"] = "noticed"
    level: Level
    subject: str
    text: str


class WorkerChanged(Payload):
    """The LLM worker started loading, became ready, was slowed by other work, died or restarted."""

    kind: Literal["worker"] = "worker"
    state: WorkerState
    detail: str = ""


class ServerChanged(Payload):
    """A model's server is being tried, answers, holds no answer to its form, or gives none."""

    kind: Literal["server"] = "server"
    server: str = Field(description="openai:BASE_URL#NAME")
    serves: tuple[ServerUse, ...] = Field(description="what it is asked to be")
    state: ServerState
    detail: str = ""


class SessionEnded(Payload):
    """The last line of a session that ended in order."""

    kind: Literal["session_ended"] = "session_ended"
    reason: str


class LogTroubled(Payload):
    """The log cannot be written, and so nothing is dispatched; with no `problem` it can again."""

    transient: ClassVar[bool] = True

    kind: Literal["log_troubled"] = "log_troubled"
    problem: str


class LogSigned(Payload):
    """The log's own record, emitted by no session: a key vouches for all lines up to this one.

    `signature` is Ed25519 by `key` over the record without `hash` and `signature`, so also over the
    hash of the record before. `found` records before it were unsigned when the log was opened
    again; `closing` is True for the last one.
    """

    transient: ClassVar[bool] = True

    kind: Literal["log_signed"] = "log_signed"
    key: Hex32
    closing: bool = False
    found: Annotated[int, Field(ge=0)] = 0
    signature: Hex64 = "0" * 128


StillFormat = Literal["png", "jpg"]


class CameraStill(Payload):
    """The picture of a track that an operator is shown, or the `problem` why there is none.

    No part that plans, checks or judges reads it. The file is kept beside the log.
    """

    kind: Literal["camera_still"] = "camera_still"
    track: Name
    camera: Name
    taken_s: NonNegative = Field(description="the fleet's clock")
    sha256: Hex32 | None = Field(default=None, description="of the file that is kept")
    format: StillFormat = "png"
    problem: str = ""

    @property
    def file_name(self) -> str:
        """The name of the file, '' without a picture."""
        return f"{self.sha256}.{self.format}" if self.sha256 is not None else ""


MOST_CONTACTS = 64
"""The number of contacts kept at a time."""

MOST_UID, MOST_CALLSIGN = 128, 48
"""A longer uid is none; a longer call sign is cut. Characters."""

TakState = Literal["connected", "away"]
LossReason = Literal["stale", "removed", "left"]
"""Its report holds no longer, its sender took it off the map, or it is beyond the site."""

ClaimedAffiliation = Literal[
    "friend", "assumed friend", "neutral", "unknown", "pending", "suspect", "hostile", "other"
]
ClaimedKind = Literal[
    "aircraft", "ground unit", "vehicle", "installation", "ground object", "vessel", "submarine",
    "spacecraft", "special forces", "object",
]  # fmt: skip

Count = Annotated[int, Field(ge=0)]


class ReportedContact(StrictModel):
    """The report of a TAK client on a thing; `at` is in metres, as all positions are."""

    uid: str = Field(min_length=1, max_length=MOST_UID)
    callsign: str = Field(default="", max_length=MOST_CALLSIGN)
    affiliation: ClaimedAffiliation
    what: ClaimedKind
    at: Point
    error_m: NonNegative | None = Field(default=None, description="radius, None where not told")
    time: datetime = Field(description="when it was there, as claimed; never after it was heard")
    stale: datetime = Field(description="until when that holds, as claimed, up to a limit")

    @property
    def name(self) -> str:
        """The name of the thing: its call sign, else its uid."""
        return self.callsign or self.uid


class TakChanged(Payload):
    """The connection to the TAK server is there, or is not and is tried again."""

    kind: Literal["tak"] = "tak"
    server: str = Field(description="tls://HOST:PORT or tcp://HOST:PORT")
    state: TakState
    detail: str = ""


class ContactReported(Payload):
    """A contact is new, or something else is claimed of it, or it is somewhere else."""

    kind: Literal["contact_reported"] = "contact_reported"
    contact: ReportedContact


class ContactLost(Payload):
    """A contact is reported no more."""

    kind: Literal["contact_lost"] = "contact_lost"
    uid: str
    reason: LossReason


class ContactsLeftOut(Payload):
    """The number of messages from the server that are not shown so far.

    `outside` are contacts beyond the site, `too_many` those beyond the limits of number and time,
    and `unreadable` malformed events.
    """

    kind: Literal["contacts_left_out"] = "contacts_left_out"
    outside: Count = 0
    too_many: Count = 0
    unreadable: Count = 0


UNVERIFIED = (TakChanged, ContactReported, ContactLost, ContactsLeftOut)
"""The events of a TAK server; no part that answers, plans or decides reads them."""

OutsideReport = TakChanged | ContactReported | ContactLost | ContactsLeftOut | Noticed
"""All that may come into a session from a TAK server; none of it is a picture or an order."""
