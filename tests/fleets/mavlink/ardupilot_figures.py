"""`python -m tests.fleets.mavlink.ardupilot_figures`: a stop of a real ArduPilot, measured."""

import argparse
import asyncio
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from random import Random
from statistics import median, quantiles
from tempfile import TemporaryDirectory

from pa_console.fleets.linked_fleet import LinkedFleet
from pa_console.fleets.mavlink.link import open_link
from pa_console.schema.command import DeviceCommand, Verb
from pa_console.settings.schema import Settings
from pa_console.station.assembly import Site, load_site, open_station
from pa_console.station.clock import DevicesClock
from pa_console.station.station import ControlStation
from tests.fleets.mavlink.drones import Driven, on_the_earth
from tests.fleets.mavlink.sitl import PARAMETERS, OtherStation, Radio, Sitl, moves_it, vehicles_yaml
from tests.scripted import ScriptedEngine, plan

ONE = "Drone_T01"
CRUISE = ("WPNAV_SPEED 500",)
STANDS_MPS, CRUISE_MPS = 0.3, 4.8
VERBS: tuple[Verb, ...] = ("move_to", "observe", "return_to_base", "hold")
QUIET_S = 0.6


class Measured:
    """One copter behind a radio that notes what passes, and its link."""

    def __init__(self, site: Site, folder: Path, speedup: float) -> None:
        self.site = site
        home = site.world.frames[site.world.base].at
        self.sitl = Sitl(
            folder, "copter", 1, home, speedup=speedup, parameters=(*PARAMETERS, *CRUISE)
        )
        self.radio = Radio(self.sitl.port)
        file = folder / "vehicles.yaml"
        text = vehicles_yaml(site.world, [self.radio.address], [ONE], "altitude_m: 12")
        file.write_text(text, encoding="utf-8")
        self.driven = Driven(open_link(str(file), site.world, Settings()))
        self.driven.until(lambda: self.driven.fenced(1) and self.driven.not_ready[ONE] == "")

    def close(self) -> None:
        """End it."""
        self.driven.link.close()
        self.radio.close()
        self.sitl.kill()


def histories(measured: Measured, count: int, seed: int) -> tuple[int, int]:
    """Return the motion commands after a stop, in so many random histories, and before them."""
    driven, random, gates = measured.driven, Random(seed), list(measured.site.world.gates)
    after = before = 0
    for number in range(count):
        first = len(measured.radio.commands)
        for step in range(random.randint(1, 4)):
            verb = random.choice(VERBS)
            target = random.choice(gates) if verb in ("move_to", "observe") else None
            driven.send(f"h{number}.{step}", ONE, verb, target)
            until = time.monotonic() + random.uniform(0.0, 0.8)
            driven.until(lambda until=until: time.monotonic() >= until)
        driven.send(f"h{number}.stop", ONE, "hold")
        pressed = time.perf_counter()
        driven.until(lambda quiet=pressed + QUIET_S: time.perf_counter() >= quiet)
        new = measured.radio.commands[first:]
        before += sum(moves_it(*command) for command in new if command[0] < pressed)
        # what the link's thread had begun to send when the stop was given goes out before the hold
        held = next(
            (at for at, sent, mode in new if at > pressed and (sent, mode) == (176, 17.0)), pressed
        )
        after += sum(moves_it(*command) for command in new if command[0] > max(held, pressed))
        if (number + 1) % 50 == 0:
            print(f"{number + 1} histories: {after} after, {before} before", flush=True)
    return after, before


async def stops(measured: Measured, count: int) -> tuple[list[float], list[float]]:
    """Return the times from a stop to the first hold on the wire, and until it stands, seconds."""
    fleet = LinkedFleet(measured.site.world, [measured.driven.link])
    fleet.wait_for_reports(5.0)
    engine = ScriptedEngine([plan()]).engine()
    station = open_station(
        measured.site, engine, DevicesClock(1.0), fleet=fleet, read_unasked=False
    )
    fleet.close = lambda: None
    other = measured.sitl.other_station()
    wire: list[float] = []
    stood: list[float] = []

    async def listening() -> None:
        async for _ in station.run():
            pass

    task = asyncio.create_task(listening())
    await asyncio.sleep(1.0)
    try:
        await asyncio.to_thread(other.follow, 20.0)
        for number in range(count):
            gate = ("WestGate", "EastGate")[number % 2]
            fleet.send(
                DeviceCommand(command_id=f"m{number}", agent=ONE, verb="move_to", target=gate)
            )
            await asyncio.to_thread(_wait, other, lambda speed: speed >= CRUISE_MPS)
            pressed = press(station)
            at = await asyncio.to_thread(_wait, other, lambda speed: speed < STANDS_MPS)
            stood.append(at - pressed)
            wire.append(first_hold(measured.radio, pressed) - pressed)
            station.release()
            await asyncio.sleep(1.0)
    finally:
        other.close()
        task.cancel()
    return wire, stood


def press(station: ControlStation) -> float:
    """Press STOP; return when."""
    pressed = time.perf_counter()
    station.stop_all()
    return pressed


def first_hold(radio: Radio, since: float) -> float:
    """Return when the first hold after `since` passed."""
    return next(
        at for at, sent, mode in radio.commands if at > since and (sent, mode) == (176, 17.0)
    )


def _wait(other: OtherStation, done: Callable[[float], bool]) -> float:
    while True:
        at, speed = other.speed()
        if done(speed):
            return at


def main() -> None:
    """Measure what was asked for and print it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--stops", type=int, default=0)
    parser.add_argument("--histories", type=int, default=0)
    parser.add_argument("--speedup", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    site = load_site("checkpoint", "checkpoint")
    site = replace(site, world=on_the_earth(site.world))
    with TemporaryDirectory() as folder:
        measured = Measured(site, Path(folder), arguments.speedup)
        try:
            if arguments.histories:
                after, before = histories(measured, arguments.histories, arguments.seed)
                print(f"{arguments.histories} histories: {after} moves after, {before} before")
            if arguments.stops:
                for what, times in zip(
                    ("on the wire", "standing"),
                    asyncio.run(stops(measured, arguments.stops)),
                    strict=True,
                ):
                    p99 = quantiles(times, n=100)[98]
                    print(f"{what}: p50 {median(times):.3f} s, p99 {p99:.3f} s, {len(times)} stops")
        finally:
            measured.close()


if __name__ == "__main__":
    main()
