"""A judge is asked exactly what the judge of the evaluation was asked, and held to the truth."""

import json
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.evaluation.memo_engine import MemoEngine
from pa_console.evaluation.run_record import EvaluationFolder, Opinion, RunRecord, read_runs
from pa_console.evaluation.runner import Runner
from pa_console.llm.backend import ModelUnavailableError, Request
from pa_console.llm.roles.judge import Judge
from pa_console.schema.mission import Metrics
from pa_console.station.assembly import Site
from tests.benchmarks.judge.cases import (
    CaseReader,
    JudgedCase,
    LeftOutError,
    choose_runs,
)
from tests.benchmarks.judge.verdicts import (
    JudgeAnswer,
    JudgedRun,
    errors_of,
    judge_cases,
    qualities,
)
from tests.evaluation.records import made_record
from tests.evaluation.test_runner import SEND, SPARE, STRIP, jobs
from tests.scripted import FAILURE, SUCCESS, ScriptedEngine  # fmt: skip
from tests.scripted import Answer as Scripted

HOLD = SEND.model_copy(update={"id": "C2", "category": "other", "watch_s": 5.0})


async def evaluate(folder: Path, site: Site, plans: list[str], variant: str) -> list[Request]:
    """Run SEND and HOLD, the n-th with the n-th plan; return all that was asked."""
    engine = ScriptedEngine(plans)
    runner = Runner(
        EvaluationFolder(folder), lambda _model, _lane: MemoEngine(engine.engine(), reuse=False)
    )
    async for _ in runner.run(jobs(site, SEND, HOLD, variants=[variant])):
        pass
    return engine.requests


async def judged(
    cases: list[JudgedCase], *verdicts: Scripted
) -> tuple[list[JudgedRun], list[Request]]:
    """Return what a judge with these verdicts said of `cases`, and what it was asked."""
    engine = ScriptedEngine([], verdicts)
    runs = judge_cases(cases, Judge(engine.engine()), engine.model)
    return [run async for run in runs], engine.requests


def cases_of(folder: Path) -> list[JudgedCase]:
    reader = CaseReader(folder)
    return [reader.read(record) for record in read_runs(folder)]


@pytest.mark.parametrize("variant", ["one-plan", "full", "no-safeguards"])
async def test_the_judge_is_asked_word_for_word_what_it_would_have_been_then(
    tmp_path: Path, site: Site, variant: str
) -> None:
    then = await evaluate(tmp_path, site, [SPARE], variant)
    runs, now = await judged(cases_of(tmp_path), SUCCESS)
    assert now == [request for request in then if request.role != "planner"]
    assert [request.role for request in now] == ["judge", "outcome"] * 2
    assert [run.plan.verdict for run in runs] == ["Success", "Success"]


async def test_a_run_without_a_judge_can_be_judged_too(tmp_path: Path, site: Site) -> None:
    await evaluate(tmp_path / "without", site, [SPARE], "no-judge")
    then = await evaluate(tmp_path / "with", site, [SPARE], "one-plan")
    runs, now = await judged(cases_of(tmp_path / "without"), SUCCESS)
    assert now == [request for request in then if request.role != "planner"]
    assert [run.logged_plan for run in runs] == [None, None]


async def test_verdicts_are_compared_with_the_true_state(tmp_path: Path, site: Site) -> None:
    hold = json.dumps({"reason": "", "actions": [{"agent": "Drone_T04", "command": "hold"}]})
    await evaluate(tmp_path, site, [SPARE, hold], "one-plan")
    assert [record.strict for record in read_runs(tmp_path)] == [True, False]
    runs, _ = await judged(cases_of(tmp_path), SUCCESS, SUCCESS, FAILURE, SUCCESS)
    (plan, outcome, *logged), categories, planners = qualities(runs)
    assert (plan.tp, plan.tn, plan.fp, plan.fn) == (1, 1, 0, 0)
    assert (outcome.tp, outcome.fp) == (1, 1)
    assert [line.name for line in logged] == ["plan, as logged", "outcome, as logged"]
    assert (logged[0].tp, logged[0].fp) == (1, 1)
    assert plan.failure.f1 is not None
    assert plan.failure.f1.value == 1.0
    assert outcome.failure.recall is not None
    assert outcome.failure.recall.value == 0.0
    assert [(line.name, line.runs) for line in categories] == [("other", 1), ("test", 1)]
    assert [line.name for line in planners] == ["scripted"]
    assert all(run.own_plan for run in runs), "planner and judge are the same scripted model"


