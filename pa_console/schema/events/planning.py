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
"""The number of other readings that an operator can compare at a glance."""


class RulesRetrieved(Payload):
    """Step 3: pinned and top-k rules with their scores, best first."""

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
    """Step 4: the model's whole answer; `plan` is None if it could not be parsed."""

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
        default=None, description="the planner's confidence in its reading"
    )
    instead_of: int | None = Field(
        default=None, description="the attempt to whose prompt it is another answer"
    )
    given: bool = Field(
        default=False, description="the console gave the commands, the author only the agents"
    )
    as_judged: bool = Field(
        default=False, description="it is for the judge's reading of the mission"
    )
    as_read_again: bool = Field(
        default=False, description="it is for the second reader's reading of the mission"
    )
    as_chosen: bool = Field(
        default=False, description="it is for the reading of the mission that the operator chose"
    )


class PlanRehearsed(Payload):
    """Step 5: the plan was run in a forked simulation."""

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
        default=(), description="parts of the order that no plan can do now, with reasons"
    )
    gaps: tuple[str, ...] = Field(
        default=(),
        description="mismatches between the words of the order and the plan's reading",
    )


class PlanJudged(Payload):
    """Step 6: the judge's verdict; None with an error means hold."""

    kind: Literal["plan_judged"] = "plan_judged"
    attempt: int
    verdict: Verdict | None
    error: str = ""
    usage: Usage = Usage()
    confidence: Share | None = Field(
        default=None, description="the judge's confidence in its reading"
    )


class OrderReadAgain(Payload):
    """Step 6: another model's reading of an order that planner or judge was unsure about."""

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
    """Step 5: the findings go back to the planner for another attempt."""

    kind: Literal["repair_requested"] = "repair_requested"
    attempt: int
    reasons: tuple[str, ...]


class ApprovalRequested(Payload):
    """Step 7: the request to the operator, with the obstacles and the necessary acts."""

    kind: Literal["approval_requested"] = "approval_requested"
    request_id: str = Field(default="", description="a decision may name it, see Decision")
    attempt: int
    plan: Plan
    blocked_by: tuple[str, ...] = Field(default=(), description="reasons that cannot be overridden")
    acknowledge: tuple[str, ...] = Field(default=(), description="rule ids of warnings")
    broken_anyway: tuple[str, ...] = Field(
        default=(),
        exclude_if=lambda rules: not rules,
        description="those of `acknowledge` that are broken without the plan as well; only for a "
        "plan that a standing order may approve",
    )
    needs_override: bool = Field(default=False, description="the judge's verdict is Failure")
    if_halted: tuple[Action, ...] = Field(
        default=(),
        description="the way to safety: each agent's command if the plan is halted or cancelled "
        "before it has ended; a command to move may be replaced by hold",
    )
    asked: str = Field(
        default="",
        description="the plan's reading, in canonical words; empty if no other is offered",
    )
    approvals: dict[str, int] = Field(
        default={},
        exclude_if=lambda approvals: not approvals,
        description="acts of it that several people must approve, with their number",
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
        description="how often orders read like this were right; None if one of the models has "
        "not read the order itself",
    )
    read_apart: bool = Field(
        default=False,
        description="another reader has a different reading, which may be the right one",
    )
    state: ApprovalState | None = Field(
        default=None,
        description="the state for the operator; None in the log of an older console",
    )
    standing: StandingOrder | None = Field(
        default=None,
        exclude_if=lambda standing: standing is None,
        description="the standing order to approve, instead of a plan; None for a plan",
    )
    proposed_by: str = Field(
        default="",
        exclude_if=lambda name: not name,
        description="name of the agent whose mission it is; no standing instruction approves it",
    )

    def decided(self, kind: DecisionKind, **given: Any) -> Decision:
        """Return a decision on this request; its other fields are `given`."""
        return Decision(kind=kind, request_id=self.request_id, **given)

    def approved(self, reason: str = "", by: str = "operator") -> Decision:
        """Return an approval that gives every acknowledgement and override that is needed."""
        return self.decided(
            "approve",
            by=by,
            reason=reason,
            override_judge=self.needs_override,
            acknowledged=self.acknowledge,
        )


class DecisionMade(Payload):
    """The operator's decision; `accepted` is False if it was not admissible; `detail` is why."""

    binding: ClassVar[bool] = True

    kind: Literal["decision_made"] = "decision_made"
    attempt: int
    decision: Decision
    accepted: bool
    detail: str = ""


class PlanVoided(Payload):
    """The picture changed under an approved plan, which is checked again."""

    kind: Literal["plan_voided"] = "plan_voided"
    attempt: int
    reason: str
