"""Events of the session: start and end, telemetry, command, models, log, stills, TAK server."""

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
"""The states of a worker. An `unconfined` worker is ready, but this system cannot confine its
process."""

MOST_CONTACTS = 64
"""The largest number of contacts that are kept at a time."""

MOST_UID, MOST_CALLSIGN = 128, 48
"""The limits on characters: a longer uid is invalid, and a longer call sign is cut off."""


class SessionStarted(Payload):
    """The start of a session, with everything that is needed to run it again.

    If `rules_seal` is altered, the session was started with --unsigned. Sessions from before seals
    were introduced have no `rules_seal`.
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
        description="models on servers by use, which are asked before the local model",
    )


class SessionResumed(Payload):
    """The session continues in its own log, because its console had ended without closing it.

    No command is sent. The missions `interrupted` were in progress and end as held. Missions that
    had not begun wait again, open alarms stay open, and a stop stays in effect.
    """

    kind: Literal["session_resumed"] = "session_resumed"
    version: str
    interrupted: tuple[str, ...] = ()


class CommandTaken(Payload):
    """Command of the site was taken from another station, whose session is refused from now on.

    `records` is the number of the last record that was received from that session's log, and `head`
    is its hash. `by` is the commander who signed the `epoch`.
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
    """A change of this station's right to command, by a takeover or because its key was revoked.

    `refusal` is the reason why the station may not command; '' if it may.
    """

    binding: ClassVar[bool] = True

    kind: Literal["authority_changed"] = "authority_changed"
    refusal: str


class RulesReplaced(Payload):
    """Another rule set is in force; missions in progress keep the set with which they began.

    `changes` lists the differences from the previous set, by rule. `rule_set` is the whole new set,
    so that the session can be run again even if the file is lost.
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
    """An incident in the simulation, from a set-up, a scenario or a what-if."""

    kind: Literal["incident"] = "incident"
    incident: Incident
    source: IncidentSource = "operator"


class Noticed(Payload):
    """A notable change, such as a gate lost or covered, a track detected, or an asset down."""

    kind: Literal["noticed"] = "noticed"
    level: Level
    subject: str
    text: str


class WorkerChanged(Payload):
    """A new state of the LLM worker: loading, ready, slowed by other work, dead or restarted."""

    kind: Literal["worker"] = "worker"
    state: WorkerState
    detail: str = ""


class ServerChanged(Payload):
    """A new state of a model's server: probing, ready, unconstrained or away."""

    kind: Literal["server"] = "server"
    server: str = Field(description="openai:BASE_URL#NAME")
    serves: tuple[ServerUse, ...] = Field(description="the uses of its model")
    state: ServerState
    detail: str = ""


class SessionEnded(Payload):
    """The last line of a session that ended normally."""

    kind: Literal["session_ended"] = "session_ended"
    reason: str


class LogTroubled(Payload):
    """The log cannot be written, so nothing is dispatched.

    If `problem` is '', the log can be written again.
    """

    transient: ClassVar[bool] = True

    kind: Literal["log_troubled"] = "log_troubled"
    problem: str


class LogSigned(Payload):
    """A signature for all lines up to it, which the log adds and no session emits.

    `signature` is the Ed25519 signature by `key` of the record without `hash` and `signature`, so
    it also covers the hash of the previous record. `found` is the number of unsigned records before
    it that were in the log when it was opened again. `closing` is True for a closed log's last
    record.
    """

    transient: ClassVar[bool] = True

    kind: Literal["log_signed"] = "log_signed"
    key: Hex32
    closing: bool = False
    found: Annotated[int, Field(ge=0)] = 0
    signature: Hex64 = "0" * 128


StillFormat = Literal["png", "jpg"]


class CameraStill(Payload):
    """The still of a track that an operator was shown, or the `problem` if there is no still.

    Planning, checks and the judge do not read it. The file is kept beside the log.
    """

    kind: Literal["camera_still"] = "camera_still"
    track: Name
    camera: Name
    taken_s: NonNegative = Field(description="time at which it was taken, on the fleet's clock")
    sha256: Hex32 | None = Field(default=None, description="SHA-256 of the file that is kept")
    format: StillFormat = "png"
    problem: str = ""

    @property
    def file_name(self) -> str:
        """The name of the file, or '' without a still."""
        return f"{self.sha256}.{self.format}" if self.sha256 is not None else ""


TakState = Literal["connected", "away"]
LossReason = Literal["stale", "removed", "left"]
"""The reasons why a contact is lost: its report has expired, its sender has removed it from the
map, or it has left the site."""

ClaimedAffiliation = Literal[
    "friend", "assumed friend", "neutral", "unknown", "pending", "suspect", "hostile", "other"
]
ClaimedKind = Literal[
    "aircraft", "ground unit", "vehicle", "installation", "ground object", "vessel", "submarine",
    "spacecraft", "special forces", "object",
]  # fmt: skip

Count = Annotated[int, Field(ge=0)]


class ReportedContact(StrictModel):
    """A TAK client's report of an object; `at` is in metres, as all positions are."""

    uid: str = Field(min_length=1, max_length=MOST_UID)
    callsign: str = Field(default="", max_length=MOST_CALLSIGN)
    affiliation: ClaimedAffiliation
    what: ClaimedKind
    at: Point
    error_m: NonNegative | None = Field(
        default=None, description="radius of the error; None if it was not reported"
    )
    time: datetime = Field(
        description="claimed time of the position, at the latest that of its reception"
    )
    stale: datetime = Field(description="claimed time of expiry, up to a limit")

    @property
    def name(self) -> str:
        """The name of the object: its call sign, or else its uid."""
        return self.callsign or self.uid


class TakChanged(Payload):
    """The connection to the TAK server was made, or was lost and is being retried."""

    kind: Literal["tak"] = "tak"
    server: str = Field(description="tls://HOST:PORT or tcp://HOST:PORT")
    state: TakState
    detail: str = ""


class ContactReported(Payload):
    """A new contact, or a contact whose report or position has changed."""

    kind: Literal["contact_reported"] = "contact_reported"
    contact: ReportedContact


class ContactLost(Payload):
    """A contact is no longer reported."""

    kind: Literal["contact_lost"] = "contact_lost"
    uid: str
    reason: LossReason


class ContactsLeftOut(Payload):
    """The numbers, so far, of the TAK server's messages that are not shown.

    `outside` counts contacts beyond the site, `too_many` contacts beyond the limits on number and
    rate, and `unreadable` malformed events.
    """

    kind: Literal["contacts_left_out"] = "contacts_left_out"
    outside: Count = 0
    too_many: Count = 0
    unreadable: Count = 0


UNVERIFIED = (TakChanged, ContactReported, ContactLost, ContactsLeftOut)
"""The events of a TAK server, which are never used for answers, plans or decisions."""

OutsideReport = TakChanged | ContactReported | ContactLost | ContactsLeftOut | Noticed
"""All events that a TAK server can cause in a session. None of them has a picture or an order."""
