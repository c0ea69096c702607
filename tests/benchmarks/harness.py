"""The frame of every benchmark: its options, its progress, its machine, and where figures go."""

import asyncio
import json
import re
from collections.abc import Awaitable, Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeVar

import typer
from pydantic import TypeAdapter
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from pa_console.evaluation.memo_engine import MemoEngine
from pa_console.evaluation.run_record import Machine
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.catalogue import LocalModel
from pa_console.terminal.output import errors, out

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "build" / "benchmarks"
PROCESSES = Path("/proc")

EngineT = TypeVar("EngineT", Engine, MemoEngine)
Result = TypeVar("Result")
Tell = Callable[[str, float], None]
"""Called with what is measured now, and the share, 0 to 1, that is done."""

JsonFileOption = Annotated[
    Path | None,
    typer.Option(
        "--json",
        metavar="FILE",
        help="Write the figures to this file in place of one named after the benchmark in "
        "build/benchmarks.",
    ),
]
SecondReaderOption = Annotated[
    bool, typer.Option("--second-reader", help="Read orders in doubt again, as sessions do.")
]


def keep(name: str, figures: Any, file: Path | None) -> None:
    """Write `figures`, dataclasses and pydantic models included, to `file` as JSON."""
    path = file or FOLDER / f"{name}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    plain = TypeAdapter(Any).dump_python(figures, mode="json")
    path.write_text(json.dumps(plain, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    errors.print_line(f"figures: {path}")


def introduce(machine: Machine, model: LocalModel | None, measured: str) -> None:
    """Print the machine and the model that is measured, and how."""
    for line in machine.lines:
        out.print(line)
    named = f"model {model.name} ({model.sha256[:12]}), " if model is not None else ""
    out.print(f"{named}{measured}")


@contextmanager
def progress() -> Generator[Tell]:
    """Show the progress of one benchmark; yields the function that updates it."""
    columns = (BarColumn(20), TimeElapsedColumn(), TextColumn("{task.description}", markup=False))
    with Progress(*columns, console=errors, transient=True) as display:
        task = display.add_task("", total=1.0)
        yield lambda what, share: display.update(task, completed=share, description=what)


def with_engine(engine: EngineT, work: Callable[[EngineT], Awaitable[Result]]) -> Result:
    """Return the result of `work` with `engine`, which is closed afterwards."""

    async def run() -> Result:
        try:
            return await work(engine)
        finally:
            await engine.close()

    return asyncio.run(run())


class Memory(NamedTuple):
    """Megabytes in use, and the most that ever were resident, mapped files included.

    If several processes map the same file, such as a model, each counts its share (PSS).
    """

    pss_mb: float
    peak_mb: float


def process_memory(pid: int, processes: Path = PROCESSES) -> Memory | None:
    """Return the memory of process `pid`; None if the system does not report it."""
    folder = processes / str(pid)
    try:
        texts = [(folder / name).read_text(encoding="utf-8") for name in ("smaps_rollup", "status")]
    except OSError:
        return None
    sizes = dict(re.findall(r"^(Pss|VmHWM):\s+(\d+) kB$", "\n".join(texts), re.M))
    if len(sizes) < len(Memory._fields):
        return None
    return Memory(int(sizes["Pss"]) * 1024 / 1e6, int(sizes["VmHWM"]) * 1024 / 1e6)
