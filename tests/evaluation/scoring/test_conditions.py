"""Success conditions: what cannot be meant is refused when loaded, the rest is evaluated."""

import pytest

from pa_console.evaluation.score import compile_condition, failed_conditions
from tests.evaluation.scoring.recordings import UNKNOWN, WORLD, Take


@pytest.mark.parametrize(
    ("source", "problem"),
    [
        ("run.tracks.exists(t,", "not valid CEL"),
        ("size(moved) == 0", "'moved'"),
        ("run.actoins.exists(a, a.verb == 'warn')", "'actoins'"),
        ("run.tracks.exists(t, t.gaet == 'WestGate')", "'gaet'"),
        ("run.coverage['WestGaet'].at_end", "'WestGaet'"),
        ('run.coverage["WestGaet"].at_end', "'WestGaet'"),
        ("run.tracks.exists(t, t.gate == 'WestGaet')", "'WestGaet'"),
        ("'Drone_T9' in run.moved", "'Drone_T9'"),
        ("run.final.assets.Drone_T9.available", "'Drone_T9'"),
        ("run.actions.exists(a, a.kind == 'ugw')", "'ugw'"),
        ("run.actions.all(a, a.verb != 'bloc')", "'bloc'"),
        ("frobnicate(run.moved)", "'frobnicate'"),
    ],
)
def test_a_condition_that_cannot_be_meant_is_refused(source: str, problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        compile_condition(source, WORLD)


HOLD = (
    "run.tracks.exists(t, t.gate == 'WestGate' && t.observed_s >= 0.0)",
    "run.gates.all(g, run.coverage[g].longest_gap_s <= run.grace_s)",
    "'Drone_T04' in run.moved && !('Ugv_T01' in run.moved)",
    "run.actions.exists(a, a.kind == 'uav' && a.verb == 'observe' && a.done)",
    "run.final.assets['Drone_T04'].at == 'WestGate'",
    "run.final.assets.Drone_T04.battery_pct > 50",
    "run.final.gates['EastGate'].by == ['Ugv_T01']",
    "run.visited['Drone_T04'] == ['WestGate']",
    "run.actions.all(a, a.verb in ['observe'] && !(a.kind in['ugv']))",
    "!run.actions.exists(a, a.agent == 'Drone_T99' || a.frame == 'Moon')",
    "size(run.reports) == 0 && size(run.broken) == 0 && !run.refused",
    "run.command.contains('do') && run.status == 'verified' && run.base == 'Base'",
    "run.start.tracks.all(t, t.status == 'approaching' && t.warned_s == -1.0)",
)
FAIL = ("run.refused", "run.duration_s < 1.0", "size(run.moved) == 0")
DOTTED = ("run.coverage.WestGate.at_end", "run.final.assets.Drone_T04.available")
BROKEN = ("run.tracks[7].gate == 'WestGate'", "run.duration_s", "run.gates > 3")


def test_conditions_that_do_not_hold_are_told_with_what_went_wrong() -> None:
    take = Take(UNKNOWN).do("Drone_T04 observe WestGate")
    facts = take.recorder.finish("verified")
    for source in (*HOLD, *FAIL, *BROKEN):
        compile_condition(source, WORLD)
    failed = failed_conditions((*HOLD, *FAIL, *BROKEN), facts)
    assert failed[:3] == FAIL
    for told, source in zip(failed[3:], BROKEN, strict=True):
        assert told.startswith(f"{source} (error: ")


def test_without_a_world_names_are_left_to_the_run() -> None:
    facts = Take().recorder.finish("held")
    [failed] = failed_conditions(["run.coverage['WestGaet'].at_end", *DOTTED], facts)
    assert "error" in failed
