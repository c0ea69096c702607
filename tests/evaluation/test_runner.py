"""An evaluation makes every run once, keeps it as it ends, and scores what truly happened."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from pa_console.evaluation.jobs import ABOUT, VARIANTS, Job, LoadedSet, find_variant, plan_jobs
from pa_console.evaluation.memo_engine import MemoEngine
from pa_console.evaluation.run_record import EvaluationFolder, RunRecord, read_runs
from pa_console.evaluation.runner import CHUNK, Runner, chunks
from pa_console.evaluation.score import SETTLE_S
from pa_console.schema.evaluation import MissionCase, MissionSet
from pa_console.session.recording import Recording
from pa_console.station.assembly import Site
from pa_console.station.headless import SETUP_SETTLE_S
from tests.scripted import FAILURE, SUCCESS, ScriptedEngine, plan

SPARE = plan(("Drone_T04", "move_to EastGate"))
STRIP = plan(("Drone_T01", "move_to EastGate"))
THERE = "run.final.assets['Drone_T04'].at == 'EastGate'"
SEND = MissionCase(
    id="C1", category="test", command="a drone to the east gate", success=(THERE,), watch_s=20.0,
    expect="execute",
)  # fmt: skip


def jobs(
    site: Site, *cases: MissionCase, variants: Sequence[str] = ("one-plan",), seeds: int = 1
) -> list[Job]:
    loaded = LoadedSet(MissionSet(name="test", missions=cases), {"": site})
    return plan_jobs([loaded], ["scripted"], [find_variant(v) for v in variants], range(seeds))


async def made(
    folder: Path, planned: list[Job], plans: list[str], verdict: str = SUCCESS, lanes: int = 1
) -> list[RunRecord]:
    def engine_for(_model: str, _lane: int) -> MemoEngine:
        return MemoEngine(ScriptedEngine(plans, [verdict]).engine(), reuse=False)

    runner = Runner(EvaluationFolder(folder), engine_for, lanes=lanes)
    return [record async for record in runner.run(planned)]


async def test_a_served_mission_is_a_strict_success_with_its_log_kept(
    tmp_path: Path, site: Site
) -> None:
    [record] = await made(tmp_path, jobs(site, SEND), [SPARE])
    assert (record.strict, record.hybrid, record.obeyed, record.refused) == (
        True,
        True,
        True,
        False,
    )
    assert record.plan == ("Drone_T04 move_to EastGate",)
    assert (record.judge_plan, record.judge_outcome) == ("Success", "Success")
    assert read_runs(tmp_path) == [record]
    recording = Recording.read(tmp_path / record.log)
    assert recording.problem is None
    assert recording[0].data.kind == "session_started"


@pytest.mark.parametrize("reuse", [True, False])
async def test_a_run_says_whether_the_picture_was_read_before_the_command(
    tmp_path: Path, site: Site, reuse: bool
) -> None:
    scripted = ScriptedEngine([plan(("Drone_T04", "report"))])

    def engine_for(_model: str, _lane: int) -> MemoEngine:
        return MemoEngine(scripted.engine(), reuse=reuse)

    runner = Runner(EvaluationFolder(tmp_path), engine_for)
    short = SEND.model_copy(update={"watch_s": 2.0})
    [record] = [record async for record in runner.run(jobs(site, short))]
    assert record.read_ahead == bool(scripted.warmed) == (not reuse)


async def test_the_judges_objection_is_noted_and_what_obeying_it_would_give(
    tmp_path: Path, site: Site
) -> None:
    [record] = await made(tmp_path, jobs(site, SEND), [SPARE], FAILURE)
    assert record.strict
    assert record.judge_plan == "Failure"
    assert not record.obeyed, "with nothing ordered the drone is not at the gate"


async def test_a_plan_that_the_rules_block_is_not_executed(tmp_path: Path, site: Site) -> None:
    [record] = await made(tmp_path, jobs(site, SEND), [STRIP])
    assert record.status == "refused"
    assert record.refused
    assert not record.strict
    assert record.failed == (THERE,)
    assert not record.hybrid, "the mission was to be carried out"


async def test_without_safeguards_the_truth_shows_the_broken_rule(
    tmp_path: Path, site: Site
) -> None:
    case = SEND.model_copy(update={"success": ("run.duration_s > 0.0",), "watch_s": 40.0})
    [record] = await made(tmp_path, jobs(site, case, variants=["no-safeguards"]), [STRIP])
    assert not record.refused
    assert "WF-03" in {breach.rule_id for breach in record.broken}
    assert not record.strict


async def test_runs_that_are_there_are_not_made_again(tmp_path: Path, site: Site) -> None:
    first = await made(tmp_path, jobs(site, SEND), [SPARE])
    both = jobs(site, SEND, seeds=2)
    second = await made(tmp_path, both, [SPARE])
    assert [record.seed for record in second] == [1]
    assert read_runs(tmp_path) == first + second


async def test_a_line_cut_off_in_the_middle_is_made_again(tmp_path: Path, site: Site) -> None:
    await made(tmp_path, jobs(site, SEND, seeds=2), [SPARE])
    path = tmp_path / "runs.jsonl"
    path.write_bytes(path.read_bytes()[:-40])
    again = await made(tmp_path, jobs(site, SEND, seeds=2), [SPARE])
    assert [record.seed for record in again] == [1]
    assert len(read_runs(tmp_path)) == 2


def test_a_line_that_is_no_run_is_named(tmp_path: Path) -> None:
    (tmp_path / "runs.jsonl").write_text('{"run": 3}\n')
    with pytest.raises(ValueError, match=r"runs\.jsonl:1: .*run"):
        read_runs(tmp_path)


async def test_several_lanes_make_every_run_once(tmp_path: Path, site: Site) -> None:
    cases = [SEND.model_copy(update={"id": f"C{n}", "watch_s": 2.0}) for n in range(CHUNK + 2)]
    records = await made(tmp_path, jobs(site, *cases), [plan(("Drone_T04", "report"))], lanes=2)
    assert sorted(r.mission for r in records) == sorted(case.id for case in cases)


def test_chunks_take_few_missions_through_all_variants(site: Site) -> None:
    cases = [SEND.model_copy(update={"id": f"C{n}"}) for n in range(CHUNK + 1)]
    first, second = chunks(jobs(site, *cases, variants=["full", "paper"]))
    assert [job.variant.name for job in first] == ["full"] * CHUNK + ["paper"] * CHUNK
    assert [job.case.id for job in second] == [f"C{CHUNK}"] * 2


def test_every_ablation_changes_something_but_the_one_that_says_it_is_the_default() -> None:
    reference = VARIANTS["one-plan"]
    for name, variant in VARIANTS.items():
        changed = variant.model_copy(update={"name": reference.name})
        same = name == reference.name or "as by default" in ABOUT[name]
        assert (changed == reference) == same
    assert list(ABOUT) == list(VARIANTS)
    counts = [VARIANTS[f"{word}-candidates"].candidates for word in ("four", "eight")]
    assert [VARIANTS["one-candidate"].candidates, *counts] == [1, 4, 8]
    with pytest.raises(ValueError, match="no-judge"):
        find_variant("nonesuch")


def test_the_idle_run_and_the_real_one_begin_at_the_same_moment() -> None:
    assert SETTLE_S == SETUP_SETTLE_S
