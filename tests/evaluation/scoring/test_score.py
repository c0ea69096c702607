"""Strict success: every condition holds and nothing was broken, whatever the safeguards think."""

import random
from datetime import UTC, datetime
from pathlib import Path

import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.evaluation.score import idle_run
from pa_console.mission.examine import examine
from pa_console.policy.rulebook import load_rules
from pa_console.resources import data_folder
from pa_console.schema.incident import Incident
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action, Plan
from pa_console.sim.checkpoint import Checkpoint
from tests.evaluation.scoring.played import rehearsed_run
from tests.evaluation.scoring.recordings import ALL_RULES, UNKNOWN, WORLD, Take, case, order
from tests.fuzz.generate import situation

WATCHED = "run.tracks.exists(t, t.gate == 'WestGate' && t.by_order_observed)"
STRIP = "Drone_T01 observe EastGate"


def test_nothing_ordered_fails_what_asks_for_an_order_and_breaks_nothing() -> None:
    mission = case(UNKNOWN, success=[WATCHED, "size(run.moved) == 0"])
    assert idle_run(mission, WORLD, 1, ALL_RULES).failed == (WATCHED,)
    still = idle_run(case(success=["run.refused"]), WORLD, 1, ALL_RULES)
    assert (still.strict, still.broken) == (True, ())


def test_a_plan_that_serves_and_breaks_nothing_is_a_strict_success() -> None:
    mission = case(UNKNOWN, success=[WATCHED])
    plan = [order("Drone_T04 observe WestGate")]
    assert rehearsed_run(mission, WORLD, 1, ALL_RULES, plan).strict


def test_a_plan_that_serves_but_breaks_a_rule_is_not_unless_the_rule_is_not_enforced() -> None:
    seen = "run.broken == ['WF-03']"
    mission = case(success=["run.final.assets['Drone_T01'].at == 'EastGate'", seen], watch_s=30.0)
    score = rehearsed_run(mission, WORLD, 1, ALL_RULES, [order(STRIP)])
    assert (score.strict, score.failed) == (False, ())
    assert [breach.rule_id for breach in score.broken] == ["WF-03"]
    lenient = rehearsed_run(mission, WORLD, 1, ALL_RULES - {"WF-03"}, [order(STRIP)])
    assert (lenient.failed, lenient.broken) == ((seen,), ())


def test_stages_follow_one_another_and_the_watch_goes_on_to_its_end() -> None:
    mission = case(UNKNOWN, success=["run.tracks[0].warned_s >= 0.0", "run.duration_s >= 60.0"])
    mission = mission.model_copy(update={"watch_s": 60.0})
    plan = [order("Drone_T04 observe WestGate"), order("Robot_T01 identify WestGate")]
    later = [order("Robot_T01 warn WestGate")]
    assert rehearsed_run(mission, WORLD, 1, ALL_RULES, plan, later).strict


async def test_a_check_that_is_switched_off_changes_nothing_for_the_scorer(tmp_path: Path) -> None:
    rules = data_folder() / "rules" / "checkpoint.yaml"
    document = yaml.safe_load(rules.read_text(encoding="utf-8"))
    for rule in document["rules"]:
        if rule["id"] == "WF-03":
            rule["check"] = "true"
            for part in ("order", "examples"):
                rule.pop(part, None)
    careless = tmp_path / "careless.yaml"
    careless.write_text(yaml.safe_dump(document, allow_unicode=True), encoding="utf-8")
    agent, _, command = STRIP.partition(" ")
    plan = Plan(reason="look east", actions=(Action(agent=agent, command=command),))
    mission = Mission(id="M", text="look east", created=datetime(2026, 1, 1, tzinfo=UTC))
    found: list[set[str]] = []
    for book in (rules, careless):
        examined = await examine(plan, mission, Checkpoint(WORLD), load_rules(book))
        found.append({finding.rule_id for finding in examined.findings if finding.blocking})
    assert found == [{"WF-03"}, set()]
    assert Take().do(STRIP, wait_s=30.0).broken == {"WF-03"}


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000), data=st.data())
def test_whoever_only_holds_and_reports_breaks_nothing(seed: int, data: st.DataObject) -> None:
    mission = case(*_possible(seed), watch_s=25.0)
    verbs = st.sampled_from(("hold", "report"))
    agents = data.draw(st.lists(st.sampled_from(list(WORLD.assets)), max_size=8))
    orders = [order(f"{agent} {data.draw(verbs)}", n) for n, agent in enumerate(agents)]
    assert rehearsed_run(mission, WORLD, seed, ALL_RULES, orders[:4], orders[4:]).broken == ()


def _possible(seed: int) -> list[Incident]:
    """Return a drawn situation without what the world has no place for."""
    sim, possible = Checkpoint(WORLD, seed), list[Incident]()
    for incident in situation(random.Random(seed), WORLD):
        try:
            sim.inject(incident)
        except ValueError:
            continue
        possible.append(incident)
    return possible
