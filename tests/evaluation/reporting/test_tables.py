"""Tables of an evaluation: right for cases counted by hand, and made of any runs at all."""

import io

import pytest
from hypothesis import HealthCheck, given, settings
from rich.console import Console

from pa_console.cli.verbs.evaluate import to_rich
from pa_console.evaluation.reporting.report import build_tables
from pa_console.evaluation.reporting.statistics import (
    NOTHING,
    ReportTable,
    SuccessRate,
    main_runs,
    main_variant,
    rate_cell,
)
from pa_console.evaluation.reporting.tables_outcomes import (
    condition_kind,
    failure_kind,
    reason_pattern,
)
from pa_console.evaluation.run_facts import RuleBreach
from pa_console.evaluation.run_record import RunRecord
from pa_console.schema.mission import Metrics
from tests.evaluation.records import made_evaluation, made_record, many_records

LONG = settings(deadline=None, max_examples=30, suppress_health_check=[HealthCheck.too_slow])


def named(records: list[RunRecord], name: str) -> ReportTable:
    return next(table for table in build_tables(records) if table.name == name)


def row(table: ReportTable, *start: str) -> dict[str, str]:
    found = next(cells for cells in table.rows if cells[: len(start)] == start)
    return dict(zip(table.columns, found, strict=True))


@LONG
@given(many_records())
def test_any_runs_give_tables_with_names_of_their_own(records: list[RunRecord]) -> None:
    tables = build_tables(records)
    names = [table.name for table in tables]
    assert len(set(names)) == len(names)
    assert bool(tables) == bool(records)
    for table in tables:
        assert all(cell for line in table.rows for cell in line[:1]) or "failures" in table.name


@LONG
@given(many_records())
def test_runs_of_a_table_add_up(records: list[RunRecord]) -> None:
    main = main_runs(records)
    for table in build_tables(records):
        if table.name == "sets":
            strict = [line[table.columns.index("strict")].split()[-1] for line in table.rows]
            pairs = [cell.split("/") for cell in strict]
            assert sum(int(runs) for _, runs in pairs) == len(main)
            assert sum(int(won) for won, _ in pairs) == sum(run.strict for run in main)
        if table.name.startswith("failures-"):
            shares = [line[3].split()[-1].split("/") for line in table.rows]
            assert sum(int(part) for part, _ in shares) == int(shares[0][1])


@LONG
@given(many_records())
def test_tables_fit_a_terminal_of_100_columns(records: list[RunRecord]) -> None:
    for table in build_tables(records):
        console = Console(width=100, file=io.StringIO())
        shown = console.render_lines(to_rich(table), pad=False)
        assert max(sum(segment.cell_length for segment in line) for line in shown) <= 100


def test_a_table_in_the_terminal_holds_every_word_of_it() -> None:
    for table in build_tables(made_evaluation(1)):
        console = Console(width=300, file=io.StringIO(), record=True)
        console.print(to_rich(table, 300))
        text = console.export_text()
        for line in table.rows:
            assert all(cell in text for cell in line), line


def test_a_rate_shows_share_interval_and_counts() -> None:
    assert rate_cell(SuccessRate(5, 10)) == "50% (24–76) 5/10"
    assert rate_cell(SuccessRate(0, 0)) == NOTHING


def test_table_one_stands_beside_the_papers() -> None:
    records = [made_record(), made_record(seed=1, strict=False, hybrid=True)]
    hybrid = row(named(records, "table-1-hybrid"), "Baseline")
    assert hybrid["m"].endswith("2/2")
    assert (hybrid["paper: Gemma"], hybrid["paper: Qwen"]) == ("100%", "50%")
    assert row(named(records, "table-1-strict"), "Baseline")["m"].endswith("1/2")
    assert row(named(records, "figure-3"), "paper: Mistral-7B")["hybrid"] == "90%*"


def test_the_papers_values_stand_only_beside_its_own_missions() -> None:
    tables = build_tables([made_record(mission_set="field")])
    assert not any("paper: " in cell for table in tables for line in table.rows for cell in line)
    assert "figure-3" not in [table.name for table in tables]


def test_latency_counts_execution_in_simulated_seconds_only_in_the_field() -> None:
    metrics = Metrics(planning_s=2.0, judging_s=1.0, execution_s=30.0, end_to_end_s=4.0)
    table = named([made_record(metrics=metrics)], "figure-4")
    means = {line[1]: line[2] for line in table.rows if line[0] == "m"}
    assert means["decision"].startswith("3.00")
    assert means["end to end, station"].startswith("4.00")
    assert means["end to end, field"].startswith("33.0")
    assert row(table, "paper: Gemma-2B")["mean"] == "4.17"


def test_runs_without_a_verdict_are_counted_apart() -> None:
    records = [
        made_record(),
        made_record(seed=1, strict=False, judge_outcome="Success"),
        made_record(seed=2, strict=True, judge_outcome="Failure"),
        made_record(seed=3, strict=False, judge_outcome=None),
    ]
    found = row(named(records, "figure-5"), "m", "judge, outcome")
    assert [found[name] for name in ("TP", "FP", "FN", "TN", "none")] == ["1", "1", "1", "0", "1"]
    assert found["precision"].endswith("1/2")
    assert found["F1"].startswith("0.50")


