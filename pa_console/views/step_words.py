"""A plan in steps, in words: what is done when, and what each step waits for."""

from dataclasses import dataclass, replace

from pa_console.language.canonical.reading import listed, place_words
from pa_console.schema.command import COMMANDS
from pa_console.schema.plan import Action, Plan
from pa_console.schema.text import count

MOST_AWAITED = 2
"""More actions than these that are waited for are only counted."""


@dataclass(frozen=True)
class StepLine:
    """One line of a plan in steps: an action, or the legs that one asset goes one by one."""

    numbers: str
    """The step or steps: `1`, or `2 to 7`."""
    agent: str
    does: str
    when: str
    """The condition that it waits for, in words; '' for the first step."""

    @property
    def in_words(self) -> str:
        """The whole line: *2: Drone_T02 returns to base, then, after Robot_T01 is at Base*."""
        return f"{self.numbers}: {self.agent} {self.does}{f', {self.when}' if self.when else ''}"


def in_steps(plan: Plan) -> bool:
    """Return whether some actions of `plan` wait for others."""
    return len(plan.steps) > 1


def when_in_words(plan: Plan, number: int) -> str:
    """Return what the action of that number, from 1, waits for: *then, after D is at North Gate*.

    '' for one that waits for nothing.
    """
    awaited = [plan.actions[other - 1] for other in plan.actions[number - 1].after]
    if not awaited:
        return ""
    if len(awaited) > MOST_AWAITED:
        return f"then, after {count(len(awaited), 'other action')}"
    return f"then, after {listed([_done(action) for action in awaited])}"


def step_lines(plan: Plan) -> tuple[StepLine, ...]:
    """Return the lines of a plan in steps; the legs of one asset in a row are one line."""
    found: list[StepLine] = []
    leg: Action | None = None
    for position, numbers in enumerate(plan.steps, start=1):
        actions = [plan.actions[number - 1] for number in numbers]
        alone = actions[0] if len(actions) == 1 and actions[0].target is not None else None
        if alone is not None and leg is not None and _goes_on(leg, alone):
            first = found[-1].numbers.partition(" to ")[0]
            does = f"{found[-1].does} → {place_words(alone.target or '')}"
            found[-1] = replace(found[-1], numbers=f"{first} to {position}", does=does)
        else:
            found += [
                StepLine(str(position), action.agent, _does(action), when_in_words(plan, number))
                for number, action in zip(numbers, actions, strict=True)
            ]
        leg = alone
    return tuple(found)


def orders_in_line(plan: Plan) -> str:
    """Return a plan's actions in one line, with *then* before those that wait."""
    parts = [
        "; ".join(f"{plan.actions[n - 1].agent} {plan.actions[n - 1].command}" for n in numbers)
        for numbers in plan.steps
    ]
    return "; then ".join(filter(None, parts)) or "no action"


def _goes_on(leg: Action, following: Action) -> bool:
    same = (leg.agent, leg.verb, leg.stay_s) == (following.agent, following.verb, following.stay_s)
    return same and len(following.after) == 1


def _does(action: Action) -> str:
    place = place_words(action.target) if action.target else ""
    plainly = COMMANDS[action.verb].plainly
    stays = f" ({action.stay_s:g} s at each place)" if action.stay_s else ""
    match action.verb:
        case "move_to":
            return f"goes{stays}: {place}"
        case "return_to_base":
            return "returns to base"
        case "hold":
            return "holds"
        case _:
            return f"{plainly}{stays}: {place}" if place else plainly


def _done(action: Action) -> str:
    """Return an action in words as one that is done."""
    place = place_words(action.target) if action.target else ""
    match action.verb:
        case "return_to_base":
            return f"{action.agent} is at the base"
        case "hold":
            return f"{action.agent} holds"
        case "report":
            return f"{action.agent} has reported"
        case "identify":
            return f"{action.agent} has identified at {place}"
        case "warn":
            return f"{action.agent} has warned at {place}"
        case _:
            return f"{action.agent} is at {place}"
