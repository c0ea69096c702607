"""`python -m tests.fleets.stop_campaign`: STOP over a real broker, in random histories.

Each history has two sessions on one site, orders and stops, and some of: a takeover, a flood, deaf
and lying robots, reconnects, a broker that is killed. Positions are the simulation's own.
"""

import argparse
import asyncio
import math
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Generator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from random import Random
from socket import SHUT_RDWR
from typing import Any

from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion

from pa_console.fleets.vda5050.broker import BrokerAddress
from pa_console.fleets.vda5050.gateway import Gateway
from pa_console.fleets.vda5050.messages import InstantActions
from pa_console.fleets.vda5050.mqtt_fleet import MqttFleet
from pa_console.fleets.vda5050.site_fleet import fleet_of
from pa_console.fleets.vda5050.station_link import join
from pa_console.fleets.vda5050.wire import Header
from pa_console.mission.gate import CommandGate
from pa_console.mission.rehearse import device_commands
from pa_console.mission.stop import EmergencyStop
from pa_console.policy.rulebook import Rulebook
from pa_console.resources import find_data
from pa_console.schema.command import CommandReply, DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision
from pa_console.schema.plan import Action, Plan
from pa_console.schema.world import World
from pa_console.session.log.journal import Journal
from pa_console.session.log.writer import LogWriter
from pa_console.sim.worlds.world_file import load_world
from pa_console.station.assembly import load_site, open_station
from pa_console.station.clock import DevicesClock
from pa_console.station.station import ControlStation
from tests.fleets.broker import Broker, Lossy, address_of, any_broker
from tests.fleets.conftest import SHA, RunningSite, running
from tests.scripted import ScriptedEngine, plan

RATE = 2.0
"""Seconds at the site in one."""
GRACE_S = 0.5
"""Seconds of running from STOP until a reachable asset stands: 250 ms, and a busy machine."""
STALL_S = 0.1
"""A longer step was a stall: the machine did not run the process of site and station."""
WATCH_S, NAMED_S, LIE_S = 1.5, 1.5, 6.0
"""Real seconds of watching; seconds of the fleet until one in doubt, or a liar, is named."""
UNNAMED_S = 2.0
"""Seconds from a press until a robot without a hold must be named: 1 s, a picture, and slack."""
BACK_S = 4.0
"""Real seconds more that are given to a broker that was killed, and to robots that reconnect."""
STOOD_M = 0.05
RULES = Rulebook("none", "", ())
Position = tuple[float, float]


def fleet_at(address: BrokerAddress, world: World, sha256: str = SHA) -> MqttFleet:
    """Join the site, again if the broker has lost what says that it runs."""
    while True:
        found = join(address)
        try:
            return fleet_of(found, world, sha256)
        except ValueError:
            found.link.close()


class Session:
    """What a station does of ordering and stopping, in the fleet's own time."""

    def __init__(self, world: World, address: BrokerAddress) -> None:
        self.fleet: MqttFleet = fleet_at(address, world)
        self.gate = CommandGate(self.fleet, Journal())
        self.stops = EmergencyStop(self.fleet, self.gate)
        self.named: dict[str, float] = {}
        """When each asset was first in doubt after STOP, on the fleet's clock."""
        self.doubted: set[str] = set()
        self.pressed_s = math.inf
        self._due, self._orders = time.perf_counter(), 0

    def step(self) -> None:
        """Wait until the next step is due, and take it."""
        self._due = max(self._due + self.fleet.world.dt_s / RATE, time.perf_counter() - 0.2)
        time.sleep(max(self._due - time.perf_counter(), 0.0))
        received = self.fleet.step()
        for event in self.stops.step((self.fleet.tick, received.replies)):
            self._note(event)

    def go(self, seconds: float) -> None:
        """Let real time pass."""
        until = time.perf_counter() + seconds
        while time.perf_counter() < until:
            self.step()

    def run(self, seconds: float) -> float:
        """Let so much time pass without counting stalls; return the longest of them, in seconds."""
        longest_s = 0.0
        while seconds > 0.0:
            began = time.perf_counter()
            self.step()
            took_s = time.perf_counter() - began
            longest_s = max(longest_s, took_s)
            seconds -= min(took_s, STALL_S)
        return longest_s if longest_s > STALL_S else 0.0

    def order(self, agent: str, gate: str) -> None:
        """Let an approved plan of one command go out."""
        self._orders += 1
        request = ev.ApprovalRequested(
            request_id=f"M{self._orders}.1",
            attempt=1,
            plan=Plan(reason="r", actions=(Action(agent=agent, command=f"move_to {gate}"),)),
        )
        self.gate.grant(request, Decision(kind="approve"), RULES)
        self.gate.send(device_commands(request.plan, request.request_id), lambda _: None)

    def stop(self) -> None:
        """Press STOP."""
        self.pressed_s = self.fleet.time_s
        for event in self.stops.hold_all():
            self._note(event)

    def _note(self, event: ev.EventPayload) -> None:
        if isinstance(event, ev.StopUnconfirmed):
            self.doubted = set(event.assets)
            for name in event.assets:
                self.named.setdefault(name, self.fleet.time_s)