async def test_a_judge_that_says_nothing_is_silent_and_the_reason_counted(
    tmp_path: Path, site: Site
) -> None:
    await evaluate(tmp_path, site, [SPARE], "one-plan")
    runs, _ = await judged(cases_of(tmp_path), "mumble", SUCCESS, SUCCESS, SUCCESS)
    (plan, *_), _, _ = qualities(runs)
    assert (plan.silent, plan.tp + plan.fn + plan.fp + plan.tn) == (1, 1)
    [(error, count)] = errors_of(runs).items()
    assert (count, "not a verdict" in error) == (1, True)


async def test_a_judge_that_cannot_be_asked_is_no_verdict(tmp_path: Path, site: Site) -> None:
    await evaluate(tmp_path, site, [SPARE], "one-plan")
    runs, _ = await judged(cases_of(tmp_path), ModelUnavailableError("gone"))
    assert {run.plan.verdict for run in runs} == {None}
    assert errors_of(runs) == {"gone": 4}


async def test_what_the_safeguards_blocked_is_no_plan_that_was_executed(
    tmp_path: Path, site: Site
) -> None:
    await evaluate(tmp_path, site, [STRIP], "one-plan")
    chosen, left_out = choose_runs(read_runs(tmp_path))
    assert chosen == []
    assert left_out == Counter({"no plan was executed": 2})
    with pytest.raises(LeftOutError, match="no decision"):
        cases_of(tmp_path)


async def test_a_log_that_is_gone_or_was_never_rehearsed_is_left_out(
    tmp_path: Path, site: Site
) -> None:
    await evaluate(tmp_path, site, [SPARE], "no-rehearsal")
    first, second = read_runs(tmp_path)
    (tmp_path / first.log).unlink()
    reader = CaseReader(tmp_path)
    with pytest.raises(LeftOutError, match="not there"):
        reader.read(first)
    with pytest.raises(LeftOutError, match="not rehearsed"):
        reader.read(second)


async def test_other_rules_than_then_are_told_and_a_missing_rule_leaves_a_run_out(
    tmp_path: Path, site: Site
) -> None:
    await evaluate(tmp_path, site, [SPARE], "one-plan")
    [record, _] = read_runs(tmp_path)
    assert not CaseReader(tmp_path).read(record).changed
    rules = tmp_path / "few.yaml"
    rules.write_text(
        "name: few\nrules:\n- {id: ROE-99, domain: ROE, text: Be good., priority: medium}\n"
    )
    with pytest.raises(LeftOutError, match="not in force any more"):
        CaseReader(tmp_path, rules=str(rules)).read(record)
    with pytest.raises(ValueError, match="--rules"):
        CaseReader(tmp_path, rules="nowhere").read(record)
    with pytest.raises(ValueError, match="--world"):
        CaseReader(tmp_path, world="nowhere").read(record)


def record(number: int, **changes: object) -> RunRecord:
    metrics = Metrics(plans=1)
    return made_record(run=f"r{number}", metrics=metrics, log=f"logs/{number}", **changes)


def test_every_nth_run_of_each_category_is_taken_and_every_other_run_accounted_for() -> None:
    runs = [record(n, category="odd" if n % 2 else "even") for n in range(10)]
    runs += [record(10, variant="full"), record(11, model="large")]
    runs += [made_record(run="r12", metrics=Metrics(plans=n)) for n in (0, 3, 1)]
    chosen, left_out = choose_runs(runs, ["one-plan"], ["m"], every=2)
    assert [run.run for run in chosen] == ["r0", "r1", "r4", "r5", "r8", "r9"]
    assert sum(left_out.values()) == len(runs) - len(chosen)
    assert left_out["several plans were executed"] == 1
    assert left_out["its log was not kept"] == 1


def said(number: int, verdict: Opinion | None, *, strict: bool) -> JudgedRun:
    return JudgedRun(
        run=str(number),
        planner=f"p{number % 2}",
        variant="v",
        category=f"c{number % 3}",
        strict=strict,
        plan=JudgeAnswer(verdict=verdict, seconds=float(number)),
    )


@given(st.lists(st.tuples(st.sampled_from(("Success", "Failure", None)), st.booleans())))
def test_the_groups_add_up_and_both_classes_tell_the_same_story(
    pairs: list[tuple[Opinion | None, bool]],
) -> None:
    runs = [said(n, verdict, strict=strict) for n, (verdict, strict) in enumerate(pairs)]
    [plan], *groups = qualities(runs)
    for lines in groups:
        for count in ("runs", "tp", "fp", "fn", "tn", "silent"):
            assert sum(getattr(line, count) for line in lines) == getattr(plan, count)
    turned = {"Success": "Failure", "Failure": "Success", None: None}
    other = [said(n, turned[v], strict=not s) for n, (v, s) in enumerate(pairs)]  # type: ignore
    [mirrored], *_ = qualities(other)
    assert (mirrored.success, mirrored.failure) == (plan.failure, plan.success)
    assert mirrored.accuracy == plan.accuracy
