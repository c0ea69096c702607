"""Memory of the processes that hold a model."""

import re
from pathlib import Path
from typing import NamedTuple

PROCESSES = Path("/proc")


class Memory(NamedTuple):
    """Megabytes that are resident now, mapped files included, and the most that ever were."""

    rss_mb: float
    peak_mb: float


def process_memory(pid: int, processes: Path = PROCESSES) -> Memory | None:
    """Return the memory of process `pid`; None where the system does not tell."""
    try:
        status = (processes / str(pid) / "status").read_text(encoding="utf-8")
    except OSError:
        return None
    found = {name: int(kib) for name, kib in re.findall(r"^(Vm\w+):\s+(\d+) kB$", status, re.M)}
    if not {"VmRSS", "VmHWM"} <= found.keys():
        return None
    return Memory(found["VmRSS"] * 1024 / 1e6, found["VmHWM"] * 1024 / 1e6)
