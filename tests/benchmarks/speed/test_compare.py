"""Comparisons: alternating runs, medians, and a ratio that is above 1 when ours is better."""

import math
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.evaluation.run_record import describe_machine
from tests.benchmarks.harness import process_memory
from tests.benchmarks.speed.compare import alternate, compare

FIGURES = st.lists(st.floats(min_value=1e-6, max_value=1e6), min_size=1, max_size=9)


@given(FIGURES, FIGURES)
def test_a_ratio_above_one_means_that_ours_is_better(ours: list[float], other: list[float]) -> None:
    times = compare("p", "n", ("ours", ours), ("other", other))
    rates = compare("p", "n", ("ours", ours), ("other", other), "tokens/s")
    assert times.other is not None
    assert times.ratio is not None
    assert rates.ratio is not None
    if times.ours.median != times.other.median:
        assert (times.ratio > 1.0) == (times.ours.median < times.other.median)
    assert math.isclose(times.ratio * rates.ratio, 1.0)
    assert times.ours.least <= times.ours.median <= times.ours.most


def test_a_cost_has_no_ratio() -> None:
    cost = compare("p", "n", ("ours", [2.0, 1.0, 4.0]))
    assert (cost.ours.median, cost.other, cost.ratio, cost.runs) == (2.0, None, None, 3)


def test_nothing_measured_is_an_error() -> None:
    with pytest.raises(ValueError, match="nothing was measured"):
        compare("p", "n", ("ours", []))


def test_runs_of_slow_operations_take_turns() -> None:
    calls: list[str] = []

    def slowly(name: str) -> None:
        calls.append(name)
        sum(range(1_500_000))

    seconds = alternate(3, (lambda: slowly("a"), lambda: slowly("b")))
    assert [len(taken) for taken in seconds] == [3, 3]
    assert all(second > 0.0 for taken in seconds for second in taken)
    turns = "".join(calls).lstrip("a").lstrip("b")
    assert turns.replace("aa", "a").replace("bb", "b") == "ababab"


def test_less_memory_is_better_and_nearly_all_runs_are_below_the_95th_percentile() -> None:
    line = compare("p", "n", ("ours", [*map(float, range(1, 101))]), ("other", [101.0]), "MB")
    assert line.ratio == 2.0
    assert 95.0 <= line.ours.p95 <= 96.0


def test_the_memory_of_a_process_is_what_the_system_says(tmp_path: Path) -> None:
    mine = process_memory(os.getpid())
    if mine is not None:
        assert 1.0 < mine.pss_mb <= mine.peak_mb
    (tmp_path / "7").mkdir()
    assert process_memory(7, tmp_path) is None
    (tmp_path / "7" / "status").write_text("Name:\tx\nVmHWM:\t  2000 kB\nVmRSS:\t  1500 kB\n")
    (tmp_path / "7" / "smaps_rollup").write_text("Rss:   1500 kB\nPss:   1000 kB\nPss_Anon: 9 kB\n")
    assert process_memory(7, tmp_path) == (1.024, 2.048)
    (tmp_path / "7" / "status").write_text("Name:\tx\n")
    assert process_memory(7, tmp_path) is None


def test_the_machine_is_read_from_where_linux_tells_it(tmp_path: Path) -> None:
    told = tmp_path / "cpuinfo"
    told.write_text(
        "processor\t: 0\nmodel name\t: Steam 8\nflags\t\t: fpu avx2 avx512f sse\n"
        "processor\t: 1\nmodel name\t: Steam 8\nflags\t\t: fpu\n",
        encoding="utf-8",
    )
    machine = describe_machine(told)
    assert (machine.cpu, machine.flags) == ("Steam 8", ("avx2", "avx512f"))
    words = " ".join(machine.lines)
    for name in ("Steam 8", "avx512f", "Python 3", "llama-cpp-python", "pymunk"):
        assert name in words


def test_a_machine_that_tells_nothing_is_described_all_the_same(tmp_path: Path) -> None:
    machine = describe_machine(tmp_path / "nothing")
    assert machine.flags == ()
    assert machine.cpu
    assert machine.usable_cores >= 1
    assert "no known vector instructions" in machine.lines[0]
