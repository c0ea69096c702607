"""`python -m tests.fleets.ros2.stop_figures`: how quickly STOP reaches robots over DDS."""

import argparse
import os
from collections.abc import Sequence
from pathlib import Path
from statistics import quantiles
from tempfile import TemporaryDirectory
from threading import Event, Thread

from pa_console.station.assembly import load_site
from tests.fleets.ros2.counterpart import Robots, linked, stop
from tests.fleets.ros2.intruder import Intruder

PLACE = (0.0, 0.0)


def cuts(seconds: Sequence[float]) -> str:
    """Return percentiles in words."""
    ranks = quantiles(seconds, n=100, method="inclusive")
    return f"p50 {ranks[49]:.3f} s, p99 {ranks[98]:.3f} s, worst {max(seconds):.3f} s"


def flood(intruder: Intruder, ended: Event) -> None:
    """Publish hostile messages, a thousand a second at most, until `ended`."""
    while not ended.wait(0.001):
        intruder.send()


def main() -> None:
    """Stop robots in motion, and print how long that took."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--stops", type=int, default=50)
    parser.add_argument("--robots", type=int, default=3)
    parser.add_argument("--flood", action="store_true", help="beside a flood of hostile messages")
    given = parser.parse_args()
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    world = load_site("checkpoint", "checkpoint").world
    names = [name for name in world.assets if world.assets[name].kind != "uav"][: given.robots]
    robots, ended = Robots(dict.fromkeys(names, PLACE)), Event()
    intruder = Intruder(robots.domain, names[0], seed=0)
    text = "robots:\n" + "".join(f"  {name}: {{}}\n" for name in names)
    with TemporaryDirectory() as folder, linked(robots.domain, world, Path(folder), text) as link:
        link.heard(*names)
        flooding = Thread(target=flood, args=(intruder, ended))
        if given.flood:
            flooding.start()
        presses = [stop(robots, link, names, number) for number in range(given.stops)]
        ended.set()
        if given.flood:
            flooding.join()
    intruder.close()
    robots.close()
    print(f"{given.stops} stops of {len(names)} robots in motion")
    print("request to cancel at the robot:", cuts([s for press in presses for s in press.wire_s]))
    print("robot stands:", cuts([s for press in presses for s in press.stood_s]))
    print("confirmed:", cuts([s for press in presses for s in press.done_s]))
    print("goals sent after the press:", sum(press.sent_after for press in presses))


if __name__ == "__main__":
    main()
