"""Figures of a benchmark: the machine they are from, their progress, and the file they go to."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import TypeAdapter
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from pa_console.evaluation.run_record import Machine
from pa_console.llm.models.catalogue import LocalModel
from pa_console.terminal.output import errors, out

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "build" / "benchmarks"

JsonFileOption = Annotated[
    Path | None,
    typer.Option(
        "--json",
        metavar="FILE",
        help="Write the figures to this file in place of one named after the benchmark in "
        "build/benchmarks.",
    ),
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


def shares() -> Progress:
    """Return a progress display of one task, whose description is what is measured now."""
    return Progress(
        BarColumn(20),
        TimeElapsedColumn(),
        TextColumn("{task.description}", markup=False),
        console=errors,
        transient=True,
    )
