"""`python -m tests.fleets.crowd`: one station and a thousand robots that report twice a second.

The robots are a process of their own with few clients; the station is this one, with its log.
"""

import argparse
import asyncio
import subprocess
import sys
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path
from queue import SimpleQueue
from statistics import quantiles

from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion

from pa_console.fleets.vda5050 import messages
from pa_console.fleets.vda5050.asset_state import state_of
from pa_console.fleets.vda5050.broker import BrokerAddress
from pa_console.fleets.vda5050.mqtt_fleet import MqttFleet
from pa_console.fleets.vda5050.station_link import join
from pa_console.fleets.vda5050.vehicle import Vehicle
from pa_console.fleets.vda5050.wire import Identity, Topic
from pa_console.schema.command import DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.telemetry import AssetTelemetry
from pa_console.schema.world import World
from pa_console.session.log.writer import LogWriter
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.world_generator import generate_world, world_yaml
from pa_console.station.assembly import Site, load_site, open_station
from pa_console.station.clock import DevicesClock
from tests.fleets.broker import address_of, any_broker
from tests.scripted import ScriptedEngine

SITE, MAKER, CLIENTS, PERIOD_S = "crowd", "acme", 4, 0.5
WARM_S, EVERY_S = 6.0, 0.25
NO_ACTION, THEN, NUMBER = '"actionStates":[]', "2020-01-01T00:00:00.000Z", '"headerId":0'


def template(said: AssetTelemetry) -> str:
    """Return the state of a robot that stands, with a time and a number to be replaced."""
    then = datetime(2020, 1, 1, tzinfo=UTC)
    vehicle = Vehicle(Identity(MAKER, said.id), frozenset(), lambda: then)
    text = state_of(said, vehicle, 0, then).write().decode()
    assert NO_ACTION in text
    assert THEN in text
    assert NUMBER in text
    return text


def client_of(address: BrokerAddress) -> Client:
    found = Client(CallbackAPIVersion.VERSION2, protocol=MQTTProtocolVersion.MQTTv5)
    found.connect(address.host, address.port)
    return found


def now_text() -> str:
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z"


class Crowd:
    """Robots that report and acknowledge at once; each client speaks for many of them."""

    def __init__(self, world: World, address: BrokerAddress) -> None:
        said = Checkpoint(world).picture().assets
        self._texts = {name: template(each) for name, each in said.items()}
        self._numbers = dict.fromkeys(said, 0)
        self._client_of = {name: number % CLIENTS for number, name in enumerate(said)}
        self._clients = [client_of(address) for _ in range(CLIENTS)]
        self._orders: SimpleQueue[bytes] = SimpleQueue()
        ear = self._clients[0]
        ear.on_message = self._heard
        ear.subscribe(f"{SITE}/v3/+/+/order", qos=1)
        for client in self._clients:
            client.loop_start()
        for name in said:
            online = messages.RobotConnection(
                header_id=1,
                timestamp=datetime.now(UTC),
                manufacturer=MAKER,
                serial_number=name,
                connection_state="ONLINE",
            )
            topic = str(Topic(SITE, Identity(MAKER, name), "connection"))
            self._clients[0].publish(topic, online.write(), qos=1, retain=True)

    def _heard(self, _client: Client, _data: object, message: MQTTMessage) -> None:
        self._orders.put(bytes(message.payload))

    def run(self) -> None:
        """Report for ever, spread over the period."""
        names = list(self._texts)
        began, sent = time.perf_counter(), 0
        while True:
            due = int((time.perf_counter() - began) / PERIOD_S * len(names))
            for number in range(sent, min(due, sent + len(names))):
                self._tell(names[number % len(names)])
            sent = due
            while not self._orders.empty():
                self._acknowledge(self._orders.get())
            time.sleep(0.002)

    def _acknowledge(self, payload: bytes) -> None:
        order = messages.Order.read(payload)
        action = order.nodes[-1].actions[0]
        state = (
            f'"actionStates":[{{"actionId":"{action.action_id}",'
            f'"actionType":"{action.action_type}","actionStatus":"WAITING"}}]'
        )
        self._tell(order.serial_number, state)

    def _tell(self, name: str, actions: str = NO_ACTION) -> None:
        self._numbers[name] += 1
        text = self._texts[name].replace(THEN, now_text())
        text = text.replace(NUMBER, f'"headerId":{self._numbers[name]}').replace(NO_ACTION, actions)
        topic = f"{SITE}/v3/{MAKER}/{name}/state"
        self._clients[self._client_of[name]].publish(topic, text)


