"""Rule sets that hypothesis makes, as the mappings of a rule file, and edits of them."""

import copy
import json
import random
from typing import Any, cast

from hypothesis import strategies as st

from pa_console.schema.rule import RuleSet

WORDS = st.text(st.sampled_from("ab c:#\n'\"-é☃"), min_size=1, max_size=12)
VALUES = st.recursive(
    st.booleans() | st.integers(-9, 9) | st.floats(-9, 9) | WORDS | st.none(),
    lambda below: st.lists(below, max_size=2) | st.dictionaries(WORDS, below, max_size=2),
    max_leaves=4,
)
EXAMPLE = st.fixed_dictionaries(
    {"name": WORDS, "expect": st.sampled_from(["pass", "fail", "not_applicable"])},
    optional={
        "mission": WORDS,
        "plan": st.lists(st.lists(WORDS, min_size=2, max_size=2), max_size=2),
        "given": st.dictionaries(WORDS, VALUES, max_size=2),
    },
)
ORDERING = st.fixed_dictionaries(
    {"kind": st.just("within"), "event": WORDS, "other": WORDS, "message": WORDS,
     "seconds": st.integers(1, 9)}
)  # fmt: skip
RULE = st.fixed_dictionaries(
    {"domain": st.just("ROE"), "priority": st.sampled_from(["critical", "high", "medium"]),
     "text": WORDS, "check": WORDS, "message": WORDS},
    optional={
        "tags": st.lists(WORDS, max_size=3),
        "applies": WORDS,
        "order": st.lists(ORDERING, max_size=2),
        "examples": st.lists(EXAMPLE, max_size=3),
    },
)  # fmt: skip
PHASE = st.fixed_dictionaries({"name": WORDS, "command": WORDS, "done": WORDS})
WORKFLOW = st.fixed_dictionaries(
    {"starts": WORDS, "phases": st.lists(PHASE, min_size=1, max_size=3)},
    optional={"ends": st.dictionaries(WORDS, WORDS, max_size=3)},
)


@st.composite
def rule_sets(draw: st.DrawFn) -> dict[str, Any]:
    """Draw what a rule file may hold."""
    numbers = draw(st.lists(st.integers(1, 6), min_size=1, max_size=3, unique=True))
    value: dict[str, Any] = {
        "name": draw(WORDS),
        "rules": [{"id": f"ROE-{number:02}", **draw(RULE)} for number in numbers],
    }
    if draw(st.booleans()):
        value["version"] = draw(st.sampled_from(["1", "2.0", "2026-03"]))
    flows = draw(st.lists(WORKFLOW, max_size=2))
    if flows:
        rule = value["rules"][0]["id"]
        value["workflows"] = [
            {"id": f"flow-{number}", "rule": rule, **flow} for number, flow in enumerate(flows)
        ]
    return value


def as_set(value: dict[str, Any]) -> RuleSet:
    """Return the rule set that `value` describes."""
    return RuleSet.model_validate_json(json.dumps(value))


def shuffled(value: object, rng: random.Random, kept: bool = False) -> Any:
    """Return `value` with the keys of every mapping in another order, but for ends: `kept`."""
    if isinstance(value, dict):
        items = list(cast(dict[str, object], value).items())
        if not kept:
            rng.shuffle(items)
        return {key: shuffled(below, rng, key == "ends") for key, below in items}
    if isinstance(value, list):
        return [shuffled(below, rng) for below in cast(list[object], value)]
    return value


def texts(value: object, place: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """Return where free text stands in a rule set."""
    fixed = ("id", "rule", "domain", "priority", "kind", "expect", "version")
    if isinstance(value, str):
        return [place] if place[-1] not in fixed else []
    if isinstance(value, dict):
        entries = list(cast(dict[str | int, object], value).items())
    elif isinstance(value, list):
        entries = list(enumerate(cast(list[object], value)))
    else:
        return []
    return [found for key, below in entries for found in texts(below, (*place, key))]


def edited(value: dict[str, Any], place: tuple[str | int, ...]) -> dict[str, Any]:
    """Return `value` with one character more at `place`."""
    changed = copy.deepcopy(value)
    below: Any = changed
    for key in place[:-1]:
        below = below[key]
    below[place[-1]] += "!"
    return changed
