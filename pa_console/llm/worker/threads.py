"""How many threads the model gets.

A prompt is computed on every physical core. A few tokens are bound by memory, not arithmetic, and
their threads meet one to two thousand times, as every adapted layer adds four operations: with so
many cores that half of them saturate the memory, the other half is left to the console. On two
cores both are faster than one, also beside another busy process: 11 against 17 ms for one token of
135M weights with an adapter, 40 against 72 for eight.
"""

import os
from pathlib import Path

TOPOLOGY = Path("/sys/devices/system/cpu")
FEW_TOKENS = 16
FEW_CORES = 4
"""All of so many cores are used for a few tokens."""


def physical_cores() -> int:
    """Return the number of physical cores this process may use, logical ones where unknown."""
    if not hasattr(os, "sched_getaffinity"):
        return os.cpu_count() or 1
    allowed = os.sched_getaffinity(0)
    siblings: set[str] = set()
    for cpu in allowed:
        try:
            path = TOPOLOGY / f"cpu{cpu}" / "topology" / "thread_siblings_list"
            siblings.add(path.read_text(encoding="ascii").strip())
        except OSError:
            return len(allowed)
    return len(siblings)


def decoding_threads(cores: int) -> int:
    """Return how many of `cores` to use for one token at a time."""
    return max(min(cores, FEW_CORES), cores // 2)


def batch_threads(cores: int, tokens: int) -> int:
    """Return how many of `cores` to use for `tokens` at once."""
    return cores if tokens > FEW_TOKENS else decoding_threads(cores)