@contextmanager
def deaf(gateway: Gateway) -> Generator[None]:
    """Let a robot hear orders and no stop."""
    take = gateway._take  # pyright: ignore[reportPrivateUsage]

    def hear(message: Header) -> None:
        if not isinstance(message, InstantActions):
            take(message)

    gateway._take = hear  # pyright: ignore[reportPrivateUsage]
    yield
    del gateway._take  # pyright: ignore[reportPrivateUsage]


@contextmanager
def lying(gateway: Gateway) -> Generator[None]:
    """Let a robot answer every stop as done at once, and drive on."""
    forward = gateway._forward  # pyright: ignore[reportPrivateUsage]

    def answer(command: DeviceCommand) -> None:
        if command.verb != "hold":
            forward(command)
            return
        done = CommandReply(
            command_id=command.command_id, agent=command.agent, status="done", tick=0
        )
        gateway.vehicle.hear(done)

    gateway._forward = answer  # pyright: ignore[reportPrivateUsage]
    yield
    gateway._forward = forward  # pyright: ignore[reportPrivateUsage]


POUR = """
import json, sys, time
from datetime import UTC, datetime
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion
from paho.mqtt.subscribeoptions import SubscribeOptions
host, port, site, name, kind = sys.argv[1:]
client = Client(CallbackAPIVersion.VERSION2, protocol=MQTTProtocolVersion.MQTTv5)
heard = {}
def note(_client, _data, message):
    if message.topic.split('/')[3] != 'site':
        heard[message.topic] = json.loads(message.payload)
client.on_message = note
client.connect(host, int(port))
if kind == "retained":
    alone = SubscribeOptions(qos=0, noLocal=True)
    client.subscribe([(f"{site}/v3/+/+/{topic}", alone) for topic in ("state", "connection")])
client.loop_start()
def lie():
    for topic, said in list(heard.items()):
        if "agvPosition" in said:
            said["agvPosition"] |= {"x": 0.0, "y": 0.0}
        if "connectionState" in said:
            said["connectionState"] = "OFFLINE"
        said["headerId"] += 1_000_000
        client.publish(topic, json.dumps(said), qos=1, retain=True)
garbage = b'{"headerId": 1, "contacts": [' + b'{"signature": "x"}, ' * 5_700 + b"{}]}"
number = 0
while True:
    number += 1
    payload = garbage
    if kind == "retained":
        lie()
        time.sleep(0.2)
        continue
    if kind == "phantoms":
        now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z"
        contacts = [
            {"signature": f"p{each}", "kind": "vehicle", "x": each % 30 - 15.0,
             "y": 40.0 + each % 9, "sigmaM": 1.0, "identity": "unauthorized", "opinion": "hostile"}
            for each in range(900)
        ]
        header = {"headerId": number, "timestamp": now, "version": "3.0.0",
                  "manufacturer": "pa-console", "serialNumber": name}
        payload = json.dumps({**header, "contacts": contacts}).encode()
    client.publish(f"{site}/v3/pa-console/{name}/detections", payload)
    time.sleep(0.1 if kind == "phantoms" else 0.005)
"""


@contextmanager
def flood(address: BrokerAddress, name: str, kind: str = "garbage") -> Generator[None]:
    """Let a process send much in the name of a robot.

    That is 200 messages of 114 KB of garbage a second, 10 a second with 900 phantom contacts, or,
    five times a second, a retained state and last will of every robot that are not true.
    """
    words = [address.host, str(address.port), address.site, name, kind]
    process = subprocess.Popen([sys.executable, "-c", POUR, *words], stderr=subprocess.DEVNULL)
    yield
    process.kill()
    process.wait()


