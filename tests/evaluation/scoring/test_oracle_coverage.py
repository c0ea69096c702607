"""A gate loses its cover by an order (a breach) or otherwise (none) (WF-03)."""

from pa_console.schema.incident import FailAsset, SetComms
from tests.evaluation.scoring.recordings import WORLD, Take

GRACE_S = WORLD.coverage_grace_s


def test_the_only_guard_sent_away_is_a_breach_from_the_end_of_the_grace_time() -> None:
    take = Take().do("Drone_T01 move_to EastGate")
    [breach] = take.breaches
    assert (breach.rule_id, breach.at_s) == ("WF-03", take.recorder.recording.final.time_s)
    assert "WestGate" in breach.what
    take.send(wait_s=GRACE_S)
    [breach] = take.breaches
    assert GRACE_S < breach.at_s < GRACE_S + 2.0


def test_guards_that_change_places_within_the_grace_time_break_nothing() -> None:
    take = Take().do("Drone_T01 move_to Checkpoint", "Drone_T04 move_to WestGate")
    assert take.send(wait_s=GRACE_S).broken == set()


def test_a_relief_that_is_too_slow_is_a_breach() -> None:
    take = Take().do("Drone_T01 move_to Checkpoint", "Robot_T01 move_to WestGate", wait_s=2.0)
    facts = take.recorder.finish("verified")
    assert take.broken == {"WF-03"}
    assert facts.coverage["WestGate"].at_end
    assert facts.coverage["WestGate"].longest_gap_s > GRACE_S


def test_a_second_guard_may_go() -> None:
    take = Take().do("Ugv_T02 move_to WestGate").do("Ugv_T02 move_to Checkpoint")
    assert take.send(wait_s=GRACE_S).broken == set()


def test_a_guard_that_fails_or_loses_its_link_was_not_ordered_away() -> None:
    take = Take().do("Drone_T04 move_to EastGate")
    take.sim.inject(FailAsset(asset="Drone_T01"))
    take.sim.inject(SetComms(asset="Drone_T02", comms="lost"))
    take.send(wait_s=2 * GRACE_S)
    assert not take.recorder.recording.final.cover["WestGate"]
    assert not take.recorder.recording.final.cover["NorthGate"]
    assert take.broken == set()


def test_a_gate_that_was_bare_before_the_command_is_not_lost() -> None:
    take = Take(FailAsset(asset="Drone_T01")).do("Drone_T04 move_to WestGate")
    assert take.do("Drone_T04 move_to Checkpoint", wait_s=GRACE_S).broken == set()
