"""`python -m tests.fleets.bus_campaign`: latency, a dying broker and floods of hostile messages."""

import argparse
import asyncio
import time
from collections import Counter
from dataclasses import dataclass, field
from datetime import UTC, datetime
from random import Random
from statistics import quantiles
from threading import Event, Thread

from pa_console.fleets.vda5050 import messages
from pa_console.fleets.vda5050.asset_state import state_of
from pa_console.fleets.vda5050.broker import (
    BrokerAddress,
    BusClient,
    IncomingMessage,
    OutgoingMessage,
)
from pa_console.fleets.vda5050.mqtt_fleet import MqttFleet
from pa_console.fleets.vda5050.station_link import join
from pa_console.fleets.vda5050.vehicle import Vehicle
from pa_console.fleets.vda5050.wire import Identity, Numbers, Topic
from pa_console.mission.approval import standing_approver
from pa_console.schema.command import COMMANDS, FINAL_REPLIES, CommandReply, DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Verification
from pa_console.schema.telemetry import AssetTelemetry
from pa_console.schema.world import World
from pa_console.session.state import SessionState
from pa_console.sim.checkpoint import Checkpoint
from pa_console.station.assembly import Site, load_site, open_station
from pa_console.station.clock import DevicesClock
from pa_console.station.headless import run_missions
from tests.fleets.broker import Broker, address_of, any_broker
from tests.fleets.conftest import joined, running
from tests.fleets.test_what_a_station_believes import flood
from tests.scripted import ScriptedEngine, plan

RATE = 2.0


class PromptRobots:
    """One robot an asset that answers at once, each with a client of its own."""

    def __init__(self, world: World, address: BrokerAddress) -> None:
        self._world, self._address = world, address
        self._said = Checkpoint(world).picture().assets
        self._loop, self._up = asyncio.new_event_loop(), Event()
        self._tasks: list[asyncio.Task[None]] = []
        self._waiting = len(world.assets)
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()
        self._up.wait(300)

    def _run(self) -> None:
        self._loop.run_until_complete(self._serve())

    async def _serve(self) -> None:
        for said in self._said.values():
            self._tasks.append(asyncio.create_task(self._robot(said).run()))
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _robot(self, said: AssetTelemetry) -> BusClient:
        identity, numbers = Identity("acme", said.id), Numbers()
        vehicle = Vehicle(identity, frozenset(COMMANDS), now)

        def topic(name: str) -> str:
            return str(Topic(self._address.site, identity, name))

        def tell() -> None:
            number = numbers.header(identity, "state", now())["header_id"]
            state = state_of(said, vehicle, number, now())
            client.send(OutgoingMessage(topic("state"), state.write()))

        def heard(received: IncomingMessage) -> None:
            got = (
                vehicle.take_order(messages.Order.read(received.payload))
                if received.topic.endswith("/order")
                else vehicle.take_actions(messages.InstantActions.read(received.payload))
            )
            for command in got:
                for status in ("acknowledged", "done"):
                    vehicle.hear(
                        CommandReply(
                            command_id=command.command_id,
                            agent=command.agent,
                            status=status,
                            tick=0,
                        )
                    )
                    tell()

        def changed(connected: bool, _why: str) -> None:
            if connected:
                header = numbers.header(identity, "connection", now())
                online = messages.RobotConnection(**header, connection_state="ONLINE")
                client.send(
                    OutgoingMessage(topic("connection"), online.write(), qos=1, retain=True)
                )
                tell()
                self._waiting -= 1
                if self._waiting == 0:
                    self._up.set()

        topics = [topic("order"), topic("instantActions")]
        client = BusClient(self._address, f"robot-{said.id}", heard, changed, topics)
        return client

    def close(self) -> None:
        """Take everybody off the bus."""
        for task in self._tasks:
            self._loop.call_soon_threadsafe(task.cancel)
        self._thread.join(10)


def now() -> datetime:
    return datetime.now(UTC)


def latency(world: World, broker: Broker, count: int) -> tuple[float, float]:
    """Return p50 and p95 of the time from sending to an acknowledgement taken in, milliseconds."""
    address = address_of(broker, "latency")
    robots = PromptRobots(world, address)
    times: list[float] = []
    fleet = MqttFleet(world, join(address))
    names = list(world.assets)
    fleet.step()
    for number in range(count):
        agent = names[number % len(names)]
        command = DeviceCommand(
            command_id=f"m{number}", agent=agent, verb="move_to", target="NorthGate"
        )
        began = time.perf_counter()
        fleet.send(command)
        while not any(r.command_id == command.command_id for r in fleet.step().replies):
            if not fleet.wait(1.0):
                fleet.send(command)
        times.append((time.perf_counter() - began) * 1e3)
    fleet.close()
    robots.close()
    cuts = quantiles(times, n=20)
    return cuts[9], cuts[18]


@dataclass
class Kills:
    """What missions came to while a broker died and came back, `wanted` times."""

    wanted: int
    random: Random
    kills: int = 0
    missions: Counter[str] = field(default_factory=Counter[str])
    sent: int = 0
    executed: Counter[tuple[str, str]] = field(default_factory=Counter[tuple[str, str]])
    lost: list[str] = field(default_factory=list[str])
    false: list[str] = field(default_factory=list[str])
    recovery_s: list[float] = field(default_factory=list[float])

    @property
    def twice(self) -> list[tuple[str, str]]:
        """The commands that a device carried out more than once."""
        return [command for command, times in self.executed.items() if times > 1]

    def summary(self) -> str:
        """Return all of it in words."""
        recovery = " ".join(f"{seconds:.1f}" for seconds in sorted(self.recovery_s))
        return (
            f"{self.kills} kills, {self.sent} commands, missions {dict(self.missions)}; "
            f"carried out twice {len(self.twice)}, lost in silence {len(self.lost)}, "
            f"falsely verified {len(self.false)}; seconds to a fresh picture: {recovery}"
        )


