"""Events of steps 2 to 6: from a mission's words to a decision on a plan."""

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
"""The number of other readings that an operator can take in at a glance."""


class RulesRetrieved(Payload):
    """Step 2: pinned and top-k rules with their scores, best first."""

    kind: Literal["rules_retrieved"] = "rules_retrieved"
    method: str
    hits: tuple[RuleHit, ...]
    seconds: float


class PictureDigested(Payload):
    """Step 3: the picture as the models are given it."""

    kind: Literal["picture_digested"] = "picture_digested"
    digest: Digest
    seconds: float


class PromptBuilt(Payload):
    """Step 4: the whole prompt of one role."""

    kind: Literal["prompt_built"] = "prompt_built"
    role: Role
    attempt: int
    system: str
    user: str
    seconds: float
    server: str = Field(
        default="",
        exclude_if=lambda server: not server,
        description="the model on a server that it is for; empty for the session's own model",
    )


class TextStreamed(Payload):
    """A piece of the model's answer, as it arrives."""

    transient: ClassVar[bool] = True
    kind: Literal["text_streamed"] = "text_streamed"
    role: Role
    attempt: int
    text: str


class PlanProposed(Payload):
    """Step 5: the model's whole answer; `plan` is None when it could not be read."""

    kind: Literal["plan_proposed"] = "plan_proposed"
    attempt: int
    author: Literal["planner", "operator", "agent", "console"] = Field(
        default="planner", description="the console joins the plans of an order's steps"
    )
    text: str
    plan: Plan | None
    error: str = ""
    usage: Usage = Usage()
    confidence: Share | None = Field(
        default=None, description="the chance that the planner gave to what it says was asked"
    )
    instead_of: int | None = Field(
        default=None, description="the attempt whose prompt it is another answer to"
    )
    given: bool = Field(
        default=False, description="the console gave the commands, its author who has them"
    )
    as_judged: bool = Field(
        default=False, description="it is for what the judge read in the mission"
    )
    as_read_again: bool = Field(
        default=False, description="it is for what the second reader read in the mission"
    )
    as_chosen: bool = Field(
        default=False, description="it is for the reading of the mission that the operator chose"
    )


class PlanRehearsed(Payload):
    """Step 6: the plan was run in a forked simulation."""

    kind: Literal["plan_rehearsed"] = "plan_rehearsed"
    attempt: int
    rehearsal: Rehearsal
    seconds: float


class PlanChecked(Payload):
    """Step 6: one finding for every rule in force."""

    kind: Literal["plan_checked"] = "plan_checked"
    attempt: int
    findings: tuple[Finding, ...]
    seconds: float
    unmet: tuple[str, ...] = Field(
        default=(), description="what of the order no plan can do now, and why"
    )
    gaps: tuple[str, ...] = Field(
        default=(),
        description="what the order names and the plan's reading of it does not, or the other way",
    )


class PlanJudged(Payload):
    """Step 6: the JudgeLLM's verdict; None with an error means hold."""

    kind: Literal["plan_judged"] = "plan_judged"
    attempt: int
    verdict: Verdict | None
    error: str = ""
    usage: Usage = Usage()
    confidence: Share | None = Field(
        default=None, description="the chance that the judge gave to what it says was asked"
    )


class OrderReadAgain(Payload):
    """Step 6: what another model read in an order of which planner or judge was unsure."""

    kind: Literal["order_read_again"] = "order_read_again"
    attempt: int
    model: str
    asked: str
    error: str = ""
    usage: Usage = Usage()
    confidence: Share | None = Field(
        default=None, description="the chance that it gave to what it says was asked"
    )


class RepairRequested(Payload):
    """Step 6: the findings go back to the planner for another attempt."""

    kind: Literal["repair_requested"] = "repair_requested"
    attempt: int
    reasons: tuple[str, ...]


class ApprovalRequested(Payload):
    """Step 6: the operator's turn; the lists say what stands in the way and what is needed."""

    kind: Literal["approval_requested"] = "approval_requested"
    request_id: str = Field(default="", description="a decision may name it, see Decision")
    attempt: int
    plan: Plan
    blocked_by: tuple[str, ...] = Field(default=(), description="reasons nobody may override")
    acknowledge: tuple[str, ...] = Field(default=(), description="rule ids of warnings")
    needs_override: bool = Field(default=False, description="the judge said Failure")
    if_halted: tuple[Action, ...] = Field(
        default=(),
        description="the way to safety: what each agent is told if the plan is halted or cancelled "
        "before it has ended; one that is to move may be told to hold instead",
    )
    asked: str = Field(
        default="",
        description="what the plan is for, in canonical words; empty where nothing else is offered",
    )
    approvals: dict[str, int] = Field(
        default={},
        exclude_if=lambda approvals: not approvals,
        description="what of it more than one person must approve, and how many",
    )
    readings: tuple[str, ...] = Field(
        default=(),
        max_length=MOST_READINGS,
        description="what else the order may mean, likeliest first; the operator may choose one",
    )
    gaps: tuple[str, ...] = Field(
        default=(), description="where the words of the order and its reading do not match"
    )
    confidence: Share | None = Field(
        default=None,
        description="how often an order that was read so is right; None where one of the models "
        "has not read it for itself",
    )
    read_apart: bool = Field(
        default=False,
        description="another reader reads the order otherwise, and that may be what is meant",
    )
    state: ApprovalState | None = Field(
        default=None,
        description="what the operator has to know first; None in the log of an older console",
    )
    standing: StandingOrder | None = Field(
        default=None,
        exclude_if=lambda standing: standing is None,
        description="the standing order that is to be approved, with no plan, or None for a plan",
    )
    proposed_by: str = Field(
        default="",
        exclude_if=lambda name: not name,
        description="name of the agent whose mission it is; no standing instruction approves it",
    )

    def decided(self, kind: DecisionKind, **given: Any) -> Decision:
        """Return a decision on this request, with the other fields of the decision as `given`."""
        return Decision(kind=kind, request_id=self.request_id, **given)

    def approved(self, reason: str = "", by: str = "operator") -> Decision:
        """Return an approval that accepts and overrides everything that this request asks for."""
        return self.decided(
            "approve",
            by=by,
            reason=reason,
            override_judge=self.needs_override,
            acknowledged=self.acknowledge,
        )


class DecisionMade(Payload):
    """The operator's decision; `accepted` is False when it was not admissible, with the reason."""

    binding: ClassVar[bool] = True

    kind: Literal["decision_made"] = "decision_made"
    attempt: int
    decision: Decision
    accepted: bool
    detail: str = ""


class PlanVoided(Payload):
    """The world moved under an approved plan; it goes through the safeguards again."""

    kind: Literal["plan_voided"] = "plan_voided"
    attempt: int
    reason: str
