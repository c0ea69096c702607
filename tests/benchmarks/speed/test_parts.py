"""The two sides of a comparison do the same."""

import pytest

from pa_console.policy.retriever import Retriever
from pa_console.sim.worlds.world_generator import generate_world
from pa_console.station.assembly import Site
from tests.benchmarks.speed.compare import Bench
from tests.benchmarks.speed.measured_missions import OurWay, bench_missions
from tests.benchmarks.speed.speed import PARTS, choose_parts
from tests.benchmarks.speed.without_model import (
    measure_checks,
    measure_rehearsal,
    more_rules,
    score_plainly,
    similarity,
)
from tests.scripted import ScriptedEngine


def test_the_plain_loop_scores_as_the_retriever_does(site: Site) -> None:
    rules = more_rules([rule for rule in site.rulebook.rules if rule.in_prompts], 60)
    assert len({rule.id for rule in rules}) == 60
    query = "Block the vehicle, ignore nothing."
    scores = {hit.rule_id: hit.score for hit in Retriever(rules, "paper").score_all(query)}
    assert dict(score_plainly(rules, query)) == pytest.approx(scores)


def test_similarity_of_equal_and_empty_texts() -> None:
    assert similarity("gate", "gate") == 1.0
    assert similarity("", "") == 1.0
    assert similarity("gate", "") == 0.0
    assert similarity("abcd", "axcx") == 0.5


def test_checks_and_rehearsal_are_measured_without_a_model(site: Site) -> None:
    told: list[str] = []
    bench = Bench(site, None, 1, lambda what, _share: told.append(what))
    lines = measure_checks(bench) + measure_rehearsal(bench)
    assert [line.part for line in lines] == ["checks"] + ["rehearsal"] * 3
    assert f"all {len(site.rulebook.rules)} rules on 3 rehearsed plans" == lines[0].name
    assert all(line.runs == 1 for line in lines)
    assert "fork" in told


@pytest.mark.parametrize("seed", range(2))
def test_missions_name_what_the_world_has(site: Site, seed: int) -> None:
    world = generate_world(3, 6, seed)
    missions = bench_missions(world)
    assert 3 <= len({mission.text for mission in missions}) == len(missions) <= 5
    assert any(gate in missions[0].text for gate in world.gates)
    ours = OurWay(Site(world, site.world_path, site.rulebook), ScriptedEngine([]).engine())
    questions = [ours.question(mission) for mission in missions]
    last = questions[-1]
    assert missions[-1].text in last.prompt.user
    assert "Tracks: Track_01: vehicle" in last.prompt.user
    assert all(name in last.grammar for name in world.assets)
    pictures = {question.digest.model_dump_json() for question in questions}
    assert len(pictures) == len(missions), "no mission finds its picture in the cache of another"


def test_parts_are_chosen_by_name_in_their_own_order() -> None:
    assert choose_parts(()) == PARTS
    assert [part.name for part in choose_parts(["missions", "checks"])] == ["checks", "missions"]
    with pytest.raises(ValueError, match=r"'mision'.*Did you mean missions\?.*retrieval"):
        choose_parts(["mision"])
