"""Events of steps 3 to 7: from a mission's words to a decision on a plan."""

from typing import Any, ClassVar, Literal

from pydantic import Field

from pa_console.schema.base import Payload, Role, Share
from pa_console.schema.finding import Finding, Usage, Verdict
from pa_console.schema.mission import ApprovalState, Decision, DecisionKind, StandingOrder
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.rule import RuleHit
from pa_console.schema.telemetry import Digest

MOST_READINGS = 3
"""The largest number of other readings that are offered, for comparison at a glance."""


class RulesRetrieved(Payload):
    """Step 3: the pinned and the best-matching rules with their scores, best first."""

    kind: Literal["rules_retrieved"] = "rules_retrieved"
    method: str
    hits: tuple[RuleHit, ...]
    seconds: float


class PictureDigested(Payload):
    """Step 3: the picture as the models see it."""

    kind: Literal["picture_digested"] = "picture_digested"
    digest: Digest
    seconds: float


class PromptBuilt(Payload):
    """Steps 4 and 6: the whole prompt of one role."""

    kind: Literal["prompt_built"] = "prompt_built"
    role: Role
    attempt: int
    system: str
    user: str
    seconds: float
    server: str = Field(
        default="",
        exclude_if=lambda server: not server,
        description="the model on a server that is asked; empty for the local model",
    )


class TextStreamed(Payload):
    """A piece of the model's answer, as it arrives."""

    transient: ClassVar[bool] = True
    kind: Literal["text_streamed"] = "text_streamed"
    role: Role
    attempt: int
    text: str


class PlanProposed(Payload):
    """Step 4: the author's whole answer; `plan` is None if the answer could not be parsed."""

    kind: Literal["plan_proposed"] = "plan_proposed"
    attempt: int
    author: Literal["planner", "operator", "agent", "console"] = Field(
        default="planner", description="the console if it joined the plans of an order's steps"
    )
    text: str
    plan: Plan | None
    error: str = ""
    usage: Usage = Usage()
    confidence: Share | None = Field(
        default=None, description="the planner's confidence in its reading"
    )
    instead_of: int | None = Field(
        default=None, description="the attempt whose prompt this answer shares"
    )
    given: bool = Field(
        default=False,
        description="the console gave the commands, and the author only chose the agents",
    )
    as_judged: bool = Field(
        default=False, description="the plan is for the judge's reading of the mission"
    )
    as_read_again: bool = Field(
        default=False, description="the plan is for the second reader's reading of the mission"
    )
    as_chosen: bool = Field(
        default=False,
        description="the plan is for the reading of the mission that the operator chose",
    )


class PlanRehearsed(Payload):
    """Step 5: the rehearsal of a plan in a forecast."""

    kind: Literal["plan_rehearsed"] = "plan_rehearsed"
    attempt: int
    rehearsal: Rehearsal
    seconds: float


class PlanChecked(Payload):
    """Step 5: the findings, one for every rule in force."""

    kind: Literal["plan_checked"] = "plan_checked"
    attempt: int
    findings: tuple[Finding, ...]
    seconds: float
    unmet: tuple[str, ...] = Field(
        default=(), description="parts of the order that the plan leaves out, with the reasons"
    )
    gaps: tuple[str, ...] = Field(
        default=(),
        description="mismatches between the words of the order and the plan's reading",
    )


class PlanJudged(Payload):
    """Step 6: the judge's verdict; with None and an error, the plan is on hold."""

    kind: Literal["plan_judged"] = "plan_judged"
    attempt: int
    verdict: Verdict | None
    error: str = ""
    usage: Usage = Usage()
    confidence: Share | None = Field(
        default=None, description="the judge's confidence in its reading"
    )


class OrderReadAgain(Payload):
    """Step 6: the second reader's reading of an order of which planner or judge was unsure."""

    kind: Literal["order_read_again"] = "order_read_again"
    attempt: int
    model: str
    asked: str
    error: str = ""
    usage: Usage = Usage()
    confidence: Share | None = Field(
        default=None, description="the model's confidence in its reading"
    )


class RepairRequested(Payload):
    """Step 5: the faults of a plan go back to the planner for another attempt."""

    kind: Literal["repair_requested"] = "repair_requested"
    attempt: int
    reasons: tuple[str, ...]


class ApprovalRequested(Payload):
    """Step 7: the request to the operator for a decision on a plan or a standing order."""

    kind: Literal["approval_requested"] = "approval_requested"
    request_id: str = Field(default="", description="the id to which a decision may refer")
    attempt: int
    plan: Plan
    blocked_by: tuple[str, ...] = Field(default=(), description="reasons that cannot be overridden")
    acknowledge: tuple[str, ...] = Field(
        default=(), description="ids of the broken rules to acknowledge"
    )
    broken_anyway: tuple[str, ...] = Field(
        default=(),
        exclude_if=lambda rules: not rules,
        description="those of `acknowledge` that would be broken without the plan as well; only "
        "for a plan that a standing order may approve",
    )
    needs_override: bool = Field(
        default=False, description="true if the judge's verdict is Failure"
    )
    if_halted: tuple[Action, ...] = Field(
        default=(),
        description="the way to safety: each agent's command if the plan is halted or cancelled "
        "before it has ended; a command to move may be replaced by hold",
    )
    asked: str = Field(
        default="",
        description="the plan's reading, in canonical words; empty if no other reading is offered",
    )
    approvals: dict[str, int] = Field(
        default={},
        exclude_if=lambda approvals: not approvals,
        description="acts that several people must approve, each with the number of people",
    )
    readings: tuple[str, ...] = Field(
        default=(),
        max_length=MOST_READINGS,
        description="other readings of the order, likeliest first; the operator may choose one",
    )
    gaps: tuple[str, ...] = Field(
        default=(), description="mismatches between the order's words and its reading"
    )
    confidence: Share | None = Field(
        default=None,
        description="how often orders read like this were right; None if one of the models did "
        "not read the order by itself",
    )
    read_apart: bool = Field(
        default=False,
        description="another reader has a different reading, which may be right",
    )
    state: ApprovalState | None = Field(
        default=None,
        description="the state of the plan for the operator; None in the log of an older console",
    )
    standing: StandingOrder | None = Field(
        default=None,
        exclude_if=lambda standing: standing is None,
        description="the standing order to approve, instead of a plan; None for a plan",
    )
    proposed_by: str = Field(
        default="",
        exclude_if=lambda name: not name,
        description="name of the agent that proposed the mission, which no standing instruction "
        "may approve",
    )

    def decided(self, kind: DecisionKind, **given: Any) -> Decision:
        """Return a decision on this request; its other fields are `given`."""
        return Decision(kind=kind, request_id=self.request_id, **given)

    def approved(self, reason: str = "", by: str = "operator") -> Decision:
        """Return an approval with every acknowledgement and override that the request requires."""
        return self.decided(
            "approve",
            by=by,
            reason=reason,
            override_judge=self.needs_override,
            acknowledged=self.acknowledge,
        )


class DecisionMade(Payload):
    """The decision on a request; if it is not `accepted`, `detail` is the reason."""

    binding: ClassVar[bool] = True

    kind: Literal["decision_made"] = "decision_made"
    attempt: int
    decision: Decision
    accepted: bool
    detail: str = ""


class PlanVoided(Payload):
    """A change of the picture made a plan void, for the `reason` given."""

    kind: Literal["plan_voided"] = "plan_voided"
    attempt: int
    reason: str
