"""Stop: every asset is told to hold, and told again until its device has answered."""

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.orchestrator.execution.command_gate import CommandGate
from pa_console.orchestrator.execution.emergency_stop import SAFETY_LIMIT_S, EmergencyStop
from pa_console.orchestrator.station.assembly import Site
from pa_console.orchestrator.station.journal import Journal
from pa_console.schema.command import DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.incident import SetRadio
from pa_console.sim.checkpoint import Checkpoint


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


def test_a_stop_gets_through_once_the_link_is_back(site: Site) -> None:
    sim = Checkpoint(site.world)
    sim.inject(SetRadio(asset="Drone_T01", up=False))
    stops = stops_of(sim)
    list(stops.hold_all())
    follow(sim, stops, 10.0)
    sim.inject(SetRadio(asset="Drone_T01"))
    assert answered(follow(sim, stops, 30.0)) == {"Drone_T01": "done"}
    assert not stops.waiting


def test_stops_of_their_own_each_have_ids_of_their_own(site: Site) -> None:
    stops = stops_of(Checkpoint(site.world))
    held = [payload for _ in range(2) for payload in stops.hold_all()]
    ids = [payload.command.command_id for payload in held if isinstance(payload, ev.CommandSent)]
    assert len(set(ids)) == 2 * len(site.world.assets)


def test_nothing_to_follow_is_nothing_to_wait_for(site: Site) -> None:
    stops = stops_of(Checkpoint(site.world))
    assert list(stops.follow(())) == []
    assert not stops.waiting
