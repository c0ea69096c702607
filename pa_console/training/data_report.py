"""What a data set holds and where it came from, as `report.json` beside the samples."""

import hashlib
import json
import platform
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

from pa_console import __version__
from pa_console.llm.cache import hash_file
from pa_console.training.data_folder import FILES, REPORT, Entry, read_journal
from pa_console.training.near_duplicates import NearReport
from pa_console.training.worlds import shipped_missions, shipped_world

LIBRARIES = ("common-expression-language", "numpy", "pydantic", "pymunk", "rapidfuzz", "shapely")
"""Libraries that have a say in what the generator makes."""
Number = TypeVar("Number", int, float)


def fingerprint(rules: Path) -> str:
    """Return a short hash of all that makes samples: the package's own code and words, the rules.

    Two groups of one recipe and one fingerprint are equal.
    """
    package = Path(__file__).parents[1]
    total = hashlib.sha256(rules.read_bytes())
    files = (path for path in package.rglob("*") if path.suffix in {".py", ".yaml"})
    named = sorted((path.relative_to(package).as_posix(), path) for path in files)
    for name, path in named:
        if not name.startswith(("cli/", "tui/", "training/lora/", "data/")):
            total.update(name.encode() + path.read_bytes())
    total.update(shipped_world().model_dump_json().encode())
    return total.hexdigest()[:12]


def write_report(folder: Path) -> dict[str, Any]:
    """Write the report of the data set in `folder` and return it.

    Raises OSError, and ValueError where there is no data set.
    """
    report = data_report(folder)
    text = json.dumps(report, indent=2, ensure_ascii=False) + "\n"
    (folder / REPORT).write_text(text, encoding="utf-8")
    return report


def data_report(folder: Path) -> dict[str, Any]:
    """Return what the data set in `folder` is: counts, reasons for drops, versions, hashes."""
    entries = read_journal(folder)
    if not entries:
        raise ValueError(f"{folder}: no group of a data set is here: run pa-console train data")
    return {
        "groups": len({(entry.seed, entry.number) for entry in entries}),
        "seeds": {
            str(seed): _ranges(e.number for e in entries if e.seed == seed)
            for seed in sorted({entry.seed for entry in entries})
        },
        "samples": _by_task(entries),
        "kinds": _by_kind(entries),
        "dropped": _sorted(_total(entry.dropped for entry in entries)),
        "near_duplicates": _near(entries).model_dump(),
        "generators": Counter(entry.generator for entry in entries),
        "versions": {
            "pa-console": __version__,
            "python": platform.python_version(),
            **{name: version(name) for name in LIBRARIES},
        },
        "kept_apart_from": {path.name: hash_file(path) for path in shipped_missions()},
        "sha256": {name: hash_file(folder / name) for name in FILES if (folder / name).exists()},
    }


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
