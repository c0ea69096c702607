"""Start-up times of the command line, the screen and the model, beside their goals."""

import errno
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Annotated

import typer
from rich.table import Table

from pa_console.cli.options import ModelOption
from pa_console.evaluation.run_record import Machine, describe_machine
from pa_console.llm.models.catalogue import LocalModel, find_model
from pa_console.schema.base import StrictModel
from pa_console.terminal.output import out
from tests.benchmarks.harness import JsonFileOption, Tell, introduce, keep, progress
from tests.benchmarks.start.console_start import COMMAND, COMPILED, ConsoleStart, StartError

HELP_GOAL_S = 0.25
FRAME_GOAL_S = 0.8
PAINT_GOAL_S = 1.2
READY_GOAL_S = 2.5

PYTHON = (sys.executable, "-P", "-c")
CALLS: tuple[tuple[str, tuple[str, ...], float | None], ...] = (
    ("python, nothing imported", (*PYTHON, "pass"), None),
    ("import pa_console", (*PYTHON, "import pa_console"), None),
    ("pa-console --help", (*COMMAND, "--help"), HELP_GOAL_S),
    ("pa-console mission --help", (*COMMAND, "mission", "--help"), HELP_GOAL_S),
    ("pa-console scenarios list", (*COMMAND, "scenarios", "list"), None),
)
"""What is called, with its goal in seconds; a call is timed from its start to its end."""

FRAMED = "console: frame shown"
PAINTED = "console: takes keys"
READY = "console: model ready"


class StartTime(StrictModel):
    """Seconds that one kind of start took, run by run; `cold`: the model came from the disk."""

    name: str
    goal_s: float | None
    cold: bool
    median_s: float
    most_s: float
    runs_s: tuple[float, ...]


class StartReport(StrictModel):
    """The whole output of the benchmark `start`; `cold_problem` says why nothing is cold."""

    machine: Machine
    model: str
    model_sha256: str
    times: tuple[StartTime, ...]
    cold_problem: str


@dataclass(frozen=True)
class Screen:
    """Texts by which the console shows its frame, its screen, and that the model is ready."""

    framed: re.Pattern[str]
    painted: re.Pattern[str]
    ready: re.Pattern[str]


def measure_start(
    model: LocalModel, screen: Screen, runs: int, tell: Tell
) -> tuple[list[StartTime], str]:
    """Measure every kind of start `runs` times, after one that is not counted.

    Returns the times, and why the console was not started with the model on the disk, if it was
    not. Raises StartError for a program that does not come up, saying what it showed.
    """
    steps = len(CALLS) + 2
    times: list[StartTime] = []
    for number, (name, command, goal_s) in enumerate(CALLS):
        tell(name, number / steps)
        _seconds(command)
        times.append(_time(name, goal_s, [_seconds(command) for _ in range(runs)]))
    tell("console", len(CALLS) / steps)
    start_console(model, screen)
    warm = [start_console(model, screen) for _ in range(runs)]
    times += _all(warm, cold=False)
    tell("console, cold", (len(CALLS) + 1) / steps)
    files = {model.path, *(adapter.path for adapter in model.adapters)}
    cold: list[tuple[float, ...]] = []
    for _ in range(runs):
        if not drop(files):
            return times, "this system kept the model in memory"
        cold.append(start_console(model, screen))
    return [*times, *_all(cold, cold=True)], ""


def start_console(model: LocalModel, screen: Screen) -> tuple[float, ...]:
    """Start a console with `model`, its logs in a folder that is gone afterwards.

    Returns the seconds until its frame is shown, until it takes keys and until the model is ready.
    The frame is that of an earlier start, if there was one. Raises StartError.
    """
    with (
        tempfile.TemporaryDirectory(prefix="pa-console-start-") as logs,
        ConsoleStart(["--set", f"logs={logs}", "console", "--model", model.name], {}) as console,
    ):
        patterns = (screen.framed, screen.painted, screen.ready)
        return tuple(console.wait_for(pattern) for pattern in patterns)


