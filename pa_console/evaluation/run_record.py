"""The record of an evaluated run, the folder of an evaluation, and the description of a machine."""

import json
import os
import platform
import re
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

import platformdirs
from pydantic import Field, TypeAdapter, ValidationError

from pa_console.evaluation.run_facts import RuleBreach
from pa_console.llm.local.threads import physical_cores
from pa_console.schema.base import Share, StrictModel
from pa_console.schema.evaluation import Expectation
from pa_console.schema.finding import Usage
from pa_console.schema.mission import Metrics, MissionStatus, Outcome

Opinion = Literal["Success", "Failure"]

RUNS, ABOUT, LOGS = "runs.jsonl", "run.json", "logs"
_ABOUT = TypeAdapter(dict[str, Any])

CPU_INFO = Path("/proc/cpuinfo")
WIDE_FLAGS = ("avx", "avx2", "fma", "f16c", "avx512f", "avx512_vnni", "amx_tile", "asimd", "sve")
"""The CPU flags that determine the speed of matrix products."""

PACKAGES = ("llama-cpp-python", "llguidance", "common-expression-language", "pymunk", "rapidfuzz")


class RunRecord(StrictModel):
    """One run of a mission with one model, variant and simulation seed; a line of `runs.jsonl`.

    `strict` is the paper's strict success on the true state (Section V-B): all conditions of the
    mission hold, and no enforced rule was broken. `hybrid` is the judge's verdict on the outcome.
    If nothing was executed, there is no verdict, and the run is a hybrid success only if `expect`
    allows that. Without a judge in the variant, `hybrid` is None. `obeyed` is the strict success
    that would have resulted if the operator had followed every Failure of the judge before
    execution.
    """

    run: str = Field(description="model/variant/set/mission/seed")
    model: str
    variant: str
    mission_set: str
    mission: str
    seed: int
    world: str
    category: str
    tags: tuple[str, ...] = ()
    expect: Expectation
    command: str
    session: str = ""
    log: str = Field(default="", description="the run's event log, relative to runs.jsonl")
    status: MissionStatus
    reason: str = ""
    refused: bool = Field(description="no commands other than hold and report were sent")
    strict: bool
    obeyed: bool
    hybrid: bool | None
    failed: tuple[str, ...] = Field(default=(), description="success conditions that do not hold")
    broken: tuple[RuleBreach, ...] = ()
    judge_plan: Opinion | None = Field(default=None, description="verdict on the executed plan")
    judge_outcome: Opinion | None = None
    confidence: Share | None = Field(
        default=None, description="the confidence in the reading, as shown to the operator"
    )
    offered: int = Field(
        default=0, ge=0, description="number of other readings that were offered to the operator"
    )
    verification: Outcome | None = Field(default=None, description="the outcome from telemetry")
    valid_json: bool = Field(description="the first answer could be read as a plan")
    first_sound: bool = Field(description="the first plan broke no Critical or High rule")
    attempts: int
    plan: tuple[str, ...] = Field(default=(), description="'agent command' of the last plan")
    metrics: Metrics
    planner: Usage = Field(default_factory=Usage, description="usage of the first answer")
    judge: Usage = Field(default_factory=Usage)
    reused: int = Field(default=0, ge=0, description="number of reused answers to equal prompts")
    read_ahead: bool = Field(
        default=False, description="the model read the picture before the command, as while typing"
    )

    @property
    def case(self) -> tuple[str, str, int]:
        """The mission and the seed, which runs of different models and variants share."""
        return self.mission_set, self.mission, self.seed


def read_runs(folder: Path) -> list[RunRecord]:
    """Return all runs in `folder`, the oldest first; an empty list if there are none yet.

    An incomplete last line is ignored, because the run will be repeated. Raises ValueError with
    file and line if any other line is not a run.
    """
    path = folder / RUNS
    if not path.exists():
        return []
    data = path.read_bytes()
    lines = data.split(b"\n")
    records: list[RunRecord] = []
    for number, line in enumerate(lines, start=1):
        if not line.strip() or (number == len(lines) and not data.endswith(b"\n")):
            continue
        try:
            records.append(RunRecord.model_validate_json(line))
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            field = ".".join(map(str, first["loc"]))
            problem = f"{field}: {first['msg']}" if field else first["msg"]
            raise ValueError(
                f"{path}:{number}: this line is not a run of an evaluation ({problem}); "
                "remove the line, or give another folder"
            ) from error
    return records


