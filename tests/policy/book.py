"""The rule file of the checkpoint and small rule files of the tests' own."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from pa_console.policy.rulebook import Rulebook, load_rules

RULES = Path(__file__).parents[2] / "rules" / "checkpoint.yaml"


@cache
def checkpoint_rules() -> Rulebook:
    """Return the rulebook that is shipped."""
    return load_rules(RULES)


def write_rules(
    folder: Path, *rules: dict[str, Any], workflows: Sequence[dict[str, Any]] = ()
) -> Path:
    """Write a rule file with `rules`; each is ROE-01, ROE-02 and so on unless it says otherwise."""
    entries = [
        {"id": f"ROE-{number:02}", "domain": "ROE", "priority": "high", "text": "Be safe."} | rule
        for number, rule in enumerate(rules, start=1)
    ]
    path = folder / "rules.yaml"
    values = {"name": "own", "rules": entries} | (
        {"workflows": list(workflows)} if workflows else {}
    )
    path.write_text(yaml.safe_dump(values, sort_keys=False))
    return path
