"""Keeps a model's weights as they are to run, made once from the file that was fetched.

That is in the type that is fastest here, and with no more vocabulary than is needed. Beside
`<name>-<how>.gguf` stands a JSON file that says what it was made from and its hash; a prepared file
that does not fit it, or is of another version of llama.cpp, is made again.
"""

import errno
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Literal

from filelock import FileLock
from pydantic import Field, ValidationError

from pa_console.llm.cache import CACHE_VARIABLE, hash_file, models_folder, partial_folder
from pa_console.llm.errors import PullError
from pa_console.llm.room import require_room
from pa_console.llm.watched import run_watched
from pa_console.schema.base import StrictModel

Quantisation = Literal["f16", "bf16", "q8_0", "q4_0"]
Progress = Callable[[int, int, str], None]
"""Called with bytes done, bytes in all (estimated) and what is being done; may raise to stop."""

COMMAND = (sys.executable, "-P", "-m", "pa_console.llm.convert")
LLAMA_CPP = "llama-cpp-python"
AS_STORED = "stored"
BYTES_A_WEIGHT: dict[Quantisation, float] = {"f16": 2, "bf16": 2, "q8_0": 1.07, "q4_0": 0.57}
SOURCE_BYTES_A_WEIGHT = 0.5
"""The least that a weight takes in a source: what is needed is never guessed too low."""

Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


@dataclass(frozen=True)
class How:
    """What is done to a file: its weights in a type (None: as stored), its vocabulary cut."""

    quantisation: Quantisation | None = None
    vocabulary: int | None = None
    """Of the first so many pieces those in ASCII are kept, None: all there are."""

    def __str__(self) -> str:
        parts = [f"{self.vocabulary} pieces"] if self.vocabulary else []
        return ", ".join([*parts, *([self.quantisation] if self.quantisation else [])])

    @property
    def weight_bytes(self) -> float:
        """The most that a weight takes afterwards."""
        return BYTES_A_WEIGHT[self.quantisation or "q8_0"]


class Origin(StrictModel):
    """What a prepared file was made from, and the SHA-256 it has since."""

    source_sha256: Sha256
    quantisation: Quantisation | None
    vocabulary: int | None = None
    llama_cpp: str
    sha256: Sha256

    def of(self, how: How, source_sha256: str) -> bool:
        """Return whether the file is what would be made now."""
        wanted = (source_sha256, how.quantisation, how.vocabulary, version(LLAMA_CPP))
        return wanted == (self.source_sha256, self.quantisation, self.vocabulary, self.llama_cpp)


@dataclass(frozen=True)
class Prepared:
    """A prepared file that was checked."""

    path: Path
    sha256: str


def silent(_done: int, _total: int, _text: str) -> None:
    """Report nothing."""


def prepared_path(name: str, how: How) -> Path:
    """Return where the prepared weights of model `name` are kept; they may not be there."""
    return models_folder() / f"{_prepared_name(name, how)}.gguf"


def find_prepared(name: str, how: How, source_sha256: str) -> Prepared | None:
    """Return the prepared weights when they are whole and made from that source, else None."""
    path = prepared_path(name, how)
    try:
        origin = Origin.model_validate_json(_origin_path(path).read_bytes())
        if not origin.of(how, source_sha256):
            return None
        return Prepared(path, origin.sha256) if hash_file(path) == origin.sha256 else None
    except (OSError, ValidationError):
        return None


def prepare(
    name: str, how: How, source: Path, source_sha256: str, progress: Progress = silent
) -> Prepared:
    """Return the prepared weights of `source`, made now unless they are there.

    The file appears only when it is complete; another process that makes it is waited for. Raises
    PullError, naming the remedy, when there is no room or it cannot be made.
    """
    path, folder = prepared_path(name, how), partial_folder(_prepared_name(name, how))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        folder.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(folder.with_suffix(f"{folder.suffix}.lock")):
            found = find_prepared(name, how, source_sha256)
            if found is None:
                path.unlink(missing_ok=True)
                found = _make(path, folder, how, source, source_sha256, progress)
            return found
    except OSError as error:
        raise PullError(_explain(error, folder)) from error


def _make(  # noqa: PLR0917
    path: Path, folder: Path, how: How, source: Path, source_sha256: str, progress: Progress
) -> Prepared:
    total = int(source.stat().st_size / SOURCE_BYTES_A_WEIGHT * how.weight_bytes)
    folder.mkdir(parents=True, exist_ok=True)
    try:
        require_room(folder, total)
        partial = folder / path.name
        run_watched(
            [
                *COMMAND,
                str(source),
                str(partial),
                how.quantisation or AS_STORED,
                str(how.vocabulary or 0),
            ],
            environment={},
            folder=folder,
            report=lambda done: progress(min(done, total), total, f"preparing {how} weights"),
        )
        digest = hash_file(partial)
        origin = Origin(
            source_sha256=source_sha256,
            quantisation=how.quantisation,
            vocabulary=how.vocabulary,
            llama_cpp=version(LLAMA_CPP),
            sha256=digest,
        )
        noted = folder / _origin_path(path).name
        noted.write_text(origin.model_dump_json() + "\n", encoding="utf-8")
        noted.replace(_origin_path(path))
        partial.replace(path)
        progress(total, total, f"{how} weights are ready")
        return Prepared(path, digest)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _prepared_name(name: str, how: How) -> str:
    return "-".join(map(str, filter(None, (name, how.vocabulary, how.quantisation))))


def _origin_path(path: Path) -> Path:
    return path.with_suffix(".json")


def _explain(error: OSError, folder: Path) -> str:
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return f"the disk of {folder} is full: free some space, or set {CACHE_VARIABLE}"
    return f"{error.filename or folder}: {error.strerror or error}"