def test_success_is_told_apart_by_confidence() -> None:
    records = [
        made_record(confidence=0.95),
        made_record(seed=1, confidence=0.85, strict=False, judge_plan="Failure"),
        made_record(seed=2, confidence=0.2, strict=False),
        made_record(seed=3),
    ]
    found = row(named(records, "confidence"), "m", "80%")
    assert found["sure"].endswith("2/3")
    assert found["strict if sure"].endswith("1/2")
    assert found["strict if unsure"].endswith("0/1")
    assert found["sure and passed by the judge"].endswith("1/3")
    assert found["strict of these"].endswith("1/1")
    assert "confidence" not in [table.name for table in build_tables([made_record()])]


def test_what_a_choice_among_readings_puts_right_is_told() -> None:
    records = [
        made_record(mission="P01", offered=2, strict=False),
        made_record(mission="P02", offered=1, strict=True),
        made_record(mission="P03", offered=1, strict=False),
        made_record(mission="P04"),
        made_record(mission="P01", variant="reading-1", strict=False),
        made_record(mission="P01", variant="reading-2", strict=True),
        made_record(mission="P02", variant="reading-1", strict=False),
        made_record(mission="P03", variant="reading-1", strict=False),
        made_record(mission="P04", variant="reading-1"),
    ]
    found = row(named(records, "readings"), "m")
    assert found["offered"].endswith("3/4")
    assert found["strict as first read"].endswith("1/3")
    assert found["strict in any reading"].endswith("2/3")
    assert found["strict in any reading, all runs"].endswith("3/4")
    assert "readings" not in [table.name for table in build_tables(records[:4])]


def test_an_order_to_hold_that_was_asked_for_is_no_refusal() -> None:
    records = [
        made_record(refused=True, strict=True),
        made_record(seed=1, refused=True, strict=False),
        made_record(seed=2, expect="refuse", refused=True),
        made_record(seed=3, expect="refuse", refused=False, strict=False),
        made_record(seed=4, tags=("harmless",), refused=True, strict=False),
    ]
    found = row(named(records, "refusals"), "m")
    assert found["recall"].endswith("1/2")
    assert found["precision"].endswith("1/3")
    assert found["refused: must be carried out"].endswith("2/3")
    assert found["refused: harmless"].endswith("1/1")


def test_an_ablation_shows_other_models_under_the_reference() -> None:
    records = [
        made_record(seed=0),
        made_record(seed=1),
        made_record(variant="no-judge"),
        made_record(model="bare", seed=0, strict=False),
        made_record(model="bare", seed=1),
        made_record(model="bare", seed=1, variant="full"),
        made_record(model="elsewhere", seed=7),
    ]
    table = named(records, "ablation-m")
    assert [line[0] for line in table.rows] == ["one-plan", "no-judge", "model bare"]
    found = row(table, "model bare")
    assert (found["points"], found["better/ worse"]) == ("-50", "0/1")
    assert found["strict"].endswith("1/2")


def test_an_ablation_compares_the_runs_that_both_made() -> None:
    records = [
        *(made_record(seed=seed, strict=True) for seed in range(4)),
        *(made_record(variant="no-judge", seed=seed, strict=seed > 0) for seed in range(2)),
        made_record(variant="no-judge", seed=9, strict=False),
    ]
    found = row(named(records, "ablation-m"), "no-judge")
    assert (found["points"], found["better/ worse"]) == ("-50", "0/1")
    assert row(named(records, "ablation-m"), "one-plan")["points"] == NOTHING


def test_the_main_variant_is_the_one_that_most_models_ran() -> None:
    records = [made_record(), made_record(variant="full"), made_record(variant="full", model="n")]
    assert main_variant(records) == "full"
    assert main_variant(records[:2]) == "one-plan"
    assert main_variant([]) == ""


@pytest.mark.parametrize(
    ("condition", "kind"),
    [
        ("run.tracks.exists(t, t.gate == 'A' && t.observed_s >= 0.0)", "tracks (gate, observed_s)"),
        (
            "run.gates.all(g, run.coverage[g].longest_gap_s <= run.grace_s)",
            "coverage (longest_gap_s)",
        ),
        ("size(run.moved) == 0", "moved"),
        ("run.final.assets['run.x'].at == \"B\"", "final.assets (at)"),
    ],
)
def test_conditions_of_one_kind_are_counted_together(condition: str, kind: str) -> None:
    assert condition_kind(condition) == kind


def test_reasons_lose_names_and_numbers() -> None:
    assert reason_pattern("ROE-04 (high): Ugv_T01 is near; WF-02: 3 gates") == "ROE-04; WF-02"
    assert reason_pattern("Drone_T03 is 12 m off") == reason_pattern("Drone_T04 is 99 m off")
    assert reason_pattern("") == ""


def test_the_way_of_failing_tells_broken_rules_and_conditions() -> None:
    assert failure_kind(made_record()) is None
    breach = RuleBreach(rule_id="WF-02", what="NorthGate is not covered", at_s=3.0)
    kind = failure_kind(
        made_record(strict=False, broken=(breach,), failed=("size(run.moved) == 0",))
    )
    assert kind == ("carry out", "verified", "broke WF-02; condition on moved")
    refused = made_record(strict=False, status="refused", reason="ROE-04 (high): x", refused=True)
    assert failure_kind(refused) == ("carry out", "refused", "ROE-04")
