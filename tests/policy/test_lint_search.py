"""Searching states and paraphrases shows what reading rules does not, the same every time."""

import random
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from pa_console.policy.authoring.lint import (
    LintFinding,
    Paraphraser,
    lint_rules,
    search_rules,
    search_steps,
)
from pa_console.policy.authoring.lint_search import Conflicts
from pa_console.policy.authoring.lint_states import (
    draw_plan,
    draw_situation,
    drawn_states,
    rehearsal_of,
    small_world,
)
from pa_console.policy.rulebook import read_rule_set
from pa_console.resources import find_data
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.world import World
from pa_console.sim.worlds.world_file import load_world
from pa_console.sim.worlds.world_generator import generate_world
from tests.policy.book import checkpoint_rules, write_rules

FILES = Path(__file__).parent / "rule_files"
STATES = 100
EXAMPLES = [{"name": "p", "expect": "pass"}, {"name": "f", "expect": "fail"}]
TRACK = "tracks.exists(t, t.identity == 'unknown')"


@pytest.fixture(scope="module")
def world() -> World:
    """Return the installed checkpoint."""
    return load_world(find_data("worlds", "checkpoint", "world.yaml"))


def searched(path: Path, world: World, states: int = 40, seed: int = 0) -> list[LintFinding]:
    """Return the doubts that searching brings up."""
    return search_rules(*read_rule_set(path), world, states, seed).findings


def rule(check: str, applies: str | None = None, **more: Any) -> dict[str, Any]:
    """Return a rule with a check."""
    return {"check": check, "applies": applies, "message": "m", "examples": EXAMPLES} | more


def test_each_kind_of_doubt_occurs_once_in_the_bad_set(world: World) -> None:
    document, rule_set = read_rule_set(FILES / "doubtful.yaml")
    steps: list[None] = []
    found = search_rules(document, rule_set, world, STATES, step=lambda: steps.append(None))
    every = [*lint_rules(document, rule_set, world), *found.findings]
    kinds = [
        "duplicate", "near-duplicate", "same check", "shadowed", "never applicable",
        "contradiction", "unsatisfiable", "cannot decide", "no examples", "one-sided examples",
        "text and check disagree", "unknown name", "hard to retrieve",
    ]  # fmt: skip
    assert Counter(finding.kind for finding in every) == dict.fromkeys(kinds, 1)
    lines = (FILES / "doubtful.yaml").read_text().splitlines()
    for finding in every:
        before = "\n".join(lines[: finding.line])
        assert before.rindex(f"id: {finding.rule}") > before.rindex("  # " + finding.kind)
        assert finding.remedy
    assert {f.kind for f in every if f.severity == "error"} == {
        "contradiction", "cannot decide", "unknown name"
    }  # fmt: skip
    assert len(steps) == search_steps(rule_set, STATES)
    assert f"{found.states} states" in found.words
    assert "seed 0" in found.words


def test_equal_seeds_find_the_same(world: World) -> None:
    first, again = (searched(FILES / "doubtful.yaml", world, 10, seed=5) for _ in range(2))
    assert first == again


def test_a_contradiction_names_both_rules_and_the_situation(tmp_path: Path, world: World) -> None:
    path = write_rules(
        tmp_path,
        rule("actions.exists(a, a.verb == 'observe')", TRACK),
        rule("size(actions) > 1", TRACK),
        rule("actions.all(a, a.verb == 'hold')", TRACK),
    )
    found = [f for f in searched(path, world) if f.kind == "contradiction"]
    assert [f.rule for f in found] == ["ROE-03"]
    assert "together with ROE-01" in found[0].problem
    assert "identity" not in found[0].problem.split("where: ")[0]


def test_rules_that_several_orders_together_satisfy_are_no_contradiction(
    tmp_path: Path, world: World
) -> None:
    everywhere = "tracks.all(t, actions.exists(a, a.verb == '{}' && a.target == t.gate))"
    path = write_rules(
        tmp_path, rule(everywhere.format("observe")), rule(everywhere.format("identify"))
    )
    assert [f for f in searched(path, world) if f.severity != "note"] == []


def test_medium_rules_give_way_and_so_contradict_nobody(tmp_path: Path, world: World) -> None:
    pair = (rule("size(actions) == 0", TRACK), rule("size(actions) > 0", TRACK))
    path = write_rules(tmp_path, pair[0], pair[1] | {"priority": "medium"})
    rules = read_rule_set(path)[1].rules
    assert list(Conflicts(rules, small_world(world, ()), 0).doubts(20)) == []


def test_a_rule_that_another_one_implies_is_shadowed_only_by_one_as_strict(
    tmp_path: Path, world: World
) -> None:
    wide, narrow = rule("size(actions) < 2"), rule("size(actions) < 3")
    path = write_rules(tmp_path, wide, narrow)
    assert [(f.rule, f.kind) for f in searched(path, world)] == [("ROE-02", "shadowed")]
    path = write_rules(tmp_path, wide | {"priority": "medium"}, narrow)
    assert searched(path, world) == []


def test_paraphrases_come_from_the_vocabulary_and_are_the_same_every_time() -> None:
    made, again = Paraphraser(), Paraphraser()
    for given in checkpoint_rules().rules[:10]:
        texts = made.paraphrases(given)
        assert texts == again.paraphrases(given)
        assert texts["word order"].split()[::-1][0] in given.text.casefold()
        assert all(text.strip() for text in texts.values())
    uav = next(given for given in checkpoint_rules().rules if given.id == "CAP-01")
    assert "observation" not in made.paraphrases(uav)["synonyms for every second word"].split()


@pytest.mark.parametrize("size", [(1, 1), (9, 30)])
def test_any_world_is_made_small_and_its_states_are_possible(size: tuple[int, int]) -> None:
    world = generate_world(*size, 3)
    named = [list(world.gates)[-1], list(world.assets)[-1]]
    small = small_world(world, named)
    assert set(named) <= {*small.frames, *small.assets}
    assert World.model_validate(small.model_dump()) == small
    for state in drawn_states(small, ["Go."], 10, 1):
        assert Rehearsal.model_validate(state.rehearsal.model_dump()) == state.rehearsal


def test_orders_are_carried_out_by_whoever_can(world: World) -> None:
    small, dice = small_world(world, ()), random.Random(2)
    for _ in range(30):
        situation = draw_situation(small, dice)
        plan = draw_plan(small, situation, dice)
        rehearsal = rehearsal_of(small, situation, plan)
        for action in plan.actions:
            if not rehearsal.before.assets[action.agent].available:
                later = rehearsal.after.assets[action.agent]
                assert later == rehearsal.before.assets[action.agent]