def read_about(folder: Path) -> dict[str, Any]:
    """Return the options of the evaluation in `folder`; {} if they are not recorded."""
    path = folder / ABOUT
    try:
        return _ABOUT.validate_json(path.read_bytes())
    except FileNotFoundError:
        return {}
    except ValidationError as error:
        raise ValueError(f"{path}: this is not a JSON object; remove the file") from error


class EvaluationFolder:
    """The folder of an evaluation, with its runs by id."""

    def __init__(self, folder: Path) -> None:
        """Open or make `folder`; raises ValueError if a line is not a run."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / LOGS).mkdir(exist_ok=True)
        self.folder = folder
        self.records = read_runs(folder)
        self._mend()

    @property
    def done(self) -> frozenset[str]:
        """The ids of the completed runs."""
        return frozenset(record.run for record in self.records)

    def add(self, record: RunRecord) -> None:
        """Add a run, and return when it is on the disk."""
        self.records.append(record)
        with (self.folder / RUNS).open("ab") as file:
            file.write(record.model_dump_json().encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())

    def arrange(self, runs: Sequence[str]) -> None:
        """Rewrite the file with the runs in `runs` at the end, in the order of `runs`.

        Thus the file does not depend on the order in which the runs ended.
        """
        place = {run: number for number, run in enumerate(runs)}
        self.records.sort(key=lambda record: place.get(record.run, -1))
        partial = self.folder / f".{RUNS}"
        lines = [record.model_dump_json().encode() + b"\n" for record in self.records]
        partial.write_bytes(b"".join(lines))
        partial.replace(self.folder / RUNS)

    def describe(self, about: dict[str, Any]) -> None:
        """Write the options of the evaluation, and replace those written earlier."""
        partial = self.folder / f".{ABOUT}"
        partial.write_text(json.dumps(about, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        partial.replace(self.folder / ABOUT)

    def _mend(self) -> None:
        """Remove an incomplete last line from the file."""
        path = self.folder / RUNS
        if path.exists():
            data = path.read_bytes()
            if data and not data.endswith(b"\n"):
                path.write_bytes(data[: data.rfind(b"\n") + 1])


def evaluations_folder() -> Path:
    """Return the default folder for evaluations."""
    return platformdirs.user_state_path("pa-console") / "evaluations"


def newest_evaluation(below: Path | None = None) -> Path | None:
    """Return the evaluation in `below` with the latest change to its runs; None if there is none.

    The default of `below` is `evaluations_folder()`.
    """
    files = (below or evaluations_folder()).glob(f"*/{RUNS}")
    newest = max(files, key=lambda path: path.stat().st_mtime, default=None)
    return newest.parent if newest is not None else None


class Machine(StrictModel):
    """The hardware and software of a machine; `load` is its load average over the last minute."""

    cpu: str
    logical_cores: int
    usable_cores: int
    """The physical cores that this process may use, which is the model's number of threads."""
    flags: tuple[str, ...]
    memory_gib: float | None
    system: str
    python: str
    packages: dict[str, str]
    load: float | None

    @property
    def lines(self) -> tuple[str, ...]:
        """The description of the machine as lines of text."""
        memory = "memory unknown" if self.memory_gib is None else f"{self.memory_gib:.1f} GiB"
        load = "" if self.load is None else f", load {self.load:.1f} at the start"
        return (
            f"{self.cpu}: {self.logical_cores} logical cores, {self.usable_cores} usable physical "
            f"cores, {' '.join(self.flags) or 'no known vector instructions'}; {memory}{load}",
            f"{self.system}, Python {self.python}, "
            + ", ".join(f"{name} {number}" for name, number in self.packages.items()),
        )


def describe_machine(cpu_info: Path = CPU_INFO) -> Machine:
    """Return the description of this machine; on Linux, `cpu_info` has details of the processor."""
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
    """Return the first value in `text` of any of the fields `names`; '' if there is none."""
    match = re.search(rf"^(?:{'|'.join(names)})\s*:\s*(.+)$", text, re.MULTILINE)
    return match[1].strip() if match else ""


def _memory_gib() -> float | None:
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    except (AttributeError, OSError, ValueError):
        return None
