"""The machine that figures were measured on."""

import os
import platform
import re
import sys
from importlib.metadata import version
from pathlib import Path

from pa_console.llm.local.threads import physical_cores
from pa_console.schema.base import StrictModel

CPU_INFO = Path("/proc/cpuinfo")
WIDE_FLAGS = ("avx", "avx2", "fma", "f16c", "avx512f", "avx512_vnni", "amx_tile", "asimd", "sve")
"""The CPU flags that decide the speed of matrix products."""

PACKAGES = ("llama-cpp-python", "llguidance", "common-expression-language", "pymunk", "rapidfuzz")


class Machine(StrictModel):
    """CPU, memory, system and libraries; `load` is the load average of the last minute."""

    cpu: str
    logical_cores: int
    usable_cores: int
    """Physical cores that this process may use: the model gets as many threads."""
    flags: tuple[str, ...]
    memory_gib: float | None
    system: str
    python: str
    packages: dict[str, str]
    load: float | None

    @property
    def lines(self) -> tuple[str, ...]:
        """The machine in words."""
        memory = "memory unknown" if self.memory_gib is None else f"{self.memory_gib:.1f} GiB"
        load = "" if self.load is None else f", load {self.load:.1f} when it began"
        return (
            f"{self.cpu}: {self.logical_cores} logical cores, {self.usable_cores} physical ones "
            f"usable, {' '.join(self.flags) or 'no known vector instructions'}; {memory}{load}",
            f"{self.system}, Python {self.python}, "
            + ", ".join(f"{name} {number}" for name, number in self.packages.items()),
        )


def describe_machine(cpu_info: Path = CPU_INFO) -> Machine:
    """Return the description of this machine from the standard library and `cpu_info` (Linux)."""
    try:
        text = cpu_info.read_text(encoding="utf-8", errors="replace")
    except OSError:
        text = ""
    present = set(_field(text, "flags", "Features").split())
    return Machine(
        cpu=_field(text, "model name") or platform.processor() or platform.machine() or "unknown",
        logical_cores=os.cpu_count() or 1,
        usable_cores=physical_cores(),
        flags=tuple(flag for flag in WIDE_FLAGS if flag in present),
        memory_gib=_memory_gib(),
        system=platform.platform(),
        python=f"{platform.python_version()} ({sys.implementation.name})",
        packages={name: version(name) for name in PACKAGES},
        load=os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
    )


def _field(text: str, *names: str) -> str:
    """Return the first value of one of the fields `names`, empty when there is none."""
    found = re.search(rf"^(?:{'|'.join(names)})\s*:\s*(.+)$", text, re.MULTILINE)
    return found[1].strip() if found else ""


def _memory_gib() -> float | None:
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    except (AttributeError, OSError, ValueError):
        return None
