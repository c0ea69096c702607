"""`python -m tests.fleets.mavlink.campaign`: round trips, cut links, stops and many drones."""

import argparse
import asyncio
import tempfile
import time
from collections import Counter
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import groupby
from pathlib import Path
from random import Random
from statistics import median, quantiles

from pa_console.fleets.linked_fleet import LinkedFleet
from pa_console.fleets.mavlink.link import MavlinkLink, open_link
from pa_console.mission.approval import standing_approver
from pa_console.mission.stop import StopConfirmation
from pa_console.schema.command import FINAL_REPLIES, CommandReply, DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.world import AssetSpec, World
from pa_console.session.state import SessionState
from pa_console.settings.schema import Settings
from pa_console.station.assembly import Site, load_site, open_station
from pa_console.station.clock import DevicesClock
from pa_console.station.headless import run_missions
from tests.fleets.mavlink.drones import Drones, free_port, on_the_earth, vehicles_file
from tests.fleets.mavlink.scripted import GEOGRAPHY
from tests.scripted import ScriptedEngine, plan

TEAM = ("Drone_T01", "Drone_T02", "Drone_T03", "Drone_T04")
READY_S = 240.0


class Linked:
    """A fleet on links, stepped in real time."""

    def __init__(self, world: World, links: Sequence[MavlinkLink]) -> None:
        self.links, self.fleet = links, LinkedFleet(world, links)
        self.replies: list[CommandReply] = []
        self.lines: list[str] = []
        self._due = time.monotonic()

    def go(self) -> None:
        """Take a step when it is due, or sooner where there is news."""
        self._due += self.fleet.world.dt_s
        while (left := self._due - time.monotonic()) > 0:
            time.sleep(min(left, 0.02))
        received = self.fleet.step()
        self.replies += received.replies
        self.lines += [getattr(line, "text", "") for line in received.told]

    def ready(self, count: int) -> None:
        """Step until so many drones are shown and have the world's fence; raises TimeoutError."""
        until = time.monotonic() + READY_S
        while True:
            shown = sum(asset.comms == "ok" for asset in self.fleet.picture().assets.values())
            fenced = sum("read back and is the world's" in line for line in self.lines)
            if min(shown, fenced) >= count:
                return
            if time.monotonic() > until:
                raise TimeoutError(str(self.lines[-5:]))
            self.go()

    def answered(self, name: str) -> CommandReply | None:
        """Return the last reply to a command."""
        return next((r for r in reversed(self.replies) if r.command_id == name), None)


@contextmanager
def linked(
    world: World, *teams: Sequence[str], options: Sequence[str] = ()
) -> Generator[tuple[Linked, list[Drones]]]:
    """Yield a fleet whose teams have a link each, and their drones."""
    with tempfile.TemporaryDirectory() as folder:
        drones: list[Drones] = []
        links: list[MavlinkLink] = []
        try:
            for number, team in enumerate(teams):
                place, port = Path(folder) / str(number), free_port()
                place.mkdir()
                file = vehicles_file(place, world, team)
                drones.append(Drones(port, world, team, *options))
                links.append(open_link(f"udpin://127.0.0.1:{port}#{file}", world, Settings()))
            fleet = Linked(world, links)
            fleet.ready(sum(map(len, teams)))
            yield fleet, drones
        finally:
            for link in links:
                link.close()
            for each in drones:
                each.kill()


