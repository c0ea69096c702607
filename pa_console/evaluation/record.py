"""One evaluated run as a line of `runs.jsonl`: what was asked, what came of it, what it cost."""

from typing import Literal

from pydantic import Field

from pa_console.schema.base import NonNegative, Share, StrictModel
from pa_console.schema.finding import Usage
from pa_console.schema.mission import Metrics, MissionStatus, Outcome
from pa_console.schema.mission_set import Expectation

Opinion = Literal["Success", "Failure"]


class Breach(StrictModel):
    """An enforced rule that the true state shows to be broken."""

    rule_id: str
    what: str
    at_s: NonNegative = Field(description="simulated seconds after the command")


class RunRecord(StrictModel):
    """One run of one mission by one model under one variant with one simulation seed.

    `strict` is the paper's strict success on the true state (Section V-B): every condition of the
    mission holds and no enforced rule was broken. `hybrid` is the JudgeLLM's outcome verdict; a
    run that executed nothing has none and counts as a success only where `expect` allows that.
    Without a JudgeLLM in the variant there is no hybrid success either way.
    `obeyed` is what `strict` would be if a judge's Failure before execution had been obeyed.
    """

    run: str = Field(description="model/variant/set/mission/seed")
    model: str
    variant: str
    mission_set: str
    mission: str
    seed: int
    world: str
    category: str
    tags: tuple[str, ...] = ()
    expect: Expectation
    command: str
    session: str = ""
    log: str = Field(default="", description="the run's event log, relative to runs.jsonl")
    status: MissionStatus
    reason: str = ""
    refused: bool = Field(description="nothing but hold and report was ordered")
    strict: bool
    obeyed: bool
    hybrid: bool | None
    failed: tuple[str, ...] = Field(default=(), description="success conditions that do not hold")
    broken: tuple[Breach, ...] = ()
    judge_plan: Opinion | None = Field(default=None, description="verdict on the executed plan")
    judge_outcome: Opinion | None = None
    confidence: Share | None = Field(
        default=None, description="of planner and judge in what was asked, the lower of the two"
    )
    offered: int = Field(
        default=0, ge=0, description="other readings of the command that the operator was offered"
    )
    verification: Outcome | None = Field(default=None, description="telemetry's own answer")
    valid_json: bool = Field(description="the first answer could be read as a plan")
    first_sound: bool = Field(description="the first plan broke no Critical or High rule")
    attempts: int
    plan: tuple[str, ...] = Field(default=(), description="'agent command' of the last plan")
    metrics: Metrics
    planner: Usage = Field(default_factory=Usage, description="of the first answer")
    judge: Usage = Field(default_factory=Usage)
    reused: int = Field(default=0, ge=0, description="answers taken from earlier equal prompts")
    read_ahead: bool = Field(
        default=False, description="the picture was read before the command, as while typing"
    )
