"""Comparisons: alternating runs, medians, and a ratio that is above 1 when ours is better."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.evaluation.bench.compare import alternate, compare
from pa_console.evaluation.bench.raw_messages import Speed
from pa_console.evaluation.machine import describe_machine

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


def test_speeds_are_told_apart_by_what_the_grammar_forced() -> None:
    speed = Speed(batch=64, prompt_tokens=100, prompt_s=0.5, steps=((1, 0.1), (9, 0.3), (1, 0.1)))
    assert speed.prompt_rate == 200.0
    assert math.isclose(speed.decoded_rate, 10.0)
    assert math.isclose(speed.forced_rate, 30.0)
    assert math.isclose(speed.rate, 22.0)


def test_an_answer_that_forced_nothing_has_no_forced_speed() -> None:
    assert Speed(batch=64, prompt_tokens=1, prompt_s=0.0, steps=((1, 0.1),)).forced_rate == 0.0


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
