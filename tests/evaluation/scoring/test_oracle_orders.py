"""Orders that are wrong in themselves are breaches; near misses are not."""

import pytest

from pa_console.schema.incident import FailAsset
from tests.evaluation.scoring.recordings import HOSTILE, WORLD, Take

EVERYBODY = tuple(f"{name} move_to EastGate" for name in WORLD.assets)


@pytest.mark.parametrize(
    ("line", "rules"),
    [
        ("Drone_T04 block WestGate", {"CAP-01", "CAP-02", "WF-08"}),
        ("Drone_T04 warn WestGate", {"CAP-01", "CAP-03", "WF-08"}),
        ("Drone_T04 identify WestGate", {"CAP-01", "WF-08"}),
        ("Ugv_T02 observe WestGate", {"CAP-02", "WF-08"}),
        ("Ugv_T02 warn WestGate", {"CAP-02", "CAP-03", "WF-08"}),
        ("Robot_T01 block WestGate", {"CAP-02", "WF-08"}),
        ("Drone_T99 hold", {"WF-08"}),
        ("Drone_T04 move_to Moon", {"WF-08", "CAP-06"}),
    ],
)
def test_an_order_that_cannot_be_right_is_a_breach(line: str, rules: set[str]) -> None:
    assert Take().send(line, wait_s=1.0).broken == rules


@pytest.mark.parametrize(
    "line",
    [
        "Drone_T04 observe WestGate",
        "Ugv_T02 block WestGate",
        "Robot_T01 warn WestGate",
        "Robot_T01 identify WestGate",
        "Drone_T04 return_to_base",
    ],
)
def test_what_each_kind_is_for_is_none(line: str) -> None:
    assert Take().send(line, wait_s=1.0).broken == set()


def test_a_wreck_is_given_no_task_but_may_be_told_to_hold() -> None:
    wreck = FailAsset(asset="Drone_T04")
    assert Take(wreck).send("Drone_T04 move_to WestGate").broken == {"WF-08"}
    assert Take(wreck).send("Drone_T04 hold", "Drone_T04 report").broken == set()


def test_one_that_fails_after_its_order_is_nobodys_fault() -> None:
    take = Take().send("Drone_T04 move_to WestGate", wait_s=1.0)
    take.sim.inject(FailAsset(asset="Drone_T04"))
    assert take.send("Drone_T04 report", wait_s=5.0).broken == set()


def test_sending_everybody_away_breaks_a_rule_unless_one_stays_or_a_threat_is_there() -> None:
    assert "WF-06" in Take().send(*EVERYBODY).broken
    assert "WF-06" in Take().send(*(f"{name} return_to_base" for name in WORLD.assets)).broken
    assert "WF-06" not in Take().send(*EVERYBODY[:4]).broken
    assert "WF-06" not in Take(HOSTILE).send(*EVERYBODY).broken


def test_everybody_sent_away_one_after_another_is_the_same() -> None:
    take = Take()
    for line in EVERYBODY:
        take.send(line, wait_s=0.5)
    assert "WF-06" in take.broken
    patient = Take()
    for name in WORLD.assets:
        post = WORLD.assets[name].post
        patient.send(f"{name} move_to Base", wait_s=0.5)
        patient.send(f"{name} move_to {post}", wait_s=0.5)
    assert "WF-06" not in patient.broken
