"""The contents and the origin of a data set, as `report.json` beside the samples."""

import hashlib
import platform
from collections import Counter
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path

from pydantic import Field

import pa_console
import pa_training
from pa_console import __version__
from pa_console.llm.models.cache import hash_file
from pa_console.schema.base import StrictModel
from pa_training import LANGUAGE
from pa_training.results.lineage import read_json
from pa_training.samples.data_set import FILES, DataFolder
from pa_training.situations.worlds import shipped_missions, shipped_world

REPORT = "report.json"
LIBRARIES = ("common-expression-language", "numpy", "pydantic", "pymunk", "rapidfuzz", "shapely")
"""Libraries that have a say in what a data set holds."""
REMEDY = "run python -m pa_training data"


class DataReport(StrictModel):
    """The samples of a data set, why the rest was dropped, and everything that it depends on."""

    groups: int
    samples: dict[str, dict[str, int]] = Field(description="train or valid -> task -> samples")
    kinds: dict[str, dict[str, int]] = Field(description="task -> kind -> samples")
    dropped: dict[str, int]
    generators: dict[str, int] = Field(description="fingerprint -> groups")
    versions: dict[str, str]
    kept_apart_from: dict[str, str] = Field(description="mission set -> SHA-256")
    sha256: dict[str, str]


def fingerprint(rules: Path) -> str:
    """Return a short hash of all that makes samples: code, orders, rules.

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
    """Put the samples of the data set in `folder` together, and write and return its report.

    Raises OSError, and ValueError where there is no data set.
    """
    data = DataFolder(folder)
    data.put_together()
    report = _report(data)
    (folder / REPORT).write_text(report.model_dump_json(indent=2) + "\n", encoding="utf-8")
    return report


def read_report(folder: Path) -> DataReport:
    """Return the report in `folder`; raises ValueError when there is none."""
    return read_json(folder / REPORT, DataReport, REMEDY)


def _report(data: DataFolder) -> DataReport:
    samples = {"train": Counter[str](), "valid": Counter[str]()}
    kinds = dict[str, Counter[str]]()
    dropped, generators = Counter[str](), Counter[str]()
    for made in data.groups():
        generators[made.generator] += 1
        dropped.update(made.dropped)
        for sample in made.samples:
            samples["valid" if made.valid else "train"][sample.task] += 1
            kinds.setdefault(sample.task, Counter())[sample.kind] += 1
    if not generators:
        raise ValueError(f"{data.path}: no group of a data set is here: {REMEDY}")
    return DataReport(
        groups=generators.total(),
        samples={name: _sorted(counts) for name, counts in samples.items()},
        kinds={task: _sorted(kinds[task]) for task in sorted(kinds)},
        dropped=_sorted(dropped),
        generators=generators,
        versions={
            "pa-console": __version__,
            "python": platform.python_version(),
            **{name: version(name) for name in LIBRARIES},
        },
        kept_apart_from={path.name: hash_file(path) for path in shipped_missions()},
        sha256={name: hash_file(data.path / name) for name in FILES},
    )


def _sorted(counts: Mapping[str, int]) -> dict[str, int]:
    """Return `counts` with the greatest first."""
    return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))
