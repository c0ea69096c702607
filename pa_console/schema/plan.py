"""The plan that the LLM writes: a reason and device commands (paper, Section IV-E)."""

import json
from collections.abc import Iterable
from graphlib import CycleError, TopologicalSorter
from typing import Annotated, Self, cast

from pydantic import BeforeValidator, Field, field_validator, model_validator

from pa_console.schema.base import StrictModel
from pa_console.schema.command import COMMANDS, Verb

MAX_ACTIONS = 64
MAX_REASON = 600
MAX_STAY_S = 3600.0
"""The longest stay after an action, in seconds."""


def _without_frame_prefix(value: object) -> object:
    """Convert the paper's `FRAME_Drone_T01` to `Drone_T01`."""
    return value.replace("FRAME_", "") if isinstance(value, str) else value


Token = Annotated[str, BeforeValidator(_without_frame_prefix)]


def _as_tuple(value: object) -> object:
    """Convert a list, JSON's form of a tuple."""
    return tuple(cast(list[object], value)) if isinstance(value, list) else value


Numbers = Annotated[tuple[int, ...], BeforeValidator(_as_tuple)]


class Action(StrictModel):
    """One command for one agent, e.g. agent `Drone_T01`, command `move_to EastGate`.

    The command is sent once telemetry has verified every action in `after`.
    """

    agent: Token = Field(min_length=1, max_length=64)
    command: Token = Field(min_length=1, max_length=160)
    after: Numbers = Field(
        default=(),
        max_length=MAX_ACTIONS,
        exclude_if=lambda numbers: not numbers,
        description="numbers, from 1, of the actions that must be verified before this one is sent",
    )
    stay_s: float = Field(
        default=0.0,
        ge=0.0,
        le=MAX_STAY_S,
        exclude_if=lambda seconds: not seconds,
        description="seconds from its verification until actions after it are sent",
    )

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
        """The frame in the command, or None for a command without a frame."""
        words = self.command.split()
        return words[1] if len(words) > 1 else None


class Plan(StrictModel):
    """A reason and the actions to which it leads.

    Actions are sent together, in list order, unless they come after others. Raises ValueError if
    actions wait for themselves or for an action that does not exist.
    """

    reason: str = Field(max_length=MAX_REASON)
    actions: tuple[Action, ...] = Field(max_length=MAX_ACTIONS)

    @model_validator(mode="after")
    def _in_some_order(self) -> Self:
        for number, action in enumerate(self.actions, start=1):
            for other in action.after:
                if not 1 <= other <= len(self.actions):
                    waits = f"action {number} ({action.agent} {action.command})"
                    numbers = f"the plan has actions 1 to {len(self.actions)}"
                    raise ValueError(f"{waits} waits for action {other}, and {numbers}")
        try:
            self._sorter().prepare()
        except CycleError as error:
            circle = ", ".join(str(number) for number in cast(list[int], error.args[1]))
            raise ValueError(
                f"actions {circle} wait for each other in a circle: take one number out of `after`"
            ) from None
        return self

    def _sorter(self) -> TopologicalSorter[int]:
        waits = {number: action.after for number, action in enumerate(self.actions, start=1)}
        return TopologicalSorter(waits)

    @property
    def steps(self) -> tuple[tuple[int, ...], ...]:
        """The steps of the plan, each as the numbers of the actions that are sent together.

        A step begins once the actions for which its actions wait are verified. If no action waits,
        there is only one step.
        """
        if not any(action.after for action in self.actions):
            return (tuple(range(1, len(self.actions) + 1)),)
        sorter, groups = self._sorter(), list[tuple[int, ...]]()
        sorter.prepare()
        while sorter.is_active():
            ready = tuple(sorted(sorter.get_ready()))
            groups.append(ready)
            sorter.done(*ready)
        return tuple(groups)

    def part(self, numbers: Iterable[int]) -> "Plan":
        """Return a plan of only the actions with these numbers, without their waits."""
        chosen = tuple(
            self.actions[number - 1].model_copy(update={"after": ()}) for number in numbers
        )
        return Plan(reason=self.reason, actions=chosen)

    def depends_on(self, numbers: Iterable[int]) -> frozenset[int]:
        """Return these numbers, and those of all actions that depend on one of these actions."""
        sources = set(numbers)
        for step in self.steps:
            sources.update(number for number in step if sources & {*self.actions[number - 1].after})
        return frozenset(sources)

    @property
    def agents(self) -> tuple[str, ...]:
        """The agents in the order of the actions, one for each action."""
        return tuple(action.agent for action in self.actions)

    @property
    def answer(self) -> str:
        """The plan as a planner writes it: JSON on one line."""
        return json.dumps(self.model_dump(mode="json"), ensure_ascii=False)
