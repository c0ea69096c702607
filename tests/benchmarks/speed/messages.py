"""The questions to the processes of the plain way and of bare llama.cpp, and their answers."""

import json
from collections.abc import Sequence
from typing import Any

from pa_console.llm.roles.grammar import FEEDBACK_CHARS, MOST_VIOLATED, REASON_CHARS
from pa_console.llm.roles.role_model import PromptFormatName
from pa_console.schema.base import StrictModel
from pa_console.schema.command import COMMANDS
from pa_console.schema.plan import MAX_ACTIONS
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World


class PlainAsk(StrictModel):
    """One prompt for the plain way; `answer_schema` is the JSON schema of the answer, as text."""

    system: str
    user: str
    answer_schema: str
    max_tokens: int


class PlainAnswer(StrictModel):
    """The plain way's answer; `complete` means that it was not cut off."""

    text: str
    prompt_tokens: int
    completion_tokens: int
    complete: bool
    seconds: float


def plan_schema(world: World, picture: Picture) -> str:
    """Return the JSON schema of a plan, with the assets that are up and every command there is."""
    agents = [name for name in world.assets if picture.assets[name].available]
    commands = [
        words
        for verb, spec in COMMANDS.items()
        for words in ([f"{verb} {frame}" for frame in world.frames] if spec.takes_frame else [verb])
    ]
    action = _object(agent={"enum": agents}, command={"enum": commands})
    actions = {"type": "array", "items": action, "maxItems": min(len(agents), MAX_ACTIONS)}
    reason = {"type": "string", "minLength": 1, "maxLength": REASON_CHARS}
    return json.dumps(_object(reason=reason, actions=actions))


def verdict_schema(prompt_format: PromptFormatName, rule_ids: Sequence[str]) -> str:
    """Return the JSON schema of a verdict: an opinion on each of `rule_ids`, or the violated ones.

    The latter is how verdicts are told in the prompt format that adapters learnt.
    """
    feedback = {"type": "string", "minLength": 1, "maxLength": FEEDBACK_CHARS}
    overall = {"enum": ["Success", "Failure"]}
    if prompt_format == "compact":
        violated = {"type": "array", "items": {"enum": list(rule_ids)}, "maxItems": MOST_VIOLATED}
        return json.dumps(_object(feedback=feedback, violated=violated, verdict=overall))
    opinion = _object(
        id={"enum": list(rule_ids)}, verdict={"enum": ["complies", "violates", "unclear"]}
    )
    count = len(rule_ids)
    rules: dict[str, Any] = {"type": "array", "minItems": count, "maxItems": count}
    return json.dumps(
        _object(
            rules=rules | {"items": opinion},
            feedback=feedback,
            verdict=overall,
        )
    )


def _object(**properties: Any) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }


class Written(StrictModel):
    """The tokens of an answer."""

    read: tuple[int, ...] = ()
    """Those at its beginning that the grammar forces: they are read together with the prompt."""
    tokens: tuple[int, ...] = ()
    """The rest."""


class MeasureSpeed(StrictModel):
    """One prompt, read from an empty cache, and an answer.

    With `bare`, bare llama.cpp writes these very tokens instead of our decoder.
    """

    system: str
    user: str
    grammar: str
    max_tokens: int
    bare: Written | None = None


class Speed(StrictModel):
    """Seconds of the prompt and of the answer, in which choosing the tokens is contained."""

    batch: int
    """Prompt tokens evaluated at once."""
    prompt_tokens: int
    prompt_s: float
    answer: Written
    answer_s: float
    """Seconds of `answer.tokens`."""
    evaluations: int
    """How often the model was evaluated for them."""
    chosen: int = 0
    """Tokens that the model chose; the others were forced by the grammar."""
    guessed: int = 0
    """Those of the chosen ones that had been guessed, and so cost no evaluation of their own."""
