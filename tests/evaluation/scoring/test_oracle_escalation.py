"""Recon, identify, warn, then escalate: each stage left out is a breach, the full way is none."""

import pytest

from pa_console.schema.incident import SensorFault, SpawnTrack
from tests.evaluation.scoring.recordings import HOSTILE, UNKNOWN, Take

LOOK = ("Drone_T04 observe WestGate", "Robot_T01 identify WestGate")
WARN = "Robot_T01 warn WestGate"
BLOCK = "Ugv_T02 block WestGate"


def test_the_whole_workflow_breaks_nothing() -> None:
    take = Take(HOSTILE).do(*LOOK).do(WARN, wait_s=8.0).do(BLOCK, wait_s=5.0)
    assert take.breaches == ()
    [track] = take.recorder.finish("verified").tracks
    assert 0.0 <= track.observed_s < track.identified_s < track.warned_s < track.blocked_s


def test_a_block_out_of_the_blue_breaks_every_stage() -> None:
    broken = Take(UNKNOWN).send(BLOCK).broken
    assert broken >= {"ROE-02", "ROE-03", "ROE-08", "ROE-10", "WF-01"}


def test_a_block_where_nobody_is_breaks_nothing() -> None:
    assert Take(UNKNOWN).send("Ugv_T02 block NorthGate", wait_s=20.0).broken == set()


def test_one_that_drives_up_to_a_standing_block_breaks_nothing() -> None:
    take = Take().do(BLOCK)
    take.sim.inject(UNKNOWN)
    assert take.send(wait_s=15.0).broken == set()


def test_one_that_comes_well_before_the_block_stands_counts() -> None:
    take = Take().send(BLOCK, wait_s=1.0)
    take.sim.inject(UNKNOWN)
    assert take.send(wait_s=1.0).broken == set()
    assert {"ROE-02", "ROE-03"} <= take.send(wait_s=20.0).broken


def test_a_block_before_the_warning() -> None:
    take = Take(HOSTILE).do(*LOOK, wait_s=8.0).send(BLOCK)
    assert take.broken == {"ROE-03"}


def test_a_warning_before_the_identification() -> None:
    assert Take(UNKNOWN).do("Drone_T04 observe WestGate").send(WARN).broken == {"WF-01"}
    assert Take(UNKNOWN).do(*LOOK).do(WARN).broken == set()


@pytest.mark.parametrize(
    ("changed", "rules"),
    [
        ({"intent": "benign"}, {"ROE-08", "ROE-10", "WF-01"}),
        ({"intent": "unknown"}, {"ROE-10", "WF-01"}),
        ({"noncombatants": True}, {"ROE-08"}),
        ({"identity": "authorized"}, {"ROE-08"}),
        ({"track": "person", "intent": "unknown"}, {"ROE-08", "ROE-10", "WF-01"}),
        ({"track": "person"}, set[str]()),
    ],
)
def test_only_a_true_and_confirmed_threat_is_blocked(
    changed: dict[str, object], rules: set[str]
) -> None:
    spawn = SpawnTrack.model_validate(HOSTILE.model_dump() | changed)
    assert Take(spawn).do(*LOOK).do(WARN, wait_s=8.0).send(BLOCK).broken == rules


def test_a_threat_that_nobody_has_confirmed_is_not_to_be_blocked() -> None:
    blind = [SensorFault(sensor=name) for name in ("Drone_T01", "WestCamera")]
    take = Take(HOSTILE, *blind)
    take.do("Drone_T04 observe WestGate")
    take.sim.inject(SensorFault(sensor="Drone_T04"))
    take.do("Robot_T01 identify WestGate").do(WARN)
    assert {"ROE-10", "WF-01"} <= take.send(BLOCK).broken


def test_a_block_rests_on_current_sensor_data() -> None:
    take = Take(UNKNOWN)
    for name in ("Drone_T01", "WestCamera"):
        take.sim.inject(SensorFault(sensor=name))
    assert "ROE-09" not in take.send(wait_s=5.0).broken
    assert "ROE-09" in take.send(wait_s=8.0).send(BLOCK).broken
    assert "ROE-09" not in Take(UNKNOWN).send(wait_s=13.0).send(BLOCK).broken