@dataclass
class Outcome:
    """What the histories came to."""

    histories: int = 0
    stops: int = 0
    kinds: Counter[str] = field(default_factory=Counter[str])
    farthest_m: float = 0.0
    """The farthest that a reachable asset has driven after STOP."""
    drove_on: list[str] = field(default_factory=list[str])
    unnamed: list[str] = field(default_factory=list[str])
    slowest_named_s: float = 0.0
    longest_stall_s: float = 0.0
    """The longest time after STOP in which the machine did not run site and station."""
    false_alarms: int = 0
    """Histories without any fault in which an asset was named all the same."""

    def add(self, other: "Outcome") -> None:
        """Take in what other histories came to."""
        self.histories += other.histories
        self.stops += other.stops
        self.kinds += other.kinds
        self.farthest_m = max(self.farthest_m, other.farthest_m)
        self.longest_stall_s = max(self.longest_stall_s, other.longest_stall_s)
        self.slowest_named_s = max(self.slowest_named_s, other.slowest_named_s)
        self.drove_on += other.drove_on
        self.unnamed += other.unnamed
        self.false_alarms += other.false_alarms

    def summary(self) -> str:
        """Return all of it in words."""
        kinds = ", ".join(f"{name} {count}" for name, count in sorted(self.kinds.items()))
        return (
            f"{self.histories} histories, {self.stops} stops ({kinds}): "
            f"{len(self.drove_on)} reachable assets drove on, farthest {self.farthest_m:.1f} m; "
            f"{len(self.unnamed)} in doubt were not named, slowest {self.slowest_named_s:.2f} s; "
            f"named without a fault in {self.false_alarms} histories; "
            f"longest stall {self.longest_stall_s:.2f} s"
        )


class History:
    """One random history on a running site."""

    def __init__(self, world: World, site: RunningSite, broker: Broker, seed: int) -> None:
        self.world, self.site, self.broker, self.random = world, site, broker, Random(seed)
        self.name = f"history {seed}"
        self.address = next(iter(site.site.robots.values())).client.address
        self.out = Outcome(histories=1)

    def run(self) -> Outcome:
        """Play it; return what it came to."""
        random, names = self.random, list(self.world.assets)
        with ExitStack() as faults:
            faulty = set(random.sample(names, random.choice((0, 0, 1, 2, 3))))
            deaf_ones = {name for name in sorted(faulty) if random.random() < 0.5}
            liars = faulty - deaf_ones
            first = Session(self.world, self.address)
            self._drive(first)
            if random.random() < 0.6:
                first.stop()
                self.out.stops += 1
                first.go(random.uniform(0.0, 0.4))
            takeover = random.random() < 0.4
            if not takeover:
                first.fleet.close()
            second = Session(self.world, self.address)
            self._drive(second)
            for name in sorted(faulty):
                robot = self.site.site.robots[name]
                faults.enter_context(deaf(robot) if name in deaf_ones else lying(robot))
            self.out.kinds += Counter(deaf=len(deaf_ones), lying=len(liars), takeover=takeover)
            if random.random() < 0.2:
                flooder = random.choice(names)
                faults.enter_context(flood(self.address, flooder))
                self.out.kinds["flood"] += 1
                second.go(1.0)
            self._stop(second, deaf_ones, liars)
            for session in (second, *((first,) if takeover else ())):
                session.fleet.close()
        return self.out

    def _drive(self, session: Session) -> None:
        """Let some assets set out."""
        random = self.random
        session.go(random.uniform(0.15, 0.4))
        for name in random.sample(list(self.world.assets), random.randrange(2, 6)):
            session.order(name, random.choice(list(self.world.gates)))
        session.go(random.uniform(0.1, 0.5))

    def _stop(self, session: Session, deaf_ones: set[str], liars: set[str]) -> None:
        """Press STOP, watch, and judge."""
        random = self.random
        killed = random.random() < 0.15
        cut = set[str]()
        if not killed and random.random() < 0.2:
            cut = set(random.sample(list(self.world.assets), random.randrange(1, 3)))
            self.out.kinds["reconnect"] += 1
            self._break(cut)
        if killed:
            self.broker.kill()
            self.out.kinds["broker killed"] += 1
        before = self._positions()
        session.stop()
        self.out.stops += 1
        self.out.longest_stall_s = session.run(GRACE_S)
        stood = self._positions()
        if killed:
            session.go(random.uniform(0.0, 0.6))
            self.broker.start()
        session.go(WATCH_S if not killed and not cut else BACK_S)
        settled = self._positions()
        session.go(0.5)
        end = self._positions()
        lost = set(self.world.assets) if killed else cut
        faulty = deaf_ones | liars
        for name in self.world.assets:
            if name in faulty:
                continue
            first, last = (settled, end) if name in lost else (stood, end)
            away = name in lost and name in session.doubted
            if math.dist(first[name], last[name]) > STOOD_M and not away:
                far_m = math.dist(first[name], last[name])
                said = ", ".join(sorted(+self.out.kinds))
                self.out.drove_on.append(f"{self.name} ({said}): {name} drove on {far_m:.1f} m")
            if name not in lost:
                driven = math.dist(before[name], end[name])
                self.out.farthest_m = max(self.out.farthest_m, driven)
        moving_liars = {name for name in liars if math.dist(stood[name], end[name]) > 3.0}
        self._judge_names(session, deaf_ones, moving_liars, lost)
        if not (faulty or lost) and session.named and not self.out.kinds["flood"]:
            self.out.false_alarms += 1

    def _judge_names(
        self, session: Session, deaf_ones: set[str], moving_liars: set[str], lost: set[str]
    ) -> None:
        """Note who was not named in time."""
        # One that was away for a moment may have heard STOP all the same: then it is no doubt.
        expected = dict.fromkeys(deaf_ones, NAMED_S)
        expected |= {name: LIE_S for name in moving_liars if name not in lost}
        if len(lost) == len(self.world.assets):
            expected |= dict.fromkeys(lost, NAMED_S)
        for name, within_s in expected.items():
            after_s = session.named.get(name, math.inf) - session.pressed_s
            if after_s > within_s + 1e-6:
                self.out.unnamed.append(f"{self.name}: {name} named after {after_s:.2f} s")
            elif name not in moving_liars:
                self.out.slowest_named_s = max(self.out.slowest_named_s, after_s)

    def _break(self, names: set[str]) -> None:
        """Break the connections of robots; their clients connect again by themselves."""
        loop = self.site._loop  # pyright: ignore[reportPrivateUsage]
        for name in names:
            client = self.site.site.robots[name].client._client  # pyright: ignore[reportPrivateUsage]
            if client is None:
                continue
            opened: Any = client._client.socket()  # pyright: ignore[reportPrivateUsage]
            if opened is not None:
                loop.call_soon_threadsafe(opened.shutdown, SHUT_RDWR)

    def _positions(self) -> dict[str, Position]:
        assets = self.site.site.checkpoint._scene.assets  # pyright: ignore[reportPrivateUsage]
        return {name: asset.position for name, asset in assets.items()}


