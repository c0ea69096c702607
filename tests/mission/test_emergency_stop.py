"""Stop: every asset is told to hold, and told again until telemetry shows that it stands."""

from typing import Any

import pytest

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.mission.gate import CommandGate
from pa_console.mission.stop import (
    AGAIN_S,
    FIRST_AGAIN_S,
    MOST_AT_ONCE,
    SAFETY_LIMIT_S,
    EmergencyStop,
    StopConfirmation,
)
from pa_console.schema.command import DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.incident import SetRadio
from pa_console.schema.telemetry import AssetTelemetry, Picture
from pa_console.session.log.journal import Journal
from pa_console.sim.checkpoint import Checkpoint
from pa_console.station.assembly import Site

pytestmark = pytest.mark.invariant


def stops_of(sim: Checkpoint) -> EmergencyStop:
    fleet = SimulatedFleet(sim)
    return EmergencyStop(fleet, CommandGate(fleet, Journal()))


def follow(sim: Checkpoint, stops: EmergencyStop, seconds: float) -> list[ev.EventPayload]:
    """Let time pass; return what the stops had to tell."""
    told: list[ev.EventPayload] = []
    for _ in range(round(seconds / sim.world.dt_s)):
        replies = tuple(sim.step())
        told += stops.step((sim.tick, replies))
    return told


def answered(told: list[ev.EventPayload]) -> dict[str, str]:
    """Return the last word on each agent."""
    return {p.reply.agent: p.reply.status for p in told if isinstance(p, ev.CommandReplied)}


def test_every_asset_that_moves_comes_to_a_stop(site: Site) -> None:
    sim = Checkpoint(site.world)
    sim.send(DeviceCommand(command_id="c1", agent="Drone_T04", verb="move_to", target="WestGate"))
    follow(sim, stops_of(sim), 2.0)
    assert sim.picture().assets["Drone_T04"].speed_mps > 0
    stops = stops_of(sim)
    sent = [payload for payload in stops.hold_all() if isinstance(payload, ev.CommandSent)]
    assert [payload.command.agent for payload in sent] == list(site.world.assets)
    assert stops.waiting
    told = follow(sim, stops, 5.0)
    assert set(answered(told).values()) == {"done"}
    assert not stops.waiting
    assert not any(isinstance(payload, ev.CommandResent) for payload in told)
    drone = sim.picture().assets["Drone_T04"]
    assert (drone.speed_mps, drone.task) == (0.0, "holding")


def test_a_stop_is_repeated_until_its_device_answers_however_long_that_takes(site: Site) -> None:
    sim = Checkpoint(site.world)
    sim.inject(SetRadio(asset="Drone_T01", up=False))
    stops = stops_of(sim)
    list(stops.hold_all())
    told = follow(sim, stops, 10.0)
    assert "Drone_T01" not in answered(told)
    assert any(isinstance(payload, ev.CommandResent) for payload in told)
    assert stops.waiting
    told = follow(sim, stops, 2 * SAFETY_LIMIT_S)
    assert "Drone_T01" not in answered(told)
    assert len(told) > 10
    sim.inject(SetRadio(asset="Drone_T01"))
    assert answered(follow(sim, stops, 10.0)) == {"Drone_T01": "done"}
    assert not stops.waiting
    assert follow(sim, stops, 10.0) == []


def test_stops_of_their_own_each_have_ids_of_their_own(site: Site) -> None:
    stops = stops_of(Checkpoint(site.world))
    held = [payload for _ in range(2) for payload in stops.hold_all()]
    ids = [payload.command.command_id for payload in held if isinstance(payload, ev.CommandSent)]
    assert len(set(ids)) == 2 * len(site.world.assets)


def test_nothing_to_follow_is_nothing_to_wait_for(site: Site) -> None:
    stops = stops_of(Checkpoint(site.world))
    assert list(stops.follow(())) == []
    assert not stops.waiting


def doubts(told: list[ev.EventPayload]) -> list[dict[str, str]]:
    """Return what the console reported to be in doubt, change by change."""
    return [payload.assets for payload in told if isinstance(payload, ev.StopUnconfirmed)]


def test_a_stop_that_is_obeyed_raises_no_doubt(site: Site) -> None:
    for phase in range(5):
        sim = Checkpoint(site.world)
        order = {"command_id": "c1", "agent": "Drone_T04", "verb": "move_to", "target": "WestGate"}
        sim.send(DeviceCommand.model_validate(order))
        follow(sim, stops_of(sim), 2.0 + phase * site.world.dt_s)
        stops = stops_of(sim)
        list(stops.hold_all())
        assert doubts(follow(sim, stops, 10.0)) == []
        assert not stops.waiting


