"""Reads plans written by hand, for the simulation to play and the scorer to judge."""

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from pa_console.schema.plan import Action, Plan
from tests.shipped import quick_yaml

FOLDER = Path(__file__).parent / "witnesses"


@cache
def written(pattern: str) -> Mapping[str, Any]:
    """Return what the witness files that match `pattern` say, by mission id."""
    found: dict[str, Any] = {}
    for path in sorted(FOLDER.glob(pattern)):
        found |= quick_yaml(path) or {}
    return found


def plans(lines: Sequence[str] | Sequence[Sequence[str]]) -> list[Plan]:
    """Return the plans of a witness: one, from `agent command` lines, or one after another."""
    several = [lines] if all(isinstance(line, str) for line in lines) else lines
    return [
        Plan(
            reason="written by hand",
            actions=tuple(
                Action(agent=agent, command=command)
                for agent, _, command in (str(line).partition(" ") for line in one)
            ),
        )
        for one in several
    ]
