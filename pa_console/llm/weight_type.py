"""Which type of weights this machine reads prompts fastest with, by what its CPU can do."""

from pathlib import Path

from pa_console.llm.prepare import Quantisation

CPU_INFO = Path("/proc/cpuinfo")
WIDE = "avx512f"


def fastest_type(cpu_info: Path = CPU_INFO) -> Quantisation:
    """Return bf16 for a CPU with AVX-512, f16 for any other, or where `cpu_info` (Linux) is not.

    Both are as large, and f16 keeps three bits more of a weight than bf16.
    """
    try:
        text = cpu_info.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return "f16"
    return "bf16" if WIDE in text.split() else "f16"
