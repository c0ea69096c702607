"""The plan that the LLM writes: a reason and device commands (paper, Section IV-E)."""

import json
from typing import Annotated, cast

from pydantic import BeforeValidator, Field, field_validator

from pa_console.schema.base import StrictModel
from pa_console.schema.command import COMMANDS, Verb

MAX_ACTIONS = 64
MAX_REASON = 600


def _without_frame_prefix(value: object) -> object:
    """Read the paper's `FRAME_Drone_T01` as `Drone_T01`."""
    return value.replace("FRAME_", "") if isinstance(value, str) else value


Token = Annotated[str, BeforeValidator(_without_frame_prefix)]


class Action(StrictModel):
    """One device command, e.g. agent `Drone_T01`, command `move_to EastGate`."""

    agent: Token = Field(min_length=1, max_length=64)
    command: Token = Field(min_length=1, max_length=160)

    @field_validator("command")
    @classmethod
    def _in_vocabulary(cls, value: str) -> str:
        words = value.split()
        spec = COMMANDS.get(cast(Verb, words[0])) if words else None
        if spec is None:
            raise ValueError(f"unknown command {value!r}; known: {', '.join(COMMANDS)}")
        if len(words) != 1 + spec.takes_frame:
            needs = "exactly one frame" if spec.takes_frame else "no frame"
            raise ValueError(f"command {value!r}: '{words[0]}' takes {needs}")
        return " ".join(words)

    @property
    def verb(self) -> Verb:
        """The command's first word."""
        return cast(Verb, self.command.split()[0])

    @property
    def target(self) -> str | None:
        """The frame that the command names, None for a command without one."""
        words = self.command.split()
        return words[1] if len(words) > 1 else None


class Plan(StrictModel):
    """A reason and the actions it leads to; actions start together, in list order."""

    reason: str = Field(max_length=MAX_REASON)
    actions: tuple[Action, ...] = Field(max_length=MAX_ACTIONS)

    @property
    def agents(self) -> tuple[str, ...]:
        """The agents addressed, in order, repeated if the plan repeats them."""
        return tuple(action.agent for action in self.actions)

    @property
    def answer(self) -> str:
        """The plan as a planner writes it: JSON on one line."""
        return json.dumps(self.model_dump(mode="json"), ensure_ascii=False)
