"""Memory of the processes that hold a model."""

import re
from pathlib import Path
from typing import NamedTuple

from pa_console.llm.local.engine import Engine

PROCESSES = Path("/proc")


class Memory(NamedTuple):
    """Megabytes in use, and the most that ever were resident, mapped files included.

    Of what several processes map, such as a model that is loaded twice, each has a share (PSS).
    """

    pss_mb: float
    peak_mb: float


def process_memory(pid: int, processes: Path = PROCESSES) -> Memory | None:
    """Return the memory of process `pid`; None where the system does not say."""
    folder = processes / str(pid)
    try:
        texts = [(folder / name).read_text(encoding="utf-8") for name in ("smaps_rollup", "status")]
    except OSError:
        return None
    found = dict(re.findall(r"^(Pss|VmHWM):\s+(\d+) kB$", "\n".join(texts), re.M))
    if len(found) < len(Memory._fields):
        return None
    return Memory(int(found["Pss"]) * 1024 / 1e6, int(found["VmHWM"]) * 1024 / 1e6)


def workers_memory(engine: Engine) -> dict[str, Memory]:
    """Return the memory of each process that holds a model of `engine`, by the model's name."""
    found: dict[str, Memory] = {}
    for one in (engine, engine.second_reader):
        if one is not None and one.pid is not None and (memory := process_memory(one.pid)):
            found[one.name] = memory
    return found
