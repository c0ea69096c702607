"""What a data set holds and where it came from, as `report.json` beside the samples."""

import hashlib
import platform
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TypeVar

from pydantic import Field

import pa_console
import pa_training
from pa_console import __version__
from pa_console.llm.models.cache import hash_file
from pa_console.schema.base import StrictModel
from pa_training import LANGUAGE
from pa_training.results.lineage import read_json
from pa_training.samples.data_set import FILES, REPORT, Entry, read_journal
from pa_training.samples.near_duplicates import NearReport
from pa_training.situations.worlds import shipped_missions, shipped_world

LIBRARIES = ("common-expression-language", "numpy", "pydantic", "pymunk", "rapidfuzz", "shapely")
"""Libraries that have a say in what the generator makes."""
Number = TypeVar("Number", int, float)

REMEDY = "run python -m pa_training data"


class DataReport(StrictModel):
    """What a data set holds, why the rest was dropped, and everything that it depends on."""

    groups: int
    seeds: dict[str, str] = Field(description="seed -> numbers of its groups, e.g. 0-99, 120")
    samples: dict[str, dict[str, int]] = Field(description="train or valid -> task -> samples")
    kinds: dict[str, dict[str, int]] = Field(description="task -> kind -> samples")
    dropped: dict[str, int]
    near_duplicates: NearReport
    generators: dict[str, int] = Field(description="fingerprint -> groups")
    versions: dict[str, str]
    kept_apart_from: dict[str, str] = Field(description="mission set -> SHA-256")
    sha256: dict[str, str]


def fingerprint(rules: Path) -> str:
    """Return a short hash of all that makes samples: code, phrases, rules.

    Two groups of one recipe and one fingerprint are equal.
    """
    console, makers = Path(pa_console.__file__).parent, Path(pa_training.__file__).parent
    total = hashlib.sha256(rules.read_bytes())
    for folder, apart in (
        (console, ("cli/", "tui/", "data/")),
        (makers, ("adapters/", "verbs/")),
        (LANGUAGE, ()),
    ):
        for path in sorted(folder.rglob("*")):
            name = path.relative_to(folder).as_posix()
            if path.suffix in {".py", ".yaml"} and not name.startswith(apart):
                total.update(name.encode() + path.read_bytes())
    total.update(shipped_world().model_dump_json().encode())
    return total.hexdigest()[:12]


def write_report(folder: Path) -> DataReport:
    """Write the report of the data set in `folder` and return it.

    Raises OSError, and ValueError where there is no data set.
    """
    report = data_report(folder)
    (folder / REPORT).write_text(report.model_dump_json(indent=2) + "\n", encoding="utf-8")
    return report


def read_report(folder: Path) -> DataReport:
    """Return the report in `folder`; raises ValueError when there is none."""
    return read_json(folder / REPORT, DataReport, REMEDY)


def data_report(folder: Path) -> DataReport:
    """Return what the data set in `folder` is; raises ValueError where there is none."""
    entries = read_journal(folder)
    if not entries:
        raise ValueError(f"{folder}: no group of a data set is here: {REMEDY}")
    return DataReport(
        groups=len({(entry.seed, entry.number) for entry in entries}),
        seeds={
            str(seed): _ranges(e.number for e in entries if e.seed == seed)
            for seed in sorted({entry.seed for entry in entries})
        },
        samples=_by_task(entries),
        kinds=_by_kind(entries),
        dropped=_sorted(_total(entry.dropped for entry in entries)),
        near_duplicates=_near(entries),
        generators=Counter(entry.generator for entry in entries),
        versions={
            "pa-console": __version__,
            "python": platform.python_version(),
            **{name: version(name) for name in LIBRARIES},
        },
        kept_apart_from={path.name: hash_file(path) for path in shipped_missions()},
        sha256={name: hash_file(folder / name) for name in FILES if (folder / name).exists()},
    )


def _by_task(entries: Sequence[Entry]) -> dict[str, dict[str, int]]:
    """Return samples of each task, for training and for validation."""
    counts = {"train": Counter[str](), "valid": Counter[str]()}
    for entry in entries:
        for name, count in entry.counts.items():
            counts["valid" if entry.valid else "train"][name.partition(" ")[0]] += count
    return {name: _sorted(total) for name, total in counts.items()}


def _by_kind(entries: Sequence[Entry]) -> dict[str, dict[str, int]]:
    """Return how many samples of each kind every task has, the most frequent first."""
    kinds: dict[str, Counter[str]] = {}
    for name, count in _total(entry.counts for entry in entries).items():
        task, _, kind = name.partition(" ")
        kinds.setdefault(task, Counter())[kind] += count
    return {task: _sorted(kinds[task]) for task in sorted(kinds)}


def _near(entries: Sequence[Entry]) -> NearReport:
    """Return how near all groups came to the test sets; each group counts once."""
    once = list({(entry.seed, entry.number): entry.near for entry in entries}.values())
    nearest: dict[str, float] = {}
    for near in once:
        for name, score in near.nearest.items():
            nearest[name] = max(score, nearest.get(name, 0.0))
    return once[-1].model_copy(
        update={
            "checked": sum(near.checked for near in once),
            "dropped": sum(near.dropped for near in once),
            "nearest": _sorted(nearest),
            "histogram": dict(_total(near.histogram for near in once)),
        }
    )


def _total(parts: Iterable[dict[str, int]]) -> Counter[str]:
    total = Counter[str]()
    for part in parts:
        total.update(part)
    return total


def _sorted(counts: Mapping[str, Number]) -> dict[str, Number]:
    """Return `counts` with the greatest first."""
    return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))


def _ranges(numbers: Iterable[int]) -> str:
    """Return `numbers` as text: 0-99, 200-299."""
    runs: list[tuple[int, int]] = []
    for number in sorted(set(numbers)):
        if runs and number == runs[-1][1] + 1:
            runs[-1] = runs[-1][0], number
        else:
            runs.append((number, number))
    return ", ".join(f"{first}-{last}" if last > first else f"{first}" for first, last in runs)
