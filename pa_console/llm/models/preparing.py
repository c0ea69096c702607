"""A model's prepared weights, which are made once from the fetched file and then loaded.

They have the type that is fastest on this machine, and only the vocabulary that is needed. For each
type, the same source gives the same bytes on every machine, whatever its CPU and number of threads,
so the catalogue can pin the SHA-256 of the result. Without a pin, a JSON file beside
`<name>-<how>.gguf` records the source and the hash. It is signed with this machine's key, which is
in another folder. If a prepared file does not match the pin or the record, it is made again.
"""

import shutil
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from filelock import FileLock
from pydantic import Field, ValidationError

from pa_console.llm.backend import PullError
from pa_console.llm.models.cache import (
    Progress,
    disk_problem,
    hash_file,
    models_folder,
    partial_folder,
    require_room,
    run_watched,
    silent,
)
from pa_console.schema.base import StrictModel
from pa_console.signing import SigningError, fingerprint, is_signature, known_keys, load_signer

Quantisation = Literal["f16", "bf16", "q8_0", "q4_0"]
COMMAND = ("-m", "pa_console.llm.models.gguf_conversion")
LLAMA_CPP = "llama-cpp-python"
PURPOSE = b"pa-console prepared weights\n"
AS_STORED = "stored"
BYTES_A_WEIGHT: dict[Quantisation, float] = {"f16": 2, "bf16": 2, "q8_0": 1.07, "q4_0": 0.57}
SOURCE_BYTES_A_WEIGHT = 0.5
"""The least number of bytes per weight in a source; thus the space needed is never underestimated.
"""

Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


@dataclass(frozen=True)
class Preparation:
    """The changes to a file: a new type of weights (None keeps the type), and a cut vocabulary."""

    quantisation: Quantisation | None = None
    vocabulary: int | None = None
    """The number of first pieces of which the ASCII pieces are kept; None keeps all pieces."""

    def __str__(self) -> str:
        parts = [f"{self.vocabulary} pieces"] if self.vocabulary else []
        return ", ".join([*parts, *([self.quantisation] if self.quantisation else [])])

    @property
    def weight_bytes(self) -> float:
        """The largest number of bytes per weight after the preparation."""
        return BYTES_A_WEIGHT[self.quantisation or "q8_0"]


class FileOrigin(StrictModel):
    """The signed record of a prepared file: its origin and its SHA-256.

    `signer` is a public key in hexadecimal; `signature` covers PURPOSE and the other fields.
    """

    source_sha256: Sha256
    quantisation: Quantisation | None
    vocabulary: int | None = None
    llama_cpp: str
    sha256: Sha256
    signer: str = ""
    signature: str = ""

    def of(self, how: Preparation, source_sha256: str) -> bool:
        """Return whether the file is the one that would be made now from this source by `how`."""
        expected = (source_sha256, how.quantisation, how.vocabulary, version(LLAMA_CPP))
        return expected == (self.source_sha256, self.quantisation, self.vocabulary, self.llama_cpp)

    def signed(self) -> "FileOrigin":
        """Return the record signed with this machine's key; raises SigningError."""
        signer = load_signer()
        unsigned = self.model_copy(update={"signer": signer.public, "signature": ""})
        signature = signer.sign(unsigned._signed_part())
        return unsigned.model_copy(update={"signature": signature})

    def is_ours(self) -> bool:
        """Return whether a key of this machine signed this record; raises SigningError."""
        if not is_signature(self.signature, self._signed_part(), self.signer):
            return False
        return fingerprint(self.signer) in known_keys()

    def _signed_part(self) -> bytes:
        return PURPOSE + self.model_dump_json(exclude={"signature"}).encode()


class PreparedFile(NamedTuple):
    """A checked prepared file."""

    path: Path
    sha256: str


def prepared_path(name: str, how: Preparation) -> Path:
    """Return the path of the prepared weights of model `name`, even if the file does not exist."""
    return models_folder() / f"{_prepared_name(name, how)}.gguf"


