"""What the benchmark compares is the same on both sides."""

from datetime import UTC, datetime

import pytest

from pa_console.policy.authoring.examples import WORLD, example_plan, example_rehearsal
from pa_console.policy.retriever import Retriever
from pa_console.schema.mission import Mission
from pa_console.sim.worlds.world_generator import generate_world
from pa_console.station.assembly import Site
from tests.benchmarks.speed.authorization import measure_authorization
from tests.benchmarks.speed.checks import (
    TWINS,
    RehearsedPlan,
    Twin,
    compare_findings,
    in_cel,
    in_python,
    make_cases,
    measure_checks,
    shipped_rules,
)
from tests.benchmarks.speed.compare import Bench
from tests.benchmarks.speed.measured_missions import OurWay, bench_missions
from tests.benchmarks.speed.retrieval_loop import more_rules, score_plainly, similarity
from tests.benchmarks.speed.simulation import bare_space, measure_rehearsal, measure_simulation
from tests.benchmarks.speed.speed import PARTS, choose_parts
from tests.scripted import ScriptedEngine

MISSION = Mission(id="x", text="Secure the checkpoint.", created=datetime(2000, 1, 1, tzinfo=UTC))


def bench(site: Site, told: list[str] | None = None) -> Bench:
    """Return a benchmark of one run without a model."""
    heard = [] if told is None else told
    return Bench(site, None, 1, lambda what, _share: heard.append(what))


def test_twins_find_what_the_shipped_checks_find_in_every_example() -> None:
    book = shipped_rules()
    assert {rule.id for rule in book.rules} == set(TWINS)
    seen: dict[str, set[str]] = {name: set() for name in TWINS}
    for rule in book.rules:
        for example in rule.examples:
            if example.moments:
                continue
            plan = example_plan(example)
            case = RehearsedPlan(plan, example_rehearsal(example, plan), MISSION, WORLD)
            assert in_python(book, case) == in_cel(book, case), f"{rule.id}: {example.name}"
            found = {finding.rule_id: finding.status for finding in in_python(book, case)}
            seen[rule.id].add(found[rule.id])
    assert all({"complies", "violates"} <= statuses for statuses in seen.values()), seen


@pytest.mark.parametrize("seed", range(2))
def test_twins_agree_in_worlds_of_other_names(site: Site, seed: int) -> None:
    world = generate_world(4, 12, seed)
    cases = make_cases(Site(world, site.world_path, site.rulebook))
    compare_findings(shipped_rules(), cases)
    broken = {f.rule_id for case in cases for f in in_cel(shipped_rules(), case) if f.broken}
    assert {"CAP-07", "ROE-10"} <= broken


def test_a_twin_that_says_something_else_is_an_error(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrong: dict[str, Twin] = {**TWINS, "CAP-07": lambda _case: ["nobody"]}
    monkeypatch.setattr("tests.benchmarks.speed.checks.TWINS", wrong)
    with pytest.raises(ValueError, match=r"CAP-07.*--only"):
        measure_checks(bench(site))


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


def test_the_bare_space_holds_as_many_bodies_as_the_world_assets(site: Site) -> None:
    space = bare_space(site.world)
    assert len(space.bodies) == len(site.world.assets)
    assert len(space.static_body.shapes) == len(site.world.walls)
    before = [body.position for body in space.bodies]
    space.step(1.0)
    assert all(body.position != at for body, at in zip(space.bodies, before, strict=True))


def test_simulation_and_rehearsal_tell_what_they_do(site: Site) -> None:
    told: list[str] = []
    found = measure_simulation(bench(site, told)) + measure_rehearsal(bench(site, told))
    assert {line.part for line in found} == {"simulation", "rehearsal"}
    assert all(line.runs == 1 for line in found)
    assert all("real time" in line.note for line in found if line.part == "simulation")
    assert "fork" in told


def test_every_command_of_the_authorization_is_taken(site: Site) -> None:
    told: list[str] = []
    found = measure_authorization(bench(site, told))
    assert {line.part for line in found} == {"authorization"}
    assert [line.name for line in found if line.other is not None] == ["sign and check a command"]
    assert told


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
