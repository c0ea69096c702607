"""The findings of software and of the judge on a plan (paper, Section IV-F)."""

from typing import Literal

from pydantic import Field

from pa_console.schema.base import StrictModel
from pa_console.schema.rule import Priority

FindingStatus = Literal["complies", "violates", "not_applicable", "judged_only", "error"]
MAX_FEEDBACK = 600
JudgeOpinion = Literal["complies", "violates", "unclear"]


class Finding(StrictModel):
    """The result of one rule's check; a rule with the status `error` counts as broken."""

    rule_id: str
    priority: Priority
    status: FindingStatus
    message: str = ""

    @property
    def broken(self) -> bool:
        """True if the rule is violated or its check failed with an error."""
        return self.status in ("violates", "error")

    @property
    def blocking(self) -> bool:
        """True if the plan cannot be approved because of this finding."""
        return self.broken and self.priority in ("critical", "high")


class RuleOpinion(StrictModel):
    """The judge's opinion on one rule."""

    rule_id: str
    opinion: JudgeOpinion


class Verdict(StrictModel):
    """The judge's answer: overall Success or Failure, an opinion on each rule, and feedback."""

    verdict: Literal["Success", "Failure"]
    rules: tuple[RuleOpinion, ...] = ()
    feedback: str = Field(default="", max_length=MAX_FEEDBACK)


class Usage(StrictModel):
    """The cost of one generation: tokens by kind, seconds to the first token and in total."""

    prompt_tokens: int = 0
    cached_tokens: int = Field(default=0, description="prompt tokens found in the KV cache")
    completion_tokens: int = 0
    sampled_tokens: int = Field(
        default=0, description="completion tokens that the grammar did not force"
    )
    guessed_tokens: int = Field(
        default=0,
        description="sampled tokens that were guessed correctly and took no step",
    )
    first_token_s: float = 0.0
    seconds: float = 0.0
    ahead_s: float = Field(
        default=0.0,
        exclude_if=lambda seconds: not seconds,
        description="the part of `seconds` that live reading took before the order was sent",
    )

    def going_on(self, whole: "Usage") -> "Usage":
        """Return the cost of an answer that was begun at this cost and continued at `whole`."""
        return Usage(
            prompt_tokens=self.prompt_tokens,
            cached_tokens=self.cached_tokens,
            completion_tokens=whole.completion_tokens,
            sampled_tokens=self.sampled_tokens + whole.sampled_tokens,
            guessed_tokens=self.guessed_tokens + whole.guessed_tokens,
            first_token_s=self.first_token_s,
            seconds=self.seconds + whole.seconds,
            ahead_s=self.ahead_s + whole.ahead_s,
        )
