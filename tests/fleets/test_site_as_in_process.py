"""What a station sees of a site on a bus is what it sees of the same simulation in its process."""

from datetime import datetime, timedelta
from itertools import pairwise
from math import dist

import pytest

from pa_console.fleets.fleet import Fleet, Simulated
from pa_console.fleets.simulated import SimulatedFleet
from pa_console.fleets.vda5050 import simulated_site
from pa_console.fleets.vda5050.broker import LOOPBACK, BrokerAddress
from pa_console.fleets.vda5050.simulated_site import SimulatedSite, SiteOptions
from pa_console.schema.command import DeviceCommand, Verb
from pa_console.schema.incident import (
    FailAsset,
    FalseContact,
    GpsDrift,
    Incident,
    PlaceAsset,
    SensorFault,
    SetComms,
    SetWeather,
    SpawnTrack,
)
from pa_console.schema.telemetry import AssetTelemetry
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from tests.fleets.conftest import joined, running
from tests.fleets.scripted_link import EPOCH

STEPS = 300
Script = dict[int, DeviceCommand | Incident]


def command(number: int, agent: str, verb: Verb, target: str | None = None) -> DeviceCommand:
    return DeviceCommand(command_id=f"c{number}", agent=agent, verb=verb, target=target)


SCRIPTS: dict[str, Script] = {
    "moves": {
        0: command(0, "Robot_T01", "move_to", "WestGate"),
        5: command(1, "Drone_T04", "move_to", "EastGate"),
        6: command(2, "Ugv_T02", "block", "NorthGate"),
        7: command(3, "Robot_T02", "report"),
        40: command(4, "Drone_T04", "hold"),
        60: command(5, "Drone_T04", "observe", "SouthGate"),
        80: command(6, "Ugv_T02", "return_to_base"),
    },
    "refusals": {
        5: command(1, "Drone_T04", "move_to", "Nowhere"),
        6: command(2, "Robot_T01", "hold"),
        9: FailAsset(asset="Ugv_T01"),
        20: command(3, "Ugv_T01", "move_to", "NorthGate"),
    },
    "encounter": {
        3: SpawnTrack(gate="WestGate", distance_m=60.0, intent="hostile"),
        30: command(1, "Robot_T01", "identify", "WestGate"),
    },
    "set-up": {
        0: PlaceAsset(asset="Drone_T04", frame="EastGate"),
        1: FailAsset(asset="Ugv_T02"),
        30: command(1, "Drone_T04", "observe", "NorthGate"),
    },
    "disturbances": {
        4: SetWeather(weather="fog"),
        5: SensorFault(sensor="WestCamera") ,
        6: GpsDrift(asset="Drone_T01", rate_mps=1.0),
        7: SetComms(asset="Ugv_T01", comms="lost"),
        8: FalseContact(gate="NorthGate"),
        90: command(1, "Ugv_T01", "move_to", "NorthGate"),
        200: SetComms(asset="Ugv_T01", comms="ok"),
    },
}  # fmt: skip


def play(fleet: Fleet, script: Script) -> list[tuple[object, ...]]:
    """Play `script` and return all replies of `fleet`, those to holds without their moment.

    On a bus a hold is done a report later: once one shows that the asset stands.
    """
    told: list[tuple[object, ...]] = []
    holds = {
        entry.command_id
        for entry in script.values()
        if isinstance(entry, DeviceCommand) and entry.verb == "hold"
    }
    held: dict[str, tuple[str, str]] = {}
    for tick in range(STEPS):
        match script.get(tick):
            case DeviceCommand() as sent:
                fleet.send(sent)
            case None:
                pass
            case incident:
                assert isinstance(fleet, Simulated)
                fleet.inject(incident)
        for reply in fleet.step().replies:
            if reply.command_id in holds:
                held[reply.command_id] = (reply.status, reply.detail)
            else:
                told.append((fleet.tick, reply.command_id, reply.status, reply.detail))
    return [*told, *held.items()]


@pytest.mark.parametrize("name", SCRIPTS)
def test_replies_and_picture_are_the_same(name: str, world: World, address: BrokerAddress) -> None:
    script = {
        tick: SensorFault(sensor=next(iter(world.cameras)))
        if isinstance(entry, SensorFault)
        else entry
        for tick, entry in SCRIPTS[name].items()
    }
    twin = SimulatedFleet.start(world, seed=1)
    with running(world, address, paced=True), joined(world, address) as fleet:
        assert isinstance(fleet, Simulated)
        assert (fleet.seed, fleet.tick) == (1, 0)
        assert play(fleet, script) == play(twin, script)
        assert fleet.picture() == twin.picture()


def test_steps_that_are_made_late_have_the_times_at_which_they_were_due(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A site held up for a second catches up at once, and no asset seems to race meanwhile."""
    rate, checkpoint = 2.0, Checkpoint(world, 1)
    checkpoint.send(command(1, "Drone_T04", "move_to", "WestGate"))
    for _ in range(30):
        checkpoint.step()
    site = SimulatedSite(checkpoint, BrokerAddress(LOOPBACK, 1), SiteOptions("0" * 64, rate=rate))
    reports = list[tuple[datetime, tuple[float, float]]]()

    def reported(said: AssetTelemetry, sent: datetime) -> None:
        reports.append((sent, said.position))

    monkeypatch.setattr(site.robots["Drone_T04"], "report", reported)
    now = [EPOCH]

    def each_look_takes_time() -> datetime:
        now[0] += timedelta(seconds=0.01)
        return now[0]

    monkeypatch.setattr(simulated_site, "utc_now", each_look_takes_time)
    made = now[0]
    for held_up_s in (1.0, 0.1, 0.4, 0.0, 3.0):
        now[0] += timedelta(seconds=held_up_s)
        made = site._catch_up(made)  # pyright: ignore[reportPrivateUsage]
    assert len(reports) > 8
    most_mps = rate * world.platforms["uav"].speed_mps
    for (sent, at), (later, there) in pairwise(reports):
        assert dist(at, there) <= 1.1 * most_mps * (later - sent).total_seconds() + 1.0
