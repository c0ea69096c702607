"""The bodies of the HTTP interface: requests of clients, and texts to be signed."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from pa_console.fleets.authorization import UnsignedApproval
from pa_console.http.tokens import TokenRole
from pa_console.schema.events import event as ev
from pa_console.schema.mission import MAX_MISSION_TEXT, DecisionKind
from pa_console.schema.plan import MAX_ACTIONS, MAX_STAY_S, Action, Plan
from pa_console.views.session_views import Sha256, shown_sha256


class RequestBody(BaseModel):
    """A body that a client sends; unknown fields are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class MissionBody(RequestBody):
    """A mission in plain language."""

    text: Annotated[str, Field(min_length=1, max_length=MAX_MISSION_TEXT)]


class QuestionBody(RequestBody):
    """A question about the record."""

    text: Annotated[
        str,
        Field(
            min_length=1,
            max_length=MAX_MISSION_TEXT,
            description="Why?  Why not ASSET?  What would you do instead?",
        ),
    ]


class ActionBody(RequestBody):
    """One command of an operator's own plan."""

    agent: Annotated[str, Field(max_length=64)]
    command: Annotated[str, Field(max_length=160)]
    after: Annotated[
        list[int],
        Field(max_length=MAX_ACTIONS, description="numbers of the actions before it, from 1"),
    ] = []
    stay_s: Annotated[float, Field(ge=0.0, le=MAX_STAY_S)] = 0.0


class DecisionBody(RequestBody):
    """A decision on the waiting plan, named by its `request_id` and its hash.

    `shown_sha256` is the hash of the plan as `/v1/plans` returned it, so an approval is for the
    plan that was shown.
    """

    kind: DecisionKind
    request_id: Annotated[str, Field(min_length=1, max_length=128)]
    shown_sha256: Sha256
    reason: Annotated[str, Field(max_length=600)] = ""
    override_judge: bool = False
    acknowledged: Annotated[
        tuple[str, ...], Field(max_length=256, description="ids of broken rules that are accepted")
    ] = ()
    actions: Annotated[
        tuple[ActionBody, ...] | None,
        Field(max_length=MAX_ACTIONS, description="the changed plan, for modify"),
    ] = None
    asked: Annotated[
        str,
        Field(
            max_length=MAX_MISSION_TEXT,
            description="for choose, an offered reading; for answer, the words of the answer",
        ),
    ] = ""


class SignatureBody(RequestBody):
    """A second person's signature on the waiting plan."""

    person: Annotated[str, Field(min_length=1, max_length=64, description="the person who signed")]
    signed: Annotated[
        str,
        Field(
            min_length=1,
            max_length=32_768,
            description="`to_sign`, a full stop, and its signature in base64url without padding",
        ),
    ]


class ToSignView(BaseModel):
    """The text that a second person signs to approve the waiting plan."""

    person: str
    station: Annotated[str, Field(description="the station whose plan waits")]
    request_id: str
    shown_sha256: Annotated[Sha256, Field(description="the SHA-256 of the plan, as in /v1/plans")]
    orders: Annotated[
        tuple[str, ...], Field(description="the approved commands: the plan and its way to safety")
    ]
    acts: Annotated[
        tuple[str, ...],
        Field(description="further approved acts: to override the judge, to accept a finding"),
    ]
    ends: Annotated[float, Field(description="the end of its validity, in seconds since 1970")]
    to_sign: Annotated[str, Field(description="the exact bytes (ASCII) to sign with Ed25519")]
    sha256: Annotated[Sha256, Field(description="the SHA-256 of `to_sign`")]


class DecisionView(BaseModel):
    """The result of a decision."""

    accepted: bool
    detail: str
    by: str


class WhoView(BaseModel):
    """The owner of a token."""

    person: str
    role: TokenRole


def to_sign_view(
    station: str, request: ev.ApprovalRequested, unsigned: UnsignedApproval
) -> ToSignView:
    """Return the text that a person signs for `request`; `station` is the station's name."""
    approval = unsigned.approval
    return ToSignView(
        person=approval.person,
        station=station,
        request_id=request.request_id,
        shown_sha256=shown_sha256(request),
        orders=approval.orders,
        acts=approval.acts,
        ends=unsigned.ends,
        to_sign=unsigned.text,
        sha256=unsigned.sha256,
    )


def plan_of(actions: tuple[ActionBody, ...], reason: str) -> Plan:
    """Return the operator's own plan; raises ValidationError for an invalid command."""
    parts = tuple(
        Action(agent=one.agent, command=one.command, after=tuple(one.after), stay_s=one.stay_s)
        for one in actions
    )
    return Plan(reason=reason or "changed by the operator", actions=parts)
