"""`python -m tests.fuzz --plans 10000 --seed 1`: the fuzz run with progress and a summary."""

import argparse
import asyncio
from concurrent.futures import ProcessPoolExecutor

from rich.progress import track

from tests.fuzz.campaign import Tally, campaign

CHUNK = 100


def _chunk(seed: int) -> Tally:
    return asyncio.run(campaign(CHUNK, seed))


def main() -> None:
    """Run the campaign on every core and print what happened."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plans", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    seeds = [arguments.seed * 1_000_000 + number for number in range(arguments.plans // CHUNK)]
    tally = Tally()
    with ProcessPoolExecutor() as pool:
        for part in track(pool.map(_chunk, seeds), description="plans", total=len(seeds)):
            tally.add(part)
    print(tally.summary())


if __name__ == "__main__":
    main()