def _all(starts: Sequence[tuple[float, ...]], *, cold: bool) -> list[StartTime]:
    framed, painted, ready = zip(*starts, strict=True)
    return [
        _time(FRAMED, FRAME_GOAL_S, framed, cold=cold),
        _time(PAINTED, PAINT_GOAL_S, painted, cold=cold),
        _time(READY, READY_GOAL_S, ready, cold=cold),
    ]


def _seconds(command: Sequence[str]) -> float:
    started = perf_counter()
    done = subprocess.run(
        command,
        capture_output=True,
        check=False,
        start_new_session=True,
        env=os.environ | COMPILED,
    )
    taken = perf_counter() - started
    if done.returncode != 0:
        said = done.stderr.decode("utf-8", "replace").strip()
        raise StartError(f"{' '.join(command)} ended with {done.returncode}: {said[-300:]}")
    return taken


def _time(
    name: str, goal_s: float | None, runs_s: Sequence[float], *, cold: bool = False
) -> StartTime:
    return StartTime(
        name=name,
        goal_s=goal_s,
        cold=cold,
        median_s=median(runs_s),
        most_s=max(runs_s),
        runs_s=tuple(runs_s),
    )


CAN_DROP = hasattr(os, "posix_fadvise") and hasattr(os, "RWF_NOWAIT")


def drop(files: Iterable[Path]) -> bool:
    """Ask the system to forget `files`; False where one is still there afterwards.

    That needs no rights. The system keeps what another process has mapped, and what is not yet on
    the disk. Raises OSError for a file that cannot be read.
    """
    return CAN_DROP and not [file for file in files if not _drop(file)]


def _drop(file: Path) -> bool:
    descriptor = os.open(file, os.O_RDONLY)
    try:
        os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)
        return not _cached(descriptor)
    finally:
        os.close(descriptor)


def _cached(descriptor: int) -> bool:
    """Return whether the middle of a file can be read without waiting for the disk."""
    middle = os.fstat(descriptor).st_size // 2
    try:
        return bool(os.preadv(descriptor, [bytearray(1)], middle, os.RWF_NOWAIT))
    except OSError as error:
        if error.errno == errno.EAGAIN:
            return False
        raise


LOADED = re.compile(r"model \S (?:ready|slow)")
"""What the status bar says of a model that is loaded; on a busy machine it is slow."""


def start(
    model: ModelOption = None,
    runs: Annotated[int, typer.Option(min=1, help="Starts of each kind.")] = 5,
    json: JsonFileOption = None,
) -> None:
    """Time what starts: verbs, the console's frame and screen, its model; beside the goals."""
    from pa_console.tui.over_frame import OPENING  # noqa: PLC0415 - imports Textual
    from pa_console.tui.widgets.mission_prompt import ELSEWHERE  # noqa: PLC0415

    weights, machine = find_model(model), describe_machine()
    painted = re.escape(ELSEWHERE.split(";", maxsplit=1)[0])
    framed = re.compile(f"{re.escape(OPENING)}|{painted}")
    screen = Screen(framed, re.compile(painted), LOADED)
    with progress() as tell:
        times, problem = measure_start(weights, screen, runs, tell)
    introduce(machine, weights, f"{runs} starts of each kind")
    out.print(_table(times))
    if problem:
        out.print(f"not measured cold: {problem}")
    report = StartReport(
        machine=machine,
        model=weights.name,
        model_sha256=weights.sha256,
        times=tuple(times),
        cold_problem=problem,
    )
    keep("start", report, json)


def _table(times: Sequence[StartTime]) -> Table:
    table = Table("what", box=None, pad_edge=False)
    for name in ("median s", "most s", "goal s", "reached"):
        table.add_column(name, justify="right")
    for time in times:
        goal, reached = "", ""
        if time.goal_s is not None:
            goal, reached = f"{time.goal_s:g}", "yes" if time.median_s <= time.goal_s else "NO"
        name = f"{time.name}, the model's files cold" if time.cold else time.name
        table.add_row(name, f"{time.median_s:.2f}", f"{time.most_s:.2f}", goal, reached)
    return table
