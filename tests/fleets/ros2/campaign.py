"""`python -m tests.fleets.ros2.campaign`: latency, cut cables, hostile messages, STOP, crowds."""

import argparse
import asyncio
import math
import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from statistics import quantiles
from tempfile import TemporaryDirectory
from typing import Any

import zenoh

from pa_console.fleets.linked_fleet import LinkedFleet
from pa_console.fleets.ros2.link import Ros2Link, open_link
from pa_console.mission.approval import standing_approver
from pa_console.mission.gate import CommandGate
from pa_console.mission.rehearse import device_commands
from pa_console.mission.stop import EmergencyStop
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.command import FINAL_REPLIES, DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision, Verification
from pa_console.schema.plan import Action, Plan
from pa_console.schema.world import AssetSpec, World
from pa_console.session.log.writer import Journal
from pa_console.session.state import SessionState
from pa_console.settings.schema import Settings
from pa_console.station.assembly import Site, load_site, open_station
from pa_console.station.clock import DevicesClock
from pa_console.station.headless import run_missions
from tests.fleets.ros2.counterpart import FRAMES, Cable, Listener, Robots
from tests.fleets.ros2.test_ros2_link import hostile
from tests.fleets.ros2.test_ros2_messages import WRITTEN
from tests.scripted import ScriptedEngine, plan

GATES = ("NorthGate", "EastGate", "SouthGate", "WestGate")
MOVERS = {"Drone_T04": 12.0, "Ugv_T02": 4.0, "Robot_T02": 1.5}


def places(world: World, names: list[str]) -> dict[str, tuple[float, float]]:
    """Return where assets begin their watch."""
    return {name: world.frames[world.assets[name].post].at for name in names}


def linked(port: int, world: World, names: list[str], folder: Path) -> Ros2Link:
    """Return a link to robots."""
    path = folder / f"robots{port}.yaml"
    lines = "".join(f"  {name}: {{}}\n" for name in names)
    path.write_text(f"{FRAMES}robots:\n{lines}")
    return open_link(f"tcp/127.0.0.1:{port}#{path}", world, Settings())


def cuts(times: list[float]) -> str:
    """Return the median, the 95th and the 99th percentile, of seconds, in milliseconds."""
    parts = quantiles(times, n=100, method="inclusive")
    return f"median {parts[49] * 1e3:.1f}, p95 {parts[94] * 1e3:.1f}, p99 {parts[98] * 1e3:.1f} ms"


