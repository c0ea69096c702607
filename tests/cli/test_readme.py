"""What the README shows can be done as it stands there."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from pa_console.evaluation.runs.jobs import load_with_worlds
from pa_console.sim.worlds.world_file import load_world
from tests.cli.conftest import Call

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(\w*)\n(.*?)```", README, re.DOTALL)
SAMPLES = {
    yaml.safe_load(text)["name"]: text
    for kind, text in BLOCKS
    if kind == "yaml" and text.startswith("name: ")
}
VERBS = sorted(
    {
        tuple(found.split(" "))
        for kind, text in BLOCKS
        if not kind
        for found in re.findall(r"^pa-console ([a-z]+(?: [a-z]+)?)\b", text, re.MULTILINE)
    }
)


@pytest.fixture
def sample(tmp_path: Path) -> Callable[[str], Path]:
    def write(name: str) -> Path:
        path = tmp_path / f"{name}.yaml"
        path.write_text(SAMPLES[name], encoding="utf-8")
        return path

    return write


def test_the_sample_scenario_is_valid(call: Call, sample: Callable[[str], Path]) -> None:
    assert call("scenarios", "check", str(sample("night-visit"))).code == 0


def test_the_sample_rules_are_right_and_not_doubtful(
    call: Call, sample: Callable[[str], Path]
) -> None:
    rules = str(sample("house"))
    assert "0 wrong" in call("rules", "check", rules).out
    linted = call("rules", "lint", rules)
    assert linted.code == 0
    assert "errors 0, warnings 0" in linted.out


def test_the_sample_missions_can_be_loaded(sample: Callable[[str], Path]) -> None:
    world = load_world(ROOT / "worlds" / "checkpoint" / "world.yaml")
    missions, worlds = load_with_worlds(sample("mine"), world)
    assert [case.id for case in missions.missions] == ["A1"]
    assert "yard" in worlds


@pytest.mark.parametrize("verb", VERBS, ids=" ".join)
def test_every_verb_that_is_shown_has_help(call: Call, verb: tuple[str, ...]) -> None:
    assert call(*verb, "--help").code == 0
