"""Confidence stands beside success, and the distance between them is what is told."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.evaluation.reporting.report import write_report
from pa_console.evaluation.reporting.tables_judgement import (
    calibration_error,
    calibration_table,
    reliability,
)
from tests.evaluation.records import made_record

TOLD = st.lists(st.tuples(st.floats(0.0, 1.0), st.booleans()), min_size=1)


@given(TOLD)
def test_every_run_is_in_one_bin_and_the_error_is_a_share(told: list[tuple[float, bool]]) -> None:
    bins = reliability(told)
    assert sum(found.strict.runs for found in bins) == len(told)
    assert sum(found.strict.successes for found in bins) == sum(strict for _, strict in told)
    error = calibration_error(told)
    assert error is not None
    assert 0.0 <= error <= 1.0


def test_who_is_as_often_right_as_sure_has_no_error() -> None:
    assert calibration_error([(0.75, True)] * 3 + [(0.75, False)]) == pytest.approx(0.0)


def test_who_is_sure_and_wrong_has_the_whole_error() -> None:
    assert calibration_error([(1.0, False)] * 4) == pytest.approx(1.0)
    assert calibration_error([]) is None


def test_a_report_shows_the_error_and_the_diagram_where_models_tell_how_sure_they_are(
    tmp_path: Path,
) -> None:
    records = [
        made_record(seed=seed, confidence=0.75, strict=strict)
        for seed, strict in enumerate((True, True, True, False))
    ]
    table = calibration_table(records)
    assert [row[1] for row in table.rows] == ["70% to 80%", "all"]
    assert table.rows[-1][-1] == "0.000"
    write_report(tmp_path, records, {})
    assert (tmp_path / "figures" / "reliability.svg").stat().st_size > 0
    assert not calibration_table([made_record()]).rows