def find_pinned(name: str, how: Preparation, pin: Sha256) -> PreparedFile | None:
    """Return the prepared weights if they have the pinned SHA-256, else None."""
    path = prepared_path(name, how)
    try:
        return PreparedFile(path, pin) if hash_file(path) == pin else None
    except OSError:
        return None


def find_recorded(name: str, how: Preparation, source_sha256: str) -> PreparedFile | None:
    """Return the prepared weights if they match a record signed by this machine, else None.

    This is for unpinned weights. The record must have the hash of this source and of the file.
    """
    path = prepared_path(name, how)
    try:
        origin = FileOrigin.model_validate_json(_origin_path(path).read_bytes())
        if not (origin.of(how, source_sha256) and origin.is_ours()):
            return None
        return PreparedFile(path, origin.sha256) if hash_file(path) == origin.sha256 else None
    except (OSError, ValidationError, SigningError):
        return None


def prepare(
    name: str,
    how: Preparation,
    source: Path,
    source_sha256: str,
    progress: Progress = silent,
    *,
    pin: Sha256 | None = None,
) -> PreparedFile:
    """Return the prepared weights of `source`; if they do not exist, they are made now.

    The file appears only when it is complete and, if there is a `pin`, has this SHA-256. If another
    process is making it, this process waits. Raises PullError, with the remedy, if the disk has no
    room, if the file cannot be made, or if it does not have the pinned SHA-256.
    """
    path, folder = prepared_path(name, how), partial_folder(_prepared_name(name, how))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        folder.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(folder.with_suffix(f"{folder.suffix}.lock")):
            prepared = (
                find_pinned(name, how, pin) if pin else find_recorded(name, how, source_sha256)
            )
            if prepared is None:
                path.unlink(missing_ok=True)
                prepared = _make(path, folder, how, source, source_sha256, progress, pin)
            return prepared
    except OSError as error:
        raise PullError(disk_problem(error, folder)) from error


def _make(  # noqa: PLR0917
    path: Path,
    folder: Path,
    how: Preparation,
    source: Path,
    source_sha256: str,
    progress: Progress,
    pin: Sha256 | None,
) -> PreparedFile:
    total = int(source.stat().st_size / SOURCE_BYTES_A_WEIGHT * how.weight_bytes)
    folder.mkdir(parents=True, exist_ok=True)
    try:
        require_room(folder, total)
        partial = folder / path.name
        run_watched(
            [
                *COMMAND,
                str(source.absolute()),
                str(partial.absolute()),
                how.quantisation or AS_STORED,
                str(how.vocabulary or 0),
            ],
            environment={},
            folder=folder,
            report=lambda done: progress(min(done, total), total, f"preparing {how} weights"),
        )
        digest = hash_file(partial)
        if pin is None:
            _record(path, folder, how, source_sha256, digest)
        elif digest != pin:
            raise PullError(
                f"{source}: the {how} weights made from it by {LLAMA_CPP} {version(LLAMA_CPP)} "
                f"have the SHA-256 {digest}, but the catalogue pins {pin}; they were deleted: "
                "install PA Console again, or remove `prepare` and `vocabulary` from the model's "
                "entry in models/catalog.yaml to run the fetched file as it is"
            )
        partial.replace(path)
        progress(total, total, f"{how} weights are ready")
        return PreparedFile(path, digest)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _record(path: Path, folder: Path, how: Preparation, source_sha256: str, digest: str) -> None:
    """Write the record of a file beside `path`; without a signing key, no record is written."""
    origin = FileOrigin(
        source_sha256=source_sha256,
        quantisation=how.quantisation,
        vocabulary=how.vocabulary,
        llama_cpp=version(LLAMA_CPP),
        sha256=digest,
    )
    noted = folder / _origin_path(path).name
    try:
        noted.write_text(origin.signed().model_dump_json() + "\n", encoding="utf-8")
    except SigningError:
        _origin_path(path).unlink(missing_ok=True)
        return
    noted.replace(_origin_path(path))


def _prepared_name(name: str, how: Preparation) -> str:
    return "-".join(map(str, filter(None, (name, how.vocabulary, how.quantisation))))


def _origin_path(path: Path) -> Path:
    return path.with_suffix(".json")
