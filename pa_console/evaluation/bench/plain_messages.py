"""What the benchmark asks of the plain way, and the JSON schemas that it constrains answers by."""

import json
from collections.abc import Sequence
from typing import Any

from pa_console.llm.grammar import FEEDBACK_CHARS, REASON_CHARS
from pa_console.schema.base import StrictModel
from pa_console.schema.plan import COMMANDS, MAX_ACTIONS
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


def verdict_schema(rule_ids: Sequence[str]) -> str:
    """Return the JSON schema of a verdict with an opinion on each of `rule_ids`."""
    opinion = _object(
        id={"enum": list(rule_ids)}, verdict={"enum": ["complies", "violates", "unclear"]}
    )
    count = len(rule_ids)
    rules: dict[str, Any] = {"type": "array", "minItems": count, "maxItems": count}
    return json.dumps(
        _object(
            rules=rules | {"items": opinion},
            feedback={"type": "string", "minLength": 1, "maxLength": FEEDBACK_CHARS},
            verdict={"enum": ["Success", "Failure"]},
        )
    )


def _object(**properties: Any) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }
