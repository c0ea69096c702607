"""The bench counts what happened: first plans, repairs, verdicts, executions, verifications."""

from pa_console.evaluation.model_bench import BenchRow, bench_model, total
from pa_console.orchestrator.compose import load_site
from pa_console.schema.mission_set import MissionCase, MissionSet
from tests.scripted import FAILURE, SUCCESS, ScriptedEngine, plan

SITE = load_site("checkpoint", "checkpoint")
GOOD, BAD = plan(("Drone_T04", "report")), plan(("Drone_T01", "move_to EastGate"))


async def _bench(plans: list[str], verdict: str, missions: int = 1) -> list[BenchRow]:
    cases = tuple(
        MissionCase(id=f"C{number}", category="test", command="say what you see")
        for number in range(missions)
    )
    engine = ScriptedEngine(plans, [verdict]).engine()
    chosen = MissionSet(name="test", missions=cases)
    rows = bench_model(SITE, engine, chosen, lambda _case, _session: lambda _event, _state: None)
    return [row async for row in rows]


async def test_a_good_plan_counts_everywhere() -> None:
    [row] = await _bench([GOOD], SUCCESS)
    assert (row.valid_json, row.first_attempt, row.after_repair) == (True, True, True)
    assert (row.judge, row.executed, row.verified) == ("Success", True, True)
    assert row.plan == "Drone_T04 report"


async def test_a_repaired_plan_is_not_a_good_first_one() -> None:
    [row] = await _bench([BAD, GOOD], SUCCESS)
    assert (row.first_attempt, row.after_repair, row.attempts) == (False, True, 2)


async def test_a_judges_failure_keeps_a_good_plan_from_being_executed() -> None:
    [row] = await _bench([GOOD], FAILURE)
    assert (row.after_repair, row.judge, row.executed) == (True, "Failure", False)


async def test_totals_add_up() -> None:
    rows = await _bench([GOOD, "nonsense"], SUCCESS, missions=3)
    summary = total("scripted", rows)
    assert summary.missions == 3
    assert summary.valid_json == 1
    assert summary.executed == summary.verified == 1
    assert summary.longest_decision_s >= summary.median_decision_s > 0
