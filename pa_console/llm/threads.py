"""How many threads the model gets.

A prompt is computed on every physical core. A few tokens are bound by memory, not arithmetic, and
their threads meet one to two thousand times, as every adapted layer adds four operations: half of
the cores were faster than all of them (two cores, 135M to 1.5B weights; with an adapter 56 against
117 ms for four tokens beside other work), and leave room for the console.
"""

import os
from pathlib import Path

TOPOLOGY = Path("/sys/devices/system/cpu")
FEW_TOKENS = 16


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
    return (cores + 1) // 2


def batch_threads(cores: int, tokens: int) -> int:
    """Return how many of `cores` to use for `tokens` at once."""
    return cores if tokens > FEW_TOKENS else decoding_threads(cores)
