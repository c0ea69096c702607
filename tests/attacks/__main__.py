"""A campaign by hand: `python -m tests.attacks stop --count 10000 --seed 1`.

It prints what came of it; the exit code is 1 if anything was amiss.
"""

import argparse
import sys
from importlib import import_module

from tests.attacks.crash_lines import instrument

CAMPAIGNS = {
    "crash": "crash_trial",
    "stop": "stop_trial",
    "load": "load_campaign",
    "words": "adaptive.words",
    "histories": "adaptive.histories",
    "weights": "mutated_weights",
    "files": "read_hostile",
}
"""The module of each campaign."""


def main() -> int:
    """Run a campaign and print what it found; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.attacks", description=__doc__)
    parser.add_argument("campaign", choices=CAMPAIGNS)
    parser.add_argument("--count", type=int, default=1000, help="trials")
    parser.add_argument("--seed", type=int, default=0, help="equal seeds draw the same attacks")
    given = parser.parse_args()
    if given.campaign == "crash":
        instrument()  # before what it imports is imported
    module = import_module(f"tests.attacks.{CAMPAIGNS[given.campaign]}")
    told, amiss = module.campaign(given.count, given.seed)
    print(*told, *amiss, sep="\n")
    return 1 if amiss else 0


if __name__ == "__main__":
    sys.exit(main())
