"""Which parts of the pipeline take part: the whole of it, or an ablation for an evaluation."""

from typing import Literal

from pydantic import Field

from pa_console.schema.base import StrictModel
from pa_console.schema.event_planning import MOST_READINGS

PromptStyle = Literal["console", "paper"]


class Variant(StrictModel):
    """The parts of the pipeline that are in use; the defaults are the console's own pipeline."""

    name: str = "full"
    retrieval: bool = Field(default=True, description="the best rules for the words are retrieved")
    method: str = Field(default="", description="retrieval method; empty: the default one")
    pinned: bool = Field(default=True, description="every Critical rule is in the prompt")
    checks: bool = Field(default=True, description="rules and premises are enforced")
    rehearsal: bool = Field(default=True, description="the plan is run in a forecast first")
    judging: bool = Field(default=True, description="the JudgeLLM is asked before and after")
    repairs: int = Field(default=2, ge=0, description="how often a broken plan may be mended")
    candidates: int = Field(
        default=4, ge=1, le=8, description="plans to choose from when the first one is broken"
    )
    fitting: bool = Field(
        default=True,
        description="others are looked at when the first is not what its planner says was asked",
    )
    second_reading: bool = Field(
        default=True,
        description="a plan that does nothing, or for a reading of which the planner was unsure, "
        "gives way to what a judge that objects has read",
    )
    readings: int = Field(
        default=5,
        ge=0,
        le=8,
        description="ways to read an order that are looked at when the models are unsure of it",
    )
    reading: int = Field(
        default=0,
        ge=0,
        le=MOST_READINGS,
        description="of the readings that are offered, the operator chooses this one (evaluations)",
    )
    grammar: bool = Field(default=True, description="decoding is constrained to executable plans")
    grounded: bool = Field(
        default=True, description="a trained planner states only what the picture says"
    )
    prompt: PromptStyle = "console"
    workflows: bool = Field(default=True, description="a mission may take several plans (WF-01)")