def test_an_asset_that_does_not_answer_a_stop_is_named_within_a_second_and_a_half(
    site: Site,
) -> None:
    sim = Checkpoint(site.world)
    sim.inject(SetRadio(asset="Drone_T01", up=False))
    stops = stops_of(sim)
    list(stops.hold_all())
    assert doubts(follow(sim, stops, 0.8)) == []
    assert doubts(follow(sim, stops, 0.5)) == [{"Drone_T01": "no answer"}]
    sim.inject(SetRadio(asset="Drone_T01"))
    assert doubts(follow(sim, stops, 10.0))[-1] == {}


def resends(told: list[ev.EventPayload]) -> int:
    """Return how often a hold was sent again."""
    return sum(isinstance(payload, ev.CommandResent) for payload in told)


def test_a_hold_without_an_answer_is_sent_several_times_a_second_and_later_seldom(
    site: Site,
) -> None:
    sim = Checkpoint(site.world)
    sim.inject(SetRadio(asset="Drone_T01", up=False))
    stops = stops_of(sim)
    list(stops.hold_all())
    assert resends(follow(sim, stops, 4.0)) == 1 + (4.0 - FIRST_AGAIN_S) / AGAIN_S
    follow(sim, stops, 60.0)
    assert resends(follow(sim, stops, 20.0)) <= 4


def test_an_asset_that_is_heard_again_without_an_answer_is_told_to_hold_at_once(
    site: Site,
) -> None:
    fleet = Fleet(Checkpoint(site.world))
    drone = fleet.picture().assets["Drone_T04"]
    fleet.lie = drone.model_copy(update={"stale": True})
    fleet.checkpoint.inject(SetRadio(asset="Drone_T04", up=False))
    stops = EmergencyStop(fleet, CommandGate(fleet, Journal()))
    list(stops.hold_all())
    follow(fleet.checkpoint, stops, 60.0)
    fleet.lie = drone
    assert resends(follow(fleet.checkpoint, stops, 2.0)) >= 8, "it may hear now"


def test_of_a_large_silent_team_no_more_holds_go_out_in_a_step_than_a_link_takes(
    site: Site,
) -> None:
    holds = [
        DeviceCommand(command_id=f"stop1.{number}", agent=f"Drone_{number}", verb="hold")
        for number in range(3 * MOST_AT_ONCE)
    ]
    stop = StopConfirmation(holds, site.world, 0, 0.0)
    sent = [[command for command, _ in stop.resends(tick, {})] for tick in range(10)]
    assert max(map(len, sent)) == MOST_AT_ONCE
    assert {command.agent for due in sent for command in due} == {hold.agent for hold in holds}


class Fleet(SimulatedFleet):
    """A fleet whose drone answers a stop and does not obey it, in a way of its own."""

    lie: AssetTelemetry | None = None

    def picture(self) -> Picture:
        """Return telemetry, with the drone's as it reports it."""
        picture = super().picture()
        if self.lie is None:
            return picture
        lie = self.lie.model_copy(update={"stamp_s": picture.time_s})
        return picture.model_copy(update={"assets": {**picture.assets, "Drone_T04": lie}})


@pytest.mark.parametrize(
    ("reports", "why"),
    [
        ({"speed_mps": 3.0}, "it moves"),
        ({"task": "moving"}, "it moves"),
        ({"integrity": "suspect"}, "its telemetry cannot be relied on"),
        ({"stale": True}, "no telemetry since"),
    ],
)
def test_an_acknowledgement_alone_confirms_no_stop(
    reports: dict[str, Any], why: str, site: Site
) -> None:
    fleet = Fleet(Checkpoint(site.world))
    fleet.lie = fleet.picture().assets["Drone_T04"].model_copy(update=reports)
    stops = EmergencyStop(fleet, CommandGate(fleet, Journal()))
    list(stops.hold_all())
    told = follow(fleet.checkpoint, stops, 4.0)
    assert answered(told)["Drone_T04"] == "done"
    assert doubts(told) == [{"Drone_T04": why}]
    assert [p.command_id for p in told if isinstance(p, ev.CommandResent)], "it is told again"
    fleet.lie = None
    assert doubts(follow(fleet.checkpoint, stops, 2.0)) == [{}]


def test_an_asset_that_moves_again_after_it_stood_is_in_doubt_at_once(site: Site) -> None:
    fleet = Fleet(Checkpoint(site.world))
    stops = EmergencyStop(fleet, CommandGate(fleet, Journal()))
    list(stops.hold_all())
    follow(fleet.checkpoint, stops, 3.0)
    assert not stops.waiting
    stood = fleet.picture().assets["Drone_T04"]
    crept = (stood.position[0] + 5.0, stood.position[1])
    fleet.lie = stood.model_copy(update={"position": crept})
    told = follow(fleet.checkpoint, stops, 3.0)
    assert doubts(told) == [{"Drone_T04": "its position changes"}]
    assert any(isinstance(payload, ev.CommandResent) for payload in told)
    stops.release()
    assert not stops.waiting
    assert follow(fleet.checkpoint, stops, 3.0) == []