def play(histories: int, seed: int) -> Outcome:
    """Play histories one after another on one site and one broker; return what they came to."""
    world = load_world(find_data("worlds", "checkpoint", "world.yaml"))
    broker, out = any_broker(), Outcome()
    broker.start()
    try:
        with running(world, address_of(broker, f"stop{seed}"), rate=RATE) as site:
            until = time.monotonic() + 300.0
            while not site.site._site.client.connected:  # pyright: ignore[reportPrivateUsage]
                if time.monotonic() > until:
                    raise TimeoutError("the site did not come up")
                time.sleep(0.05)
            for number in range(histories):
                out.add(History(world, site, broker, seed + number).run())
    finally:
        broker.kill()
    return out


class Pressed:
    """A whole station on a site of another process; STOP is pressed there at random moments."""

    def __init__(
        self, address: BrokerAddress, presses: int, seed: int, ears: BrokerAddress | None = None
    ) -> None:
        """`ears` is where the wire is listened to, if not at `address`."""
        self._address, self._presses, self._random = address, presses, Random(seed)
        self._ears = ears or address
        self._site = load_site("checkpoint", "checkpoint")
        self._stop = b""
        """What the action ids of the holds of the latest stop have in them."""
        self._holds: dict[str, float] = {}
        """When the hold of each robot was on the wire."""
        self.took_ms: list[float] = []
        self.first_ms: list[float] = []
        """The time from each press to the first hold of all robots, ms."""
        self.unconfirmed: set[str] = set()
        self.unnamed = 0
        """Robots that had no hold for two seconds of which nothing was said."""

    async def run(self) -> list[float]:
        """Return the time from each press that was due to the last hold on the wire, sorted, ms."""
        ear = Client(CallbackAPIVersion.VERSION2, protocol=MQTTProtocolVersion.MQTTv5)
        ear.on_message = self._note
        ear.connect(self._ears.host, self._ears.port)
        ear.subscribe(f"{self._ears.site}/v3/+/+/instantActions", qos=1)
        ear.loop_start()
        engine = ScriptedEngine([plan()]).engine()
        fleet = fleet_at(self._address, self._site.world, self._site.world_sha256)
        station = open_station(
            self._site, engine, DevicesClock(), fleet=fleet, respond=True, read_unasked=False
        )
        with (
            tempfile.TemporaryDirectory() as folder,
            LogWriter(Path(folder) / "log.jsonl", station.session) as log,
        ):
            station.write_to(log)
            pressing = asyncio.create_task(self._press(station))
            async for event in station.run():
                if isinstance(event.data, ev.StopUnconfirmed):
                    self.unconfirmed |= set(event.data.assets)
            await pressing
        ear.disconnect()
        ear.loop_stop()
        return sorted(self.took_ms)

    async def _press(self, station: ControlStation) -> None:
        loop = asyncio.get_running_loop()
        await asyncio.sleep(3.0)
        for number in range(1, self._presses + 1):
            wait_s = self._random.uniform(0.3, 0.8)
            due = time.perf_counter() + wait_s
            # A hold of the stop before, sent again, may still be on its way.
            self._stop, self._holds = f".stop{number}.".encode(), {}
            self.unconfirmed.clear()
            loop.call_later(wait_s, station.stop_all)
            while len(self._holds) < len(self._site.world.assets):
                await asyncio.sleep(0.01)
                without = set(self._site.world.assets) - set(self._holds) - self.unconfirmed
                late = time.perf_counter() > due + UNNAMED_S
                self.unnamed += len(without) if late else 0
            self.took_ms.append((max(self._holds.values()) - due) * 1e3)
            self.first_ms.append((min(self._holds.values()) - due) * 1e3)
            station.release()
        await station.close()

    def _note(self, _client: Client, _data: object, message: MQTTMessage) -> None:
        if b"startPause" in message.payload and self._stop in message.payload:
            self._holds.setdefault(message.topic.split("/")[3], time.perf_counter())