async def broken_sessions(site: Site, broker: Broker, kills: int, seed: int) -> Kills:
    """Run missions one after another while `broker` is killed and started at random moments."""
    world, found = site.world, Kills(kills, Random(seed))
    address = address_of(broker, f"kills{seed}")
    with running(world, address, rate=RATE) as service:
        device = service.site.checkpoint
        watch_devices(device, found)
        while found.kills < kills:
            with joined(world, address) as fleet:
                await one_session(site, fleet, device, broker, found)
    return found


def watch_devices(checkpoint: Checkpoint, found: Kills) -> None:
    """Count how often each command begins to be carried out."""
    step, seen = checkpoint.step, set[tuple[str, str, int]]()

    def watched() -> list[CommandReply]:
        replies = step()
        for reply in replies:
            begun = (reply.agent, reply.command_id, reply.tick)
            if reply.status == "acknowledged" and begun not in seen:
                seen.add(begun)
                found.executed[reply.agent, reply.command_id] += 1
        return replies

    checkpoint.step = watched  # pyright: ignore[reportAttributeAccessIssue]


async def one_session(
    site: Site, fleet: MqttFleet, device: Checkpoint, broker: Broker, found: Kills
) -> None:
    """Run a session of missions; kill the broker now and then."""
    kills, random = found.wanted, found.random
    agents = {"Drone_T04": "drone", "Ugv_T02": "ugv", "Robot_T02": "robot"}
    orders = [
        (agent, gate)
        for agent, gate in zip(
            random.choices(list(agents), k=3), random.choices(world_gates(site), k=3), strict=True
        )
    ]
    answers = [plan((agent, f"move_to {gate}")) for agent, gate in orders]
    station = open_station(
        site, ScriptedEngine(answers).engine(), DevicesClock(RATE), fleet=fleet, read_unasked=False
    )
    sent: dict[str, DeviceCommand] = {}
    ended: set[str] = set()
    stop = asyncio.Event()

    def sink(event: ev.Event, _: SessionState) -> None:
        match event.data:
            case ev.CommandSent(command=command):
                sent[command.command_id] = command
            case ev.CommandReplied(reply=reply) if reply.status in FINAL_REPLIES:
                ended.add(reply.command_id)
            case ev.PlanHalted():
                ended.update(sent)
            case ev.MissionVerified(verification=verification):
                check(verification, device, found)
            case _:
                pass

    async def dying() -> None:
        while not stop.is_set() and found.kills < kills:
            await asyncio.sleep(random.uniform(1.0, 6.0))
            await asyncio.to_thread(broker.kill)
            found.kills += 1
            await asyncio.sleep(random.uniform(0.0, 1.5))
            await asyncio.to_thread(broker.start)
            began = time.perf_counter()
            while not (heard_all(fleet) or stop.is_set()):
                await asyncio.sleep(0.02)
            if not stop.is_set():
                found.recovery_s.append(time.perf_counter() - began)

    killer = asyncio.create_task(dying())
    texts = [f"Move {agent} to the {words(gate)}." for agent, gate in orders]
    traces = await run_missions(station, texts, standing_approver("auto", "campaign"), sink)
    stop.set()
    await killer
    found.sent += len(sent)
    found.lost += [name for name in sent if name not in ended]
    found.missions.update(trace.status or "none" for trace in traces)


def heard_all(fleet: MqttFleet) -> bool:
    """Return whether the picture has fresh news of every asset."""
    assets = fleet.picture().assets.values()
    return all(asset.comms != "lost" and not asset.stale for asset in assets)


def check(verification: Verification, device: Checkpoint, found: Kills) -> None:
    """Note an action that is held for done though its asset is not where it was sent."""
    truth = device.truth().assets
    for action in verification.actions:
        target = action.command.removeprefix("move_to ")
        claimed = action.outcome == "pass" and target != action.command
        if claimed and truth[action.agent].at != target:
            found.false.append(f"{action.agent} {action.command}: {truth[action.agent].at}")


def world_gates(site: Site) -> list[str]:
    return list(site.world.gates)


def words(gate: str) -> str:
    return gate.removesuffix("Gate").lower() + " gate"


def main() -> None:
    """Run what was asked for and print what it came to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--commands", type=int, default=0, help="for the latency")
    parser.add_argument("--kills", type=int, default=0)
    parser.add_argument("--hostile", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    site = load_site("checkpoint", "checkpoint")
    broker = any_broker()
    broker.start()
    print(type(broker).__name__)
    try:
        if arguments.commands:
            p50, p95 = latency(site.world, broker, arguments.commands)
            print(f"{arguments.commands} commands: p50 {p50:.1f} ms, p95 {p95:.1f} ms")
        if arguments.hostile:
            address = address_of(broker, "hostile")
            lines = flood(site.world, address, arguments.hostile, arguments.seed)
            print(f"{arguments.hostile} hostile messages: {lines} lines told, the picture is true")
        if arguments.kills:
            found = asyncio.run(broken_sessions(site, broker, arguments.kills, arguments.seed))
            print(found.summary())
            print(*found.false, *found.lost, *found.twice, sep="\n")
    finally:
        broker.kill()


if __name__ == "__main__":
    main()
