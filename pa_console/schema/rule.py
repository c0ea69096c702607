"""Operational policy as data: rules, their checks and their examples (paper, Appendix B)."""

from typing import Any, Literal, Self

from pydantic import Field, model_validator

from pa_console.schema.base import StrictModel

Domain = Literal["ROE", "WF", "CAP"]
Priority = Literal["critical", "high", "medium"]
PRIORITIES: tuple[Priority, ...] = ("critical", "high", "medium")


class RuleExample(StrictModel):
    """A small plan and state that must pass or fail the rule's check.

    `plan` maps agents to commands; `given` overlays the default state, as described in the
    policy package's `examples` module.
    """

    name: str
    expect: Literal["pass", "fail", "not_applicable"]
    mission: str = ""
    reason: str = "example"
    plan: tuple[tuple[str, str], ...] = Field(default=(), description="(agent, command) pairs")
    given: dict[str, Any] = {}


class Rule(StrictModel):
    """One rule; without `check` it is judged by the LLM only."""

    id: str = Field(pattern=r"^[A-Z]+-\d{2,}$")
    domain: Domain
    priority: Priority
    text: str = Field(min_length=1)
    tags: tuple[str, ...] = ()
    applies: str | None = Field(default=None, description="CEL guard; absent means always")
    check: str | None = Field(
        default=None, description="CEL that must hold: true, or an empty list of the offenders"
    )
    message: str = Field(default="", description="what is wrong; the offenders are put after it")
    examples: tuple[RuleExample, ...] = ()

    @property
    def enforced(self) -> bool:
        """Whether a violation blocks the plan for everyone (critical or high, with a check)."""
        return self.check is not None and self.priority in ("critical", "high")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if not self.id.startswith(self.domain + "-"):
            raise ValueError(f"id {self.id!r} does not start with its domain {self.domain!r}")
        if self.check is None and (self.applies or self.message or self.examples):
            raise ValueError("applies, message and examples need a check")
        if self.check is not None and not self.message:
            raise ValueError("a rule with a check needs a message that says what is wrong")
        return self


class RuleSet(StrictModel):
    """A rule file: every rule in force."""

    name: str
    source: str = ""
    rules: tuple[Rule, ...] = Field(min_length=1)


class RuleHit(StrictModel):
    """One retrieved rule with every component of its score."""

    rule_id: str
    score: float
    components: dict[str, float] = {}
    pinned: bool = False
