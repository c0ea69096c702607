"""Lint names what is doubtful in a rule set, with rule and line, and is quiet about a sound one."""

from pathlib import Path
from typing import Any

import pytest

from pa_console.policy.authoring.lint import LintFinding, lint_rules
from pa_console.policy.rulebook import read_rule_set
from pa_console.resources import find_data
from pa_console.schema.world import World
from pa_console.sim.worlds.world_file import load_world
from tests.policy.book import RULES, write_rules

EXAMPLES = [{"name": "p", "expect": "pass"}, {"name": "f", "expect": "fail"}]
SOUND: dict[str, Any] = {
    "text": "Every plan has at least one action.",
    "check": "size(actions) > 0",
    "message": "the plan is empty",
    "examples": EXAMPLES,
}


@pytest.fixture(scope="module")
def world() -> World:
    """Return the world whose names the rules are held against."""
    return load_world(find_data("worlds", "checkpoint", "world.yaml"))


def lint(path: Path, world: World) -> list[LintFinding]:
    """Return the doubts about a rule file."""
    return lint_rules(*read_rule_set(path), world)


def test_the_shipped_rules_raise_no_doubt(world: World) -> None:
    assert lint(RULES, world) == []


def test_a_sound_rule_raises_no_doubt(tmp_path: Path, world: World) -> None:
    assert lint(write_rules(tmp_path, SOUND), world) == []


@pytest.mark.parametrize(
    ("rule", "kind", "says"),
    [
        ({"examples": []}, "no examples", "nothing shows"),
        ({"examples": EXAMPLES[:1]}, "one-sided examples", "no example breaks it"),
        ({"text": "Keep the north gate closed."}, "text and check disagree", "names NorthGate"),
        ({"check": "gates['EastGate'].covered"}, "text and check disagree", "check EastGate"),
        ({"text": "The West Gate is covered.", "check": "gates['EastGate'].covered"},
         "text and check disagree", "the text names WestGate, the check EastGate"),
        ({"check": "gates['UpperGate'].covered"}, "unknown name", "'UpperGate'"),
        ({"text": "UAVs only look.", "check": "actions.all(a, a.kind != 'ugv')"},
         "text and check disagree", "about uav, the check about ugv"),
    ],
)  # fmt: skip
def test_each_doubt_is_named_where_it_arises(
    tmp_path: Path, world: World, rule: dict[str, Any], kind: str, says: str
) -> None:
    path = write_rules(tmp_path, SOUND | rule)
    found = lint(path, world)
    doubt = next(finding for finding in found if finding.kind == kind)
    assert says in doubt.problem
    assert doubt.remedy
    assert doubt.rule == "ROE-01"
    lines = path.read_text().splitlines()
    assert any(word in lines[doubt.line - 1] for word in ("check", "examples", "text"))


def test_rules_that_repeat_each_other_are_named_at_the_second(tmp_path: Path, world: World) -> None:
    other = {"text": "Guns stay holstered.", "check": "size( actions ) > 0"}
    near = {"text": "Every plan has at least one action!", "check": "size(tracks) == 0"}
    nearly = {"text": "Each plan has at least one action.", "check": "size(tracks) == 1"}
    found = lint(
        write_rules(tmp_path, *(SOUND | rule for rule in ({}, other, near, nearly))), world
    )
    kinds = [(finding.rule, finding.kind) for finding in found]
    assert ("ROE-02", "same check") in kinds
    assert ("ROE-03", "duplicate") in kinds
    assert ("ROE-04", "near-duplicate") in kinds
    assert [finding.line for finding in found] == sorted(finding.line for finding in found)


def test_a_rule_that_its_own_text_does_not_find_is_named(tmp_path: Path, world: World) -> None:
    same = [{"text": "Report what you see.", "priority": "medium"} for _ in range(5)]
    found = lint(write_rules(tmp_path, *same), world)
    hard = [finding.rule for finding in found if finding.kind == "hard to retrieve"]
    assert hard == ["ROE-04", "ROE-05"]