def latency(world: World, folder: Path, count: int, layout: str) -> list[float]:
    """Return the times from sending an order to its acknowledgement, seconds."""
    names = list(MOVERS)
    robots = Robots(places(world, names), "--layout", layout)
    link = linked(robots.port, world, names, folder)
    listener, times = Listener(link), list[float]()
    listener.heard(*names)
    for number in range(count):
        gate = GATES[number // len(names) % 4]
        order = f"m{number}"
        began = time.perf_counter()
        listener.send(order, names[number % len(names)], "move_to", gate)
        listener.until(lambda order=order: listener.statuses(order))
        times.append(time.perf_counter() - began)
        listener.news.clear()
    link.close()
    robots.close()
    return times


@dataclass
class Cuts:
    """What missions came to while the cable was cut, `wanted` times."""

    wanted: int
    random: Random
    cuts: int = 0
    moving: int = 0
    missions: Counter[str] = field(default_factory=Counter[str])
    reasons: Counter[str] = field(default_factory=Counter[str])
    sent: int = 0
    lost: list[str] = field(default_factory=list[str])
    false: list[str] = field(default_factory=list[str])
    recovery_s: list[float] = field(default_factory=list[float])

    def check(self, verification: Verification, world: World, robots: Robots) -> None:
        """Note an action that is held for done though its robot is not where it was sent."""
        state = robots.change()
        for action in verification.actions:
            target = world.frames.get(action.command.removeprefix("move_to "))
            if action.outcome != "pass" or target is None:
                continue
            at = state[action.agent]["at"]
            if math.dist(at, target.at) > target.radius_m + 0.5:
                self.false.append(f"{action.agent} {action.command}: {at}")


async def broken_sessions(site: Site, folder: Path, wanted: int, seed: int) -> Cuts:
    """Run missions one after another while the cable is cut at random moments."""
    world, found = site.world, Cuts(wanted, Random(seed))
    names = list(world.assets)
    robots = Robots(places(world, names))
    robots.change(**{name: {"top_mps": mps} for name, mps in MOVERS.items()})
    try:
        while found.cuts < wanted:
            await one_session(site, folder, robots, found)
        state = robots.change()
        executed = [goal for robot in state.values() for goal in robot["executed"]]
        print(
            f"{found.cuts} cuts, {found.moving} in motion, {found.sent} commands, missions "
            f"{dict(found.missions)}; goals begun {len(executed)}, twice "
            f"{len(executed) - len(set(executed))}, servers ended by a known goal "
            f"{sum(bool(robot['crashed']) for robot in state.values())}, lost in silence "
            f"{len(found.lost)}, falsely verified {len(found.false)}; seconds to a fresh picture: "
            + " ".join(f"{seconds:.1f}" for seconds in sorted(found.recovery_s))
        )
    finally:
        robots.close()
    return found


async def one_session(site: Site, folder: Path, robots: Robots, found: Cuts) -> None:
    """Run a session of missions; cut the cable now and then."""
    world, random = site.world, found.random
    cable = Cable(robots.port)
    link = linked(cable.port, world, list(world.assets), folder)
    fleet = LinkedFleet(world, [link])
    fleet.wait_for_reports(10.0)
    orders = [(random.choice(list(MOVERS)), random.choice(GATES)) for _ in range(3)]
    answers = [plan((agent, f"move_to {gate}")) for agent, gate in orders]
    station = open_station(
        site, ScriptedEngine(answers).engine(), DevicesClock(1.0), fleet=fleet, read_unasked=False
    )
    sent, ended, stop = dict[str, DeviceCommand](), set[str](), asyncio.Event()

    def sink(event: ev.Event, _: SessionState) -> None:
        match event.data:
            case ev.CommandSent(command=command):
                sent[command.command_id] = command
            case ev.CommandReplied(reply=reply) if reply.status in FINAL_REPLIES:
                ended.add(reply.command_id)
            case ev.PlanHalted():
                ended.update(sent)
            case ev.MissionVerified(verification=verification):
                found.check(verification, world, robots)
            case _:
                pass

    async def cutting() -> None:
        while not stop.is_set() and found.cuts < found.wanted:
            await asyncio.sleep(random.uniform(1.0, 5.0))
            state = await asyncio.to_thread(robots.change)
            found.moving += any(robot["speed"] > 0.0 for robot in state.values())
            cable.cut()
            found.cuts += 1
            await asyncio.sleep(random.uniform(0.2, 2.5))
            cable.mend()
            began = time.perf_counter()
            while not (all_fresh(fleet) or stop.is_set()):
                await asyncio.sleep(0.02)
            if not stop.is_set():
                found.recovery_s.append(time.perf_counter() - began)

    cutter = asyncio.create_task(cutting())
    texts = [f"Move {agent} to {gate}." for agent, gate in orders]
    try:
        traces = await run_missions(station, texts, standing_approver("auto", "campaign"), sink)
    finally:
        stop.set()
        await cutter
        fleet.close()
        cable.close()
    found.sent += len(sent)
    found.lost += [name for name in sent if name not in ended]
    found.missions.update(trace.status or "none" for trace in traces)
    found.reasons.update(trace.reason for trace in traces)


def all_fresh(fleet: LinkedFleet) -> bool:
    """Return whether the picture has fresh news of every asset."""
    return all(a.comms != "lost" and not a.stale for a in fleet.picture().assets.values())


def attacked(world: World, folder: Path, count: int, seed: int) -> None:
    """Send hostile messages on every topic of one robot, and answer in its place."""
    names, random = list(world.assets), Random(seed)
    robots = Robots(places(world, names))
    fleet = LinkedFleet(world, [linked(robots.port, world, names, folder)])
    fleet.wait_for_reports(10.0)
    other, told = hostile(robots.port), list[str]()
    topics = ("tf", "tf_static", "odom", "amcl_pose", "battery_state", "diagnostics_toplevel_state",
              "navigate_to_pose/_action/status", "navigate_to_pose/_action/feedback")  # fmt: skip
    payloads = [payload for _, payload in WRITTEN.values()]

    def garbage() -> bytes:
        payload = bytearray(random.choice(payloads))
        for _ in range(random.randint(0, 12)):
            payload[random.randrange(len(payload))] = random.randrange(256)
        return bytes(
            payload[: random.randint(0, len(payload))] if random.random() < 0.3 else payload
        )

    def answer(query: zenoh.Query) -> None:
        query.reply(query.key_expr, garbage())
        query.drop()

    other.declare_queryable("Ugv_T01/navigate_to_pose/_action/*", answer)
    before = {name: asset.position for name, asset in fleet.picture().assets.items()}
    for number in range(count):
        other.put(f"Ugv_T01/{random.choice(topics)}", garbage())
        if number % 20 == 0:
            verb = random.choice(("move_to", "hold", "report"))
            target = "NorthGate" if verb == "move_to" else None
            order = {"command_id": f"x{number}", "agent": "Ugv_T01", "verb": verb, "target": target}
            fleet.send(DeviceCommand.model_validate(order))
        if number % 5 == 0:
            told += [str(getattr(each, "text", each)) for each in fleet.step().told]
            time.sleep(0.01)
    for _ in range(20):
        time.sleep(0.05)
        told += [str(getattr(each, "text", each)) for each in fleet.step().told]
    after = fleet.picture().assets
    faults = [line for line in told if "Error" in line and "UnreadableError" not in line]
    others = [name for name in names if name != "Ugv_T01"]
    print(
        f"{count} hostile messages: nothing raised, {len(faults)} faults, {len(told)} lines told; "
        f"other robots where they were: {sum(after[n].position == before[n] for n in others)} of "
        f"{len(others)}, all fresh: {all(not after[n].stale for n in others)}"
    )
    other.close()
    fleet.close()
    robots.close()


class Stops:
    """A station that orders and stops, in real time."""

    def __init__(self, fleet: LinkedFleet) -> None:
        self.fleet, self.gate = fleet, CommandGate(fleet, Journal())
        self.stops = EmergencyStop(fleet, self.gate)
        self.doubted: dict[str, str] = {}
        self._orders, self._due = 0, time.perf_counter()

    def until(self, found: Callable[[], object], limit_s: float) -> float:
        """Step until `found`; return how long that took, seconds."""
        began = time.perf_counter()
        while not found() and time.perf_counter() - began < limit_s:
            self._due = max(self._due + self.fleet.world.dt_s, time.perf_counter() - 0.2)
            while (left_s := self._due - time.perf_counter()) > 0.0:
                time.sleep(left_s)
            received = self.fleet.step()
            for event in self.stops.step((self.fleet.tick, received.replies)):
                if isinstance(event, ev.StopUnconfirmed):
                    self.doubted = dict(event.assets)
        return time.perf_counter() - began

    def order(self, moves: dict[str, str]) -> None:
        """Let an approved plan go out."""
        self._orders += 1
        actions = tuple(Action(agent=a, command=f"move_to {gate}") for a, gate in moves.items())
        request = ev.ApprovalRequested(
            request_id=f"M{self._orders}.1", attempt=1, plan=Plan(reason="r", actions=actions)
        )
        self.gate.grant(request, Decision(kind="approve"), Rulebook("none", "", ()))
        self.gate.send(device_commands(request.plan, request.request_id), lambda _: None)

    def stop(self) -> None:
        """Press STOP."""
        self.doubted = {}
        self.stops.hold_all()


def stops(world: World, folder: Path, count: int, seed: int) -> None:
    """Stop all robots in motion `count` times, then with one of two links dead."""
    names, random = list(world.assets), Random(seed)
    with ExitStack() as closing:
        halves, links, cables = [names[::2], names[1::2]], list[Ros2Link](), list[Cable]()
        teams: list[Robots] = []
        for half in halves:
            teams.append(Robots(places(world, half)))
            closing.callback(teams[-1].close)
            cables.append(Cable(teams[-1].port))
            links.append(linked(cables[-1].port, world, half, folder))
            closing.callback(cables[-1].close)
        fleet = LinkedFleet(world, links)
        closing.callback(fleet.close)
        fleet.wait_for_reports(10.0)
        session, times, stood = Stops(fleet), list[float](), list[float]()

        def state() -> dict[str, Any]:
            return {name: robot for team in teams for name, robot in team.change().items()}

        def moving() -> bool:
            return sum(robot["speed"] > 0.0 for robot in state().values()) >= len(names) - 2

        for _ in range(count):
            session.order({name: random.choice(GATES) for name in names})
            session.until(moving, 8.0)
            began = time.perf_counter()
            session.stop()
            while any(robot["speed"] > 0.0 for robot in state().values()):
                session.fleet.step()
            stood.append(time.perf_counter() - began)
            times.append(session.until(lambda: not session.stops.waiting, 20.0) + stood[-1])
            session.gate.release()
            session.stops.release()
        print(f"{count} stops of {len(names)} robots: stand after {cuts(stood)}")
        print(f"confirmed after {cuts(times)}")
        session.order(dict.fromkeys(names, "NorthGate"))
        session.until(moving, 5.0)
        cables[1].cut()
        session.stop()
        session.until(lambda: set(session.doubted) == set(halves[1]), 10.0)
        held = [name for name in halves[0] if name not in session.doubted]
        print(
            f"one of two links dead: {len(held)} of {len(halves[0])} confirmed; not confirmed: "
            f"{', '.join(f'{n} ({why})' for n, why in session.doubted.items())}; waiting: "
            f"{session.stops.waiting}"
        )
        cables[1].mend()
        took_s = session.until(lambda: not session.stops.waiting, 30.0)
        print(f"link back: all confirmed after {took_s:.1f} s: {not session.stops.waiting}")


def crowd(world: World, folder: Path, count: int, seconds: float) -> None:
    """Drive many robots on one link; print how old the picture is and what it costs."""
    names = [f"Ugv_C{number:02}" for number in range(count)]
    spec = AssetSpec(kind="ugv", post="Checkpoint")
    large = world.model_copy(update={"assets": dict.fromkeys(names, spec)})
    spots = {name: (number % 10 * 3.0, number // 10 * 3.0) for number, name in enumerate(names)}
    robots = Robots(spots, "--rate-hz", "10")
    link = linked(robots.port, large, names, folder)
    fleet = LinkedFleet(large, [link])
    fleet.wait_for_reports(20.0)
    session, ages = Stops(fleet), list[float]()
    session.order({name: GATES[number % 4] for number, name in enumerate(names)})
    began, used = time.perf_counter(), time.process_time()

    def look() -> bool:
        ages.extend(fleet.time_s - asset.stamp_s for asset in fleet.picture().assets.values())
        return False

    session.until(look, seconds)
    took_s, used_s = time.perf_counter() - began, time.process_time() - used
    lost = sum(asset.comms == "lost" for asset in fleet.picture().assets.values())
    print(
        f"{count} robots on one link for {took_s:.0f} s: picture age {cuts(ages)}; "
        f"{100 * used_s / took_s:.0f} % of a processor; {lost} lost"
    )
    fleet.close()
    robots.close()


def main() -> None:
    """Run what was asked for and print what it came to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--commands", type=int, default=0, help="for the latency")
    parser.add_argument("--cuts", type=int, default=0)
    parser.add_argument("--hostile", type=int, default=0)
    parser.add_argument("--stops", type=int, default=0)
    parser.add_argument("--robots", type=int, default=0, help="on one link")
    parser.add_argument("--seconds", type=float, default=30.0, help="for the robots on one link")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    site = load_site("checkpoint", "checkpoint")
    with TemporaryDirectory() as name:
        folder = Path(name)
        for layout in ("bridge", "rmw") if given.commands else ():
            times = latency(site.world, folder, given.commands, layout)
            print(f"{layout}: {given.commands} orders acknowledged, {cuts(times)}", flush=True)
        if given.hostile:
            attacked(site.world, folder, given.hostile, given.seed)
        if given.stops:
            stops(site.world, folder, given.stops, given.seed)
        if given.robots:
            crowd(site.world, folder, given.robots, given.seconds)
        if given.cuts:
            found = asyncio.run(broken_sessions(site, folder, given.cuts, given.seed))
            print(*found.false, *found.lost, sep="\n")
            print(
                *(f"{count} x {reason}" for reason, count in found.reasons.most_common()), sep="\n"
            )


if __name__ == "__main__":
    main()
