"""A station that is killed at any write to the disk has sent nothing that its log does not tell."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from pa_console.fleets.vda5050.broker import BrokerAddress
from pa_console.schema.world import World
from tests.fleets.conftest import running
from tests.fleets.intruder import intruder

STATION = """
import asyncio, os, sys
from datetime import UTC, datetime
from pathlib import Path

from pa_console.fleets.vda5050.broker import BrokerAddress
from pa_console.fleets.vda5050.station_link import join
from pa_console.fleets.vda5050.site_fleet import fleet_of
from pa_console.mission.gate import CommandGate
from pa_console.mission.rehearse import device_commands
from pa_console.session.log.journal import Journal
from pa_console.policy.rulebook import Rulebook
from pa_console.resources import find_data
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision
from pa_console.schema.plan import Action, Plan
from pa_console.session.log.writer import LogWriter
from pa_console.sim.worlds.world_file import load_world

url, log, left = sys.argv[1], Path(sys.argv[2]), int(sys.argv[3])
sync = os.fsync


def sync_or_die(number):
    global left
    left -= 1
    if left == 0:
        os._exit(9)
    sync(number)


async def main():
    world = load_world(find_data("worlds", "checkpoint", "world.yaml"))
    fleet = fleet_of(join(BrokerAddress.parse(url)), world, "0" * 64)
    journal = Journal()
    orders = (("Drone_T04", "move_to EastGate"), ("Ugv_T02", "move_to NorthGate"))
    actions = tuple(Action(agent=agent, command=command) for agent, command in orders)
    rules = Rulebook("none", "", ())
    with LogWriter(log, "S") as writer:
        journal.open(writer, print)
        os.fsync = sync_or_die
        gate = CommandGate(fleet, journal)

        def emit(payload):
            journal.append(ev.Event(t=datetime.now(UTC), tick=0, data=payload))

        for number in range(1, 4):
            request = ev.ApprovalRequested(
                request_id=f"M{number}.1", attempt=1, plan=Plan(reason="r", actions=actions)
            )
            gate.grant(request, Decision(kind="approve"), rules)
            gate.send(device_commands(request.plan, request.request_id), emit)
    fleet.close()


asyncio.run(main())
"""


@pytest.mark.parametrize("dies_at", [1, 2, 3, 4, 99])
def test_whenever_it_is_killed_every_order_on_the_wire_is_in_the_log(
    dies_at: int, world: World, address: BrokerAddress, tmp_path: Path
) -> None:
    log = tmp_path / "log.jsonl"
    with running(world, address), intruder(address) as ear:
        words = [sys.executable, "-c", STATION, str(address), str(log), str(dies_at)]
        ended = subprocess.run(words, check=False)
        assert ended.returncode == (0 if dies_at == 99 else 9)
        ear.send(f"{address.site}/last", b"")  # what the station had sent has come by then
        while f"{address.site}/last" not in ear.heard:
            pass
    heard = {
        json.loads(payload)["orderId"].split(".", 1)[1]
        for topic, payload in ear.all
        if topic.endswith("/order")
    }
    logged = {
        line["data"]["command"]["command_id"]
        for line in map(json.loads, log.read_text().splitlines())
        if line.get("kind", line.get("data", {}).get("kind")) == "command_sent"
    }
    assert heard <= logged
    assert dies_at < 99 or len(heard) == 6
