"""The adapters of a model: small files trained for one role each, shipped beside the catalogue."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from pydantic import Field

from pa_console.llm.errors import ModelError
from pa_console.llm.models.cache import hash_file
from pa_console.resources import data_folder
from pa_console.schema.base import StrictModel
from pa_console.schema.events.event import Role

REMEDY = (
    "install PA Console again, or take `adapters` and `prompts` out of the model's entry in "
    "models/catalog.yaml to use it without"
)


class AdapterFile(StrictModel):
    """A GGUF adapter in a catalogue entry; `file` is relative to the catalogue's folder."""

    file: str = Field(min_length=1)
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")

    @property
    def path(self) -> Path:
        """The place of the installed file."""
        return data_folder() / "models" / self.file


@dataclass(frozen=True)
class LocalAdapter:
    """An adapter file with the hash that it must have, and the role that answers with it."""

    role: Role
    path: Path
    sha256: str


def check_adapters(model: str, files: Mapping[Role, AdapterFile]) -> tuple[LocalAdapter, ...]:
    """Return the adapter of every role of `model`; outcomes are judged with the judge's.

    Raises ModelError, naming file and remedy, when one is missing or not the pinned one.
    """
    for role, file in files.items():
        _check(model, role, file)
    return pinned_adapters(files)


def pinned_adapters(files: Mapping[Role, AdapterFile]) -> tuple[LocalAdapter, ...]:
    """Return the adapter of every role as the catalogue pins it; none is read."""
    found = {role: LocalAdapter(role, file.path, file.sha256) for role, file in files.items()}
    if "judge" in found and "outcome" not in found:
        found["outcome"] = replace(found["judge"], role="outcome")
    return tuple(found.values())


def _check(model: str, role: Role, file: AdapterFile) -> None:
    try:
        digest = hash_file(file.path)
    except OSError as error:
        raise ModelError(
            f"{file.path}: the {role} adapter of {model} cannot be read "
            f"({error.strerror or error}): {REMEDY}"
        ) from error
    if digest != file.sha256:
        raise ModelError(
            f"{file.path}: not the {role} adapter that the catalogue pins for {model}: its "
            f"SHA-256 is {digest}, pinned is {file.sha256}: {REMEDY}"
        )
