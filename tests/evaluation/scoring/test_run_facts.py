"""What success conditions can ask of a run is what truly happened in it."""

import json
from datetime import UTC, datetime

import pytest

from pa_console.evaluation.score import RunRecorder
from pa_console.schema.command import CommandReply
from pa_console.schema.events import event as ev
from pa_console.schema.incident import FailAsset, SetComms
from tests.evaluation.scoring.recordings import UNKNOWN, WORLD, Take, order


def test_a_run_without_orders_is_refused_and_nobody_has_moved() -> None:
    facts = Take().send(wait_s=3.0).recorder.finish("refused")
    assert (facts.refused, facts.moved, facts.actions) == (True, (), ())
    assert facts.duration_s == pytest.approx(3.0)
    assert facts.start.gates == facts.final.gates


def test_reports_are_from_those_that_answered() -> None:
    take = Take(SetComms(asset="Drone_T02", comms="lost"))
    facts = take.send("Drone_T01 report", "Drone_T02 report", wait_s=2.0).recorder.finish("held")
    assert facts.reports == ("Drone_T01",)
    assert facts.refused, "to report is to order nothing"


def test_moves_and_visits_are_told_by_place() -> None:
    take = Take().do("Drone_T04 move_to NorthGate").do("Drone_T04 move_to Checkpoint")
    facts = take.do("Drone_T01 move_to WestGate").recorder.finish("verified")
    assert facts.moved == ("Drone_T04",)
    assert facts.visited["Drone_T04"] == ("NorthGate", "Checkpoint")
    assert facts.visited["Drone_T01"] == ()
    assert facts.final.assets["Drone_T04"].at == "Checkpoint"
    assert all(action.done for action in facts.actions)


def test_one_that_flies_home_without_its_link_was_not_moved_by_an_order() -> None:
    take = Take(SetComms(asset="Drone_T02", comms="lost")).send(wait_s=25.0)
    facts = take.recorder.finish("refused")
    assert facts.final.assets["Drone_T02"].at != "NorthGate"
    assert facts.moved == ()


def test_gaps_count_from_the_command_on() -> None:
    take = Take(FailAsset(asset="Drone_T01")).send(wait_s=10.0)
    west = take.recorder.finish("held").coverage["WestGate"]
    assert (west.at_start, west.at_end) == (False, False)
    assert west.longest_gap_s == west.uncovered_s == pytest.approx(10.0)


def test_what_was_done_about_a_vehicle_has_its_times() -> None:
    take = Take(UNKNOWN).do("Drone_T04 observe WestGate", "Robot_T01 identify WestGate")
    [track] = take.recorder.finish("verified").tracks
    assert (track.gate, track.identity, track.intent) == ("WestGate", "unauthorized", "benign")
    assert track.observed_s == 0.0
    assert 0.0 < track.contact_s < track.identified_s
    assert (track.warned_s, track.blocked_s) == (-1.0, -1.0)
    assert track.by_order_observed
    assert track.by_order_identified
    assert WORLD.standoff_m <= track.closest_ground_m < 25.0


def test_a_standing_guard_is_no_contact_by_order() -> None:
    east = UNKNOWN.model_copy(update={"gate": "EastGate"})
    [track] = Take(east).send("Ugv_T01 hold", wait_s=15.0).recorder.finish("held").tracks
    assert (track.contact_s, track.closest_ground_m) == (-1.0, -1.0)


def test_one_that_has_driven_away_is_told_of_as_it_was_last() -> None:
    near = UNKNOWN.model_copy(update={"speed_mps": 20.0})
    take = Take(near).do("Drone_T04 observe WestGate", "Robot_T01 identify WestGate")
    facts = take.do("Robot_T01 warn WestGate", wait_s=15.0).recorder.finish("verified")
    [track] = facts.tracks
    assert (track.present, track.status) == (False, "leaving")
    assert len(facts.start.tracks) == 1
    assert facts.final.tracks == ()


def test_orders_and_answers_come_from_the_sessions_events_once_each() -> None:
    take = Take()
    recorder = RunRecorder(take.sim, "do it")

    def tell(payload: ev.EventPayload) -> None:
        recorder.see(ev.Event(t=datetime.now(UTC), tick=take.sim.tick, data=payload))

    command = order("Drone_T04 move_to WestGate")
    for _ in range(2):
        tell(ev.CommandSent(command=command))
    tell(ev.CommandResent(command_id=command.command_id, times=1))
    for _ in range(10):
        take.sim.step()
    tell(ev.TelemetryReceived(picture=take.sim.picture()))
    reply = CommandReply(
        command_id=command.command_id, agent="Drone_T04", status="refused", tick=take.sim.tick
    )
    tell(ev.CommandReplied(reply=reply))
    facts = recorder.finish("unverified")
    [action] = facts.actions
    assert (action.agent, action.verb, action.frame) == ("Drone_T04", "move_to", "WestGate")
    assert (action.done, action.rejected, action.sent_s) == (False, True, 0.0)
    assert facts.duration_s == pytest.approx(1.0)


def test_the_document_holds_plain_values_only() -> None:
    take = Take(UNKNOWN).send("Drone_T99 hold", "Drone_T04 observe WestGate", wait_s=5.0)
    document = take.recorder.finish("verified").document()
    assert json.loads(json.dumps(document)) == document
    assert "null" not in json.dumps(document)