def round_trips(world: World, count: int) -> list[float]:
    """Return the times from sending a move to its acknowledgement at the station, milliseconds."""
    took: list[float] = []
    with linked(world, TEAM) as (over, _):
        (link,) = over.links
        for number in range(count):
            agent = TEAM[number % len(TEAM)]
            target = ("SouthGate", "Checkpoint")[number // len(TEAM) % 2]
            name = f"m{number}"
            began = time.perf_counter()
            over.fleet.send(
                DeviceCommand(command_id=name, agent=agent, verb="move_to", target=target)
            )
            reply = None
            while reply is None:
                link.wait(1.0)
                replies = over.fleet.step().replies
                reply = next((r for r in replies if r.command_id == name), None)
            assert reply.status == "acknowledged", reply
            took.append((time.perf_counter() - began) * 1e3)
    return took


@dataclass
class Cuts:
    """What missions came to while a link was cut in motion, `wanted` times."""

    wanted: int
    random: Random
    cuts: int = 0
    missions: Counter[str] = field(default_factory=Counter[str])
    sent: dict[str, DeviceCommand] = field(default_factory=dict[str, DeviceCommand])
    ended: set[str] = field(default_factory=set[str])
    passed: list[tuple[str, str]] = field(default_factory=list[tuple[str, str]])
    false: list[str] = field(default_factory=list[str])
    moves: int = 0
    carried_out: int = 0
    """Moves that the drones accepted; one whose answer was lost is accepted again, and goes on."""
    twice: list[str] = field(default_factory=list[str])


async def cut_sessions(site: Site, wanted: int, seed: int) -> Cuts:
    """Run missions while the drones' link is cut and restored at random moments of a motion."""
    found, world = Cuts(wanted, Random(seed)), site.world
    with linked(world, TEAM, options=("--rate", "2")) as (over, (drones,)):
        while found.cuts < wanted:
            await one_session(site, over, drones, found)
        for name, each in drones.say().items():
            moves = [line for line in each["log"] if line.startswith("moved")]
            runs = [move for move, _ in groupby(moves)]
            orders = [c for c in found.sent.values() if c.agent == name and c.verb == "move_to"]
            found.carried_out += len(moves)
            found.moves += len(orders)
            if len(runs) > len(orders):
                found.twice.append(f"{name}: {len(runs)} moves of {len(orders)} orders")
    return found


async def one_session(site: Site, over: Linked, drones: Drones, found: Cuts) -> None:
    """Run three missions; the link is cut while each drone is on its way."""
    gates = list(site.world.gates)
    orders = [(agent, found.random.choice(gates)) for agent in found.random.sample(TEAM, 3)]
    answers = [plan((agent, f"move_to {gate}")) for agent, gate in orders]
    fleet = LinkedFleet(site.world, over.links)
    station = open_station(
        site, ScriptedEngine(answers).engine(), DevicesClock(1.0), fleet=fleet, read_unasked=False
    )
    stop, moving = asyncio.Event(), asyncio.Event()

    def sink(event: ev.Event, _: SessionState) -> None:
        match event.data:
            case ev.CommandSent(command=command):
                found.sent[f"{station.session}.{command.command_id}"] = command
            case ev.CommandReplied(reply=reply):
                if reply.status == "acknowledged":
                    moving.set()
                if reply.status in FINAL_REPLIES:
                    found.ended.add(f"{station.session}.{reply.command_id}")
            case ev.PlanHalted():
                found.ended.update(found.sent)
            case ev.MissionVerified(verification=verification):
                truth = drones.say()
                for action in verification.actions:
                    target = action.command.removeprefix("move_to ")
                    if action.outcome == "pass" and target != action.command:
                        latitude, longitude = truth[action.agent]["at"]
                        at = GEOGRAPHY.metres(latitude, longitude)
                        frame = site.world.frames[target]
                        gap = sum((a - b) ** 2 for a, b in zip(at, frame.at, strict=True)) ** 0.5
                        if gap > frame.radius_m:
                            found.false.append(f"{action.agent} {action.command}: {gap:.1f} m off")
                        found.passed.append((action.agent, target))
            case _:
                pass

    async def cutting() -> None:
        while not stop.is_set() and found.cuts < found.wanted:
            moving.clear()
            await moving.wait()
            await asyncio.sleep(found.random.uniform(0.0, 2.0))
            drones.tell("", down=True)
            found.cuts += 1
            await asyncio.sleep(found.random.uniform(0.5, 9.0))
            drones.tell("", down=False)

    cutter = asyncio.create_task(cutting())
    texts = [
        f"Move {agent} to the {gate.removesuffix('Gate').lower()} gate." for agent, gate in orders
    ]
    fleet.close = lambda: None  # the links go on
    traces = await run_missions(station, texts, standing_approver("auto", "campaign"), sink)
    stop.set()
    cutter.cancel()
    drones.tell("", down=False)
    await asyncio.sleep(1.0)
    found.missions.update(trace.status or "none" for trace in traces)


def stops(world: World, count: int) -> tuple[list[float], list[float]]:
    """Return how long stops took to be answered by all, and to be confirmed by telemetry, ms."""
    answered: list[float] = []
    confirmed: list[float] = []
    with linked(world, TEAM) as (over, _):
        gates = list(world.gates)
        for number in range(count):
            for place, agent in enumerate(TEAM):
                target = gates[(number + place) % len(gates)]
                name = f"m{number}.{agent}"
                over.fleet.send(
                    DeviceCommand(command_id=name, agent=agent, verb="move_to", target=target)
                )
            for _ in range(15):
                over.go()
            one, other = stop_all(over, number, TEAM)
            answered.append(one)
            confirmed.append(other)
    return answered, confirmed


def stop_all(over: Linked, number: int, team: Sequence[str]) -> tuple[float, float]:
    """Stop the team; return when all had answered and when all were confirmed, milliseconds."""
    holds = [DeviceCommand(command_id=f"h{number}.{a}", agent=a, verb="hold") for a in team]
    stop = StopConfirmation(holds, over.fleet.world, over.fleet.tick, over.fleet.time_s)
    began, open_ids = time.perf_counter(), {hold.command_id for hold in holds}
    for hold in holds:
        over.fleet.send(hold)
    answered = 0.0
    while True:
        before = len(over.replies)
        over.go()
        new = over.replies[before:]
        list(stop.answer(new))
        overdue = stop.look(over.fleet.picture(), over.fleet.time_s)
        open_ids -= {r.command_id for r in new if r.status in FINAL_REPLIES}
        now = (time.perf_counter() - began) * 1e3
        if not open_ids and not answered:
            answered = now
        if answered and stop.confirmed:
            return answered, now
        for hold, _ in stop.resends(over.fleet.tick, overdue):
            over.fleet.send(hold)
        if now > 30_000.0:
            return answered or now, now


def stop_with_a_dead_link(world: World) -> tuple[list[str], dict[str, str]]:
    """Stop all with one of two links dead; return who is confirmed, and why the others are not."""
    with linked(world, TEAM[:2], TEAM[2:]) as (over, (alive, dead)):
        del alive
        dead.kill()
        holds = [DeviceCommand(command_id=f"h.{a}", agent=a, verb="hold") for a in TEAM]
        stop = StopConfirmation(holds, world, over.fleet.tick, over.fleet.time_s)
        for hold in holds:
            over.fleet.send(hold)
        overdue: dict[str, str] = {}
        for _ in range(40):
            before = len(over.replies)
            over.go()
            list(stop.answer(over.replies[before:]))
            overdue = dict(stop.look(over.fleet.picture(), over.fleet.time_s))
        assert stop.confirmed is not bool(overdue)
        return [name for name in TEAM if name not in overdue], overdue


def crowd(world: World, count: int, seconds: float) -> str:
    """Drive so many drones over one link; return the picture's age and the processor's share."""
    posts = list(world.frames)
    names = [f"Drone_C{number:03}" for number in range(count)]
    assets = {n: AssetSpec(kind="uav", post=posts[i % len(posts)]) for i, n in enumerate(names)}
    larger = world.model_copy(update={"assets": assets})
    with linked(larger, names, options=("--shared",)) as (over, _):
        ages: list[float] = []
        worst, ticks = 0.0, over.fleet.tick
        began, used = time.perf_counter(), time.process_time()
        last = -1.0
        while time.perf_counter() - began < seconds:
            over.go()
            picture = over.fleet.picture()
            if picture.time_s != last:
                last = picture.time_s
                now = [picture.time_s - asset.stamp_s for asset in picture.assets.values()]
                ages += now
                worst = max(worst, *now)
        wall, cpu = time.perf_counter() - began, time.process_time() - used
        ran = (over.fleet.tick - ticks) * larger.dt_s
        return (
            f"{count} drones on one link for {wall:.0f} s: age in the picture "
            f"p50 {median(ages):.2f} s, p95 {quantiles(ages, n=20)[18]:.2f} s, "
            f"oldest {worst:.2f} s; processor {100 * cpu / wall:.0f} % of one core; "
            f"clock {ran / wall:.2f} of the true one"
        )


def main() -> None:
    """Run what was asked for and print what it came to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--commands", type=int, default=0, help="for the round trip")
    parser.add_argument("--cuts", type=int, default=0)
    parser.add_argument("--stops", type=int, default=0)
    parser.add_argument("--dead", action="store_true", help="stop with one link dead")
    parser.add_argument("--crowd", type=int, default=0, help="drones on one link")
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    site = load_site("checkpoint", "checkpoint")
    world = on_the_earth(site.world)
    if arguments.commands:
        took = round_trips(world, arguments.commands)
        cuts = quantiles(took, n=20)
        print(f"{len(took)} round trips: median {median(took):.1f} ms, p95 {cuts[18]:.1f} ms")
    if arguments.stops:
        for what, times in zip(
            ("answered", "confirmed"), stops(world, arguments.stops), strict=True
        ):
            p99 = quantiles(times, n=100)[98]
            print(f"{len(times)} stops {what}: median {median(times):.0f} ms, p99 {p99:.0f} ms")
    if arguments.dead:
        standing, doubts = stop_with_a_dead_link(world)
        print(f"one link dead: confirmed {standing}, not confirmed {doubts}")
    if arguments.crowd:
        print(crowd(world, arguments.crowd, arguments.seconds))
    if arguments.cuts:
        placed = replace(site, world=world)
        found = asyncio.run(cut_sessions(placed, arguments.cuts, arguments.seed))
        lost = [name for name in found.sent if name not in found.ended]
        print(
            f"{found.cuts} cuts, {len(found.sent)} commands, missions {dict(found.missions)}; "
            f"verified {len(found.passed)}, falsely {len(found.false)} {found.false}; moves begun "
            f"twice {len(found.twice)} {found.twice}, {found.carried_out} accepted of "
            f"{found.moves} ordered; lost in silence {len(lost)} {lost}"
        )


if __name__ == "__main__":
    main()