async def measure(site: Site, address: BrokerAddress, seconds: float, folder: Path) -> str:
    """Drive the crowd with a whole station; return what was seen, in words."""
    fleet = MqttFleet(site.world, join(address))
    station = open_station(
        site, ScriptedEngine([]).engine(), DevicesClock(), fleet=fleet, read_unasked=False
    )
    began: dict[str, float] = {}
    took: list[float] = []
    late: list[float] = []
    step = fleet.step

    def watched() -> object:
        received = step()
        now = time.perf_counter()
        known = [r.command_id for r in received.replies if r.status == "acknowledged"]
        took.extend((now - began.pop(name)) * 1e3 for name in known if name in began)
        return received

    fleet.step = watched  # pyright: ignore[reportAttributeAccessIssue]

    async def command() -> None:
        names = list(site.world.assets)
        number = 0
        while True:
            await asyncio.sleep(EVERY_S)
            number += 1
            name = f"m{number}"
            agent = names[number * 37 % len(names)]
            began[name] = time.perf_counter()
            frame = next(iter(site.world.gates))
            fleet.send(DeviceCommand(command_id=name, agent=agent, verb="move_to", target=frame))

    with LogWriter(folder / "log.jsonl", station.session) as log:
        station.write_to(log)
        commands: asyncio.Task[None] | None = None
        start = cpu = 0.0
        stale = ticks = 0
        first = time.perf_counter()
        async for event in station.run():
            now = time.perf_counter()
            if commands is None and now - first > WARM_S:
                commands = asyncio.create_task(command())
                start, cpu, ticks = now, time.process_time(), fleet.tick
            if commands is not None and isinstance(event.data, ev.TelemetryReceived):
                assets = event.data.picture.assets.values()
                stale = max(stale, sum(asset.stale for asset in assets))
                stamps = [event.data.picture.time_s - asset.stamp_s for asset in assets]
                late.append(max(stamps))
            if commands is not None and now - start > seconds:
                break
        used = time.process_time() - cpu
        ran_s = (fleet.tick - ticks) * site.world.dt_s
        wall = time.perf_counter() - start
        if commands is not None:
            commands.cancel()
        await station.close()
        await asyncio.sleep(0.1)
    cuts = quantiles(took, n=20)
    return (
        f"{len(site.world.assets)} vehicles for {wall:.0f} s: {len(took)} commands acknowledged, "
        f"{len(began)} not; p50 {cuts[9]:.0f} ms, p95 {cuts[18]:.0f} ms; station "
        f"{used / wall:.2f} cores; its clock {ran_s / wall:.2f} of the true one; "
        f"at most {stale} stale, the oldest report {max(late):.1f} s, "
        f"{fleet._link.dropped} dropped"  # pyright: ignore[reportPrivateUsage]
    )


def main() -> None:
    """Run what was asked for and print what it came to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--port", type=int, default=0, help="of the broker: be the robots")
    arguments = parser.parse_args()
    world = generate_world(max(arguments.vehicles // 20, 1), arguments.vehicles, 1)
    if arguments.port:
        Crowd(world, BrokerAddress("127.0.0.1", arguments.port, SITE)).run()
        return
    broker = any_broker()
    broker.start()
    words = [sys.executable, "-m", "tests.fleets.crowd", "--port", str(broker.port)]
    robots = subprocess.Popen([*words, "--vehicles", str(arguments.vehicles)])
    try:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "world.yaml"
            file.write_text(world_yaml(world), encoding="utf-8")
            site = load_site(str(file), "checkpoint")
            time.sleep(3.0)
            address = address_of(broker, SITE)
            print(type(broker).__name__)
            print(asyncio.run(measure(site, address, arguments.seconds, Path(folder))))
    finally:
        robots.kill()
        robots.wait()
        broker.kill()


if __name__ == "__main__":
    main()
