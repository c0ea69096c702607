"""A data set on disk: sample files, and a journal that says which groups are whole in them."""

import os
from collections import Counter
from pathlib import Path

from pydantic import ValidationError

from pa_console.schema.base import StrictModel
from pa_console.training.data_set import Made, Part
from pa_console.training.near_duplicates import NearReport
from pa_console.training.planner_data import Recipe
from pa_console.training.samples import Sample

JOURNAL, REPORT = "groups.jsonl", "report.json"
FILES = ("planner.jsonl", "judge.jsonl", "valid-planner.jsonl", "valid-judge.jsonl")
VALID_EVERY, VALID_REST = 50, 7


class Entry(StrictModel):
    """One group that is on disk as a whole, and how long each file was when it was."""

    seed: int
    number: int
    parts: tuple[Part, ...]
    generator: str
    counts: dict[str, int]
    dropped: dict[str, int]
    near: NearReport
    sizes: dict[str, int]

    @property
    def valid(self) -> bool:
        """Whether the group is for validation."""
        return for_validation(self.number)


class DataFolder:
    """Adds groups to the files of a folder; what a sudden end has torn is cut off."""

    def __init__(self, path: Path, generator: str) -> None:
        """Open the folder at `path`, made when it is missing; `generator` says what makes groups.

        Raises OSError, and ValueError for a journal that is none.
        """
        path.mkdir(parents=True, exist_ok=True)
        self.path, self._generator = path, generator
        self.entries = _fitting(path, read_journal(path))
        self.mend()

    @property
    def generators(self) -> set[str]:
        """Every version of the generator that has made groups."""
        return {entry.generator for entry in self.entries}

    def missing(self, recipe: Recipe, parts: tuple[Part, ...]) -> tuple[Part, ...]:
        """Return those of `parts` that the group of `recipe` does not have yet."""
        there = self._there(recipe)
        return tuple(part for part in parts if part not in there)

    def add(self, recipe: Recipe, parts: tuple[Part, ...], made: Made) -> None:
        """Write a group, and then that it is whole; both are on the disk before this returns."""
        texts: dict[str, list[str]] = {name: [] for name in FILES}
        for sample in made.samples:
            texts[_file_of(sample, recipe)].append(sample.model_dump_json() + "\n")
        sizes = {name: _append(self.path / name, "".join(texts[name])) for name in FILES}
        entry = Entry(
            seed=recipe.seed,
            number=recipe.number,
            parts=parts,
            generator=self._generator,
            counts=Counter(f"{sample.task} {sample.kind}" for sample in made.samples),
            dropped=+made.dropped,
            near=made.near,
            sizes=sizes,
        )
        _append(self.path / JOURNAL, entry.model_dump_json() + "\n")
        self.entries.append(entry)

    def mend(self) -> None:
        """Cut off everything that the journal does not know to be whole."""
        text = "".join(entry.model_dump_json() + "\n" for entry in self.entries)
        _shorten(self.path / JOURNAL, len(text.encode()))
        for name in FILES:
            _shorten(self.path / name, self.entries[-1].sizes[name] if self.entries else 0)

    def _there(self, recipe: Recipe) -> set[Part]:
        return {
            part
            for entry in self.entries
            if (entry.seed, entry.number) == (recipe.seed, recipe.number)
            for part in entry.parts
        }


def for_validation(number: int) -> bool:
    """Return whether the group of this number is held out from training, as a whole: 2 % are."""
    return number % VALID_EVERY == VALID_REST


def read_journal(path: Path) -> list[Entry]:
    """Return every whole entry of the folder `path`, oldest first; [] where nothing is yet.

    Raises OSError, and ValueError with the line for one that is no entry, or without a journal
    beside samples.
    """
    file = path / JOURNAL
    if not file.exists():
        found = [name for name in FILES if _size(path / name)]
        if found:
            raise ValueError(f"{path / found[0]}: has no {JOURNAL} beside it; name another folder")
        return []
    entries: list[Entry] = []
    for number, line in enumerate(file.read_bytes().splitlines(keepends=True), start=1):
        if not line.endswith(b"\n"):
            break
        try:
            entries.append(Entry.model_validate_json(line))
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            raise ValueError(
                f"{file}:{number}: {'.'.join(map(str, first['loc']))}: {first['msg']}; "
                "name another folder, or remove this one"
            ) from error
    return entries


def _fitting(path: Path, entries: list[Entry]) -> list[Entry]:
    """Leave out the entries at the end whose samples a power cut has taken."""
    there = {name: _size(path / name) for name in FILES}
    while entries and any(entries[-1].sizes[name] > there[name] for name in FILES):
        entries.pop()
    return entries


def _file_of(sample: Sample, recipe: Recipe) -> str:
    part = "planner" if sample.task == "planner" else "judge"
    return f"valid-{part}.jsonl" if for_validation(recipe.number) else f"{part}.jsonl"


def _append(path: Path, text: str) -> int:
    """Append `text`, on the disk before this returns, and return the file's size, bytes."""
    with path.open("ab") as stream:
        stream.write(text.encode())
        stream.flush()
        os.fsync(stream.fileno())
        return stream.tell()


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def _shorten(path: Path, size: int) -> None:
    if _size(path) > size:
        os.truncate(path, size)
