"""`python -m tests.attacks.stop_campaign --stops 10000`: random missions stopped at random."""

import argparse
import asyncio
import time
from concurrent.futures import ProcessPoolExecutor

from rich.progress import track

from tests.attacks.stop_trial import Tally, stops

CHUNK = 10


def chunk(first: int) -> Tally:
    """Return what CHUNK trials from seed `first` come to."""
    return asyncio.run(stops(first, CHUNK))


def main() -> None:
    """Run the campaign and print what it came to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--stops", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0, help="the first one")
    parser.add_argument("--minutes", type=float, default=1e6, help="begin no more after so many")
    parser.add_argument("--processes", type=int, default=None, help="one a core by default")
    arguments = parser.parse_args()
    firsts = range(arguments.seed, arguments.seed + arguments.stops, CHUNK)
    tally, ends = Tally(), time.monotonic() + 60 * arguments.minutes
    with ProcessPoolExecutor(arguments.processes) as pool:
        for part in track(pool.map(chunk, firsts), description="stops", total=len(firsts)):
            tally.add(part)
            if time.monotonic() > ends:
                pool.shutdown(cancel_futures=True)
                break
    print(tally.summary())


if __name__ == "__main__":
    main()
