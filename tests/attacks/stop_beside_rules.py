"""How long STOP takes beside rule files that are made to be slow: from the key to the last hold.

`python -m tests.attacks.stop_beside_rules` plays a station in real time under the shipped rules and
under hostile files of each kind, with a plan being checked all the while. A thread presses STOP at
random moments; measured is the wall time until the last asset was told to hold.
"""

import asyncio
import random
import sys
import tempfile
import threading
from contextlib import aclosing
from pathlib import Path
from time import perf_counter, sleep

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.mission import rehearse as rehearsal
from pa_console.mission.examine import examine
from pa_console.policy.monitor import Monitor
from pa_console.policy.rulebook import load_rules, with_core
from pa_console.schema.document import DocumentError
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Plan
from pa_console.sim.checkpoint import Checkpoint
from pa_console.station.assembly import Site, load_site, open_station
from pa_console.station.clock import RealTimeClock
from tests.attacks.hostile_rules import KINDS, write_hostile
from tests.policy.test_large import MISSION
from tests.scripted import ScriptedEngine, plan

PLAN = plan(("Drone_T04", "move_to EastGate"))
LONG = Mission.model_validate(MISSION.model_dump() | {"text": ("a" * 40 + " ") * 45 + "!"})


async def stops(site: Site, count: int, seed: int) -> list[float]:
    """Return the seconds of `count` stops while plans are checked and a mission is followed."""
    sim = Checkpoint(site.world, seed)
    engine = ScriptedEngine([PLAN]).engine()
    station = open_station(site, engine, RealTimeClock(), fleet=SimulatedFleet(sim))
    loop, took, rng = asyncio.get_running_loop(), list[float](), random.Random(seed)
    done = asyncio.Event()

    async def follow() -> None:
        async with aclosing(station.run()) as events:
            async for _ in events:
                pass

    async def check() -> None:
        moves = Plan.model_validate_json(PLAN)
        monitor = Monitor(site.rulebook, site.world)
        before = await rehearsal.rehearse(sim, moves)
        while True:
            await examine(moves, LONG, sim, site.rulebook, monitor)
            for now in before.moments:
                monitor.observe(now)
                await asyncio.sleep(0)

    def stop(pressed: float) -> None:
        station.stop_all()
        took.append(perf_counter() - pressed)

    def press() -> None:
        for _ in range(count):
            sleep(rng.uniform(0.02, 0.2))
            loop.call_soon_threadsafe(stop, perf_counter())
        loop.call_soon_threadsafe(done.set)

    following, checking = asyncio.create_task(follow()), asyncio.create_task(check())
    await asyncio.sleep(0.5)
    threading.Thread(target=press).start()
    await done.wait()
    for task in (checking, following):
        task.cancel()
    await asyncio.gather(checking, following, return_exceptions=True)
    return sorted(took)


def main(files: int, count: int) -> None:
    """Print one line for the shipped rules and one for each kind of file that can be loaded."""
    print(f"{'rules':14} files stops  p50 ms  p99 ms  worst ms")
    shipped = load_site("checkpoint", "checkpoint")

    def line(name: str, loaded: int, took: list[float]) -> None:
        if took:
            shown = (took[len(took) // 2], took[int(len(took) * 0.99)], took[-1])
            words = " ".join(f"{1000 * seconds:8.1f}" for seconds in shown)
            print(f"{name:14} {loaded:5} {len(took):5} {words}", flush=True)
        else:
            print(f"{name:14}     0     every one refused", flush=True)

    line("shipped", 1, asyncio.run(stops(shipped, count * files, 0)))
    with tempfile.TemporaryDirectory() as folder:
        for kind in KINDS:
            took, loaded = list[float](), 0
            for number in range(50):
                path = write_hostile(Path(folder), kind, number)
                try:
                    book = with_core(load_rules(path))
                except DocumentError:
                    continue
                loaded += 1
                site = Site(shipped.world, shipped.world_path, book, path)
                took += asyncio.run(stops(site, count, number))
                if loaded == files:
                    break
            line(kind, loaded, sorted(took))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:] or ("3", "20")))