FLOODS = ("none", "garbage", "phantoms", "retained", "half lost")


def press(presses: int, seed: int, floods: Sequence[str]) -> None:
    """Press STOP many times under each flood; print how long the last hold took to be sent."""
    for kind in floods:
        broker = any_broker()
        broker.start()
        address = address_of(broker, "press")
        words = [sys.executable, "-m", "pa_console", "site", "--broker", str(address)]
        site = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            while (found := join(address)).site is None:
                found.link.close()
            found.link.close()
            with ExitStack() as faults:
                by = address
                if kind == "half lost":
                    by = address_of(faults.enter_context(Lossy(broker, 0.5, seed)), "press")
                elif kind != "none":
                    faults.enter_context(flood(address, "Drone_T02", kind))
                pressed = Pressed(by, presses, seed, ears=address)
                took = asyncio.run(pressed.run())
        finally:
            site.kill()
            site.wait()
            broker.kill()
        for of, times in (("last", took), ("first", sorted(pressed.first_ms))):
            share = {name: times[min(int(part * len(times)), len(times) - 1)]
                     for name, part in (("p50", 0.5), ("p99", 0.99))}  # fmt: skip
            words = ", ".join(f"{name} {value:.0f} ms" for name, value in share.items())
            print(f"{presses} presses, {kind}, {of} hold: {words}, most {times[-1]:.0f} ms")
        print(f"{presses} presses, {kind}: without a hold and not named {pressed.unnamed}")


def main() -> None:
    """Play as many histories as are asked for, in several processes; print what they came to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--histories", type=int, default=100)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--batch", type=int, default=10)
    parser.add_argument("--presses", type=int, default=0, help="time STOP under floods instead")
    parser.add_argument("--floods", nargs="+", choices=FLOODS, default=FLOODS)
    given = parser.parse_args()
    if given.presses:
        press(given.presses, given.seed, given.floods)
        return
    starts = range(given.seed, given.seed + given.histories, given.batch)
    out = Outcome()
    with ProcessPoolExecutor(
        given.workers, mp_context=get_context("spawn"), max_tasks_per_child=1
    ) as pool:
        jobs = [
            pool.submit(play, min(given.batch, given.seed + given.histories - start), start)
            for start in starts
        ]
        for job in as_completed(jobs):
            batch = job.result()
            out.add(batch)
            print(*batch.drove_on, *batch.unnamed, sep="\n", end="\n" * bool(batch.drove_on))
            print(f"{out.histories} of {given.histories}: {out.summary()}", flush=True)


if __name__ == "__main__":
    main()
