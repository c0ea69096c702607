"""The catalogue of models: their names, their sources, and their files on this machine."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator
from rapidfuzz import fuzz, process

from pa_console.llm.backend import ChatFormat, ModelError, names_backend
from pa_console.llm.models.cache import Progress, hash_file, models_folder, silent
from pa_console.llm.models.gguf_bounds import MAGIC
from pa_console.llm.models.preparing import (
    Preparation,
    Quantisation,
    Sha256,
    find_pinned,
    prepare,
    prepared_path,
)
from pa_console.llm.remote.address import PREFIX, ServerAddress
from pa_console.llm.roles.role_model import PromptFormatName
from pa_console.resources import data_folder
from pa_console.schema.base import StrictModel
from pa_console.schema.document import Document
from pa_console.schema.events.event import Role

REMEDY = (
    "install PA Console again, or remove `adapters` and `prompts` from the model's entry in "
    "models/catalog.yaml to use the model without adapters"
)

NO_READER = "off"
"""The value of `second_reader` that selects no second reader."""
MODEL_NAME = r"^[A-Za-z0-9][A-Za-z0-9._-]*$"
CPU_INFO = Path("/proc/cpuinfo")
WIDE = "avx512f"
N_CTX = 4096
"""The default number of tokens for a role's prompt and answer together."""


class AdapterFile(StrictModel):
    """A GGUF adapter in a catalogue entry; `file` is relative to the catalogue's folder."""

    file: str = Field(min_length=1)
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")

    @property
    def path(self) -> Path:
        """The path of the installed file."""
        return data_folder() / "models" / self.file


@dataclass(frozen=True)
class LocalAdapter:
    """An adapter file with the hash that it must have, and the role that uses it."""

    role: Role
    path: Path
    sha256: str


def check_adapters(model: str, files: Mapping[Role, AdapterFile]) -> tuple[LocalAdapter, ...]:
    """Return the adapter of every role of `model`; outcomes use the judge's adapter.

    Raises ModelError, with file and remedy, if an adapter is missing or is not the pinned one.
    """
    for role, file in files.items():
        _check(model, role, file)
    return pinned_adapters(files)


def pinned_adapters(files: Mapping[Role, AdapterFile]) -> tuple[LocalAdapter, ...]:
    """Return the adapter of every role as the catalogue pins it, without reading the files."""
    adapters = {role: LocalAdapter(role, file.path, file.sha256) for role, file in files.items()}
    if "judge" in adapters and "outcome" not in adapters:
        adapters["outcome"] = replace(adapters["judge"], role="outcome")
    return tuple(adapters.values())


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
            f"SHA-256 is {digest}, but {file.sha256} is pinned: {REMEDY}"
        )


def fastest_type(cpu_info: Path = CPU_INFO) -> Quantisation:
    """Return bf16 for a CPU with AVX-512, else f16; f16 also if `cpu_info` (Linux) is missing.

    Both types have the same size, but f16 keeps three more bits of each weight than bf16.
    """
    try:
        text = cpu_info.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return "f16"
    return "bf16" if WIDE in text.split() else "f16"


class PathSource(StrictModel):
    """A file that is already on this machine; it is never copied."""

    kind: Literal["path"] = "path"
    path: str


class HubSource(StrictModel):
    """A file in a repository of the model hub, which needs the optional extra `hub`."""

    kind: Literal["hub"]
    repo: str
    file: str
    revision: str = "main"


class PackageSource(StrictModel):
    """A file that is cut into `parts`, each in a Python package.

    `{n}` in `package` stands for the number of the part, from 1. `member` is a glob that matches
    exactly one path inside each wheel.
    """

    kind: Literal["packages"]
    package: str
    version: str
    member: str
    parts: int = Field(default=1, ge=1, le=999)

    def requirement(self, part: int) -> str:
        """Return the exact requirement of one part."""
        return f"{self.package.replace('{n}', str(part))}=={self.version}"

    @model_validator(mode="after")
    def _numbered(self) -> Self:
        if (self.parts > 1) != ("{n}" in self.package):
            raise ValueError("package must contain {n} if there are several parts, and only then")
        return self


WeightsSource = Annotated[PathSource | HubSource | PackageSource, Field(discriminator="kind")]


class ModelEntry(StrictModel):
    """A model of the catalogue; `sha256` is None if no trusted hash of its file is known.

    `prepare` is the type to which the weights are converted after the download, or `fastest` for
    the fastest type on this machine; `prepared` pins the hashes of the converted files. Adapters
    are trained on the compact prompts. A model without adapters states its reading of an order in
    clauses.
    """

    name: str = Field(pattern=MODEL_NAME)
    weights: str = Field(
        default="", description="another entry with the same file, which is then stored only once"
    )
    title: str
    licence: str
    parameters: str
    quantisation: str
    size_mb: int = Field(gt=0)
    sha256: Sha256 | None
    chat: ChatFormat = "template"
    prepare: Quantisation | Literal["fastest"] | None = None
    vocabulary: int | None = Field(
        default=None, ge=1000, description="number of first pieces of which ASCII pieces are kept"
    )
    prepared: dict[Quantisation, Sha256] = Field(
        default={}, description="the SHA-256 of the prepared file of each type"
    )
    adapters: dict[Role, AdapterFile] = {}
    prompts: PromptFormatName = "clauses"
    n_ctx: int = Field(default=N_CTX, ge=512)
    second_reader: str = Field(
        default="",
        description="another model for orders that this one is unsure about, if it is installed",
    )
    notes: str = ""
    sources: tuple[WeightsSource, ...] = Field(min_length=1)

    @property
    def description(self) -> str:
        """One line for lists: title, type of weights, size and licence."""
        return f"{self.title}, {self.quantisation}, {self.size_mb} MB, {self.licence}"

    @property
    def stem(self) -> str:
        """The name of the entry's file in the folder of models."""
        return self.weights or self.name

    @property
    def local_file(self) -> Path | None:
        """The unchecked path of the model's file; None if it is not on this machine."""
        paths = [Path(s.path).expanduser() for s in self.sources if isinstance(s, PathSource)]
        paths.append(models_folder() / f"{self.stem}.gguf")
        return next((path for path in paths if path.is_file()), None)

    @property
    def how(self) -> Preparation | None:
        """The preparation of the file on this machine; None if it is used unchanged."""
        kind = fastest_type() if self.prepare == "fastest" else self.prepare
        return Preparation(kind, self.vocabulary) if kind or self.vocabulary else None

    @property
    def prepared_file(self) -> Path | None:
        """The unchecked path of the prepared weights; None if they are not on this machine."""
        path = prepared_path(self.stem, self.how) if self.how else None
        return path if path is not None and path.is_file() else None

    def pin(self, how: Preparation | None) -> Sha256 | None:
        """Return the pinned SHA-256 of the file that is loaded; None if the catalogue has none.

        For a file prepared by `how`, it is the pin for the type; for an unchanged file, `sha256`.
        """
        if how is None:
            return self.sha256
        kind = how.quantisation
        return self.prepared.get(kind) if kind and how.vocabulary == self.vocabulary else None

    def ready_file(self, path: Path, progress: Progress = silent) -> tuple[Path, str]:
        """Return the file to load, and its hash; the fetched file `path` is prepared if necessary.

        Raises ModelError if `path` is not the pinned file or cannot be prepared.
        """
        return self._made(self.how, path, progress)

    def learnt_file(self, path: Path) -> Path:
        """Return the file on which adapters are trained, with the vocabulary that the model uses.

        If the type of the weights depends on the machine, they stay as published; otherwise they
        have the type that is run. Cutting a vocabulary takes 20 s, once. Raises ModelError like
        `ready_file`.
        """
        if self.prepare not in {None, "fastest"}:
            return self._made(self.how, path, silent)[0]
        if self.vocabulary is None:
            return path
        return self._made(Preparation(None, self.vocabulary), path, silent)[0]

    def _made(self, how: Preparation | None, path: Path, progress: Progress) -> tuple[Path, str]:
        if how is None:
            return path, self.check(path)
        pin = self.pin(how)
        prepared = find_pinned(self.stem, how, pin) if pin else None
        if prepared is None:
            prepared = prepare(self.stem, how, path, self.check(path), progress, pin=pin)
        return prepared

    def as_pinned(self) -> "LocalModel | None":
        """Return the prepared model with the pinned hashes; None if it is missing or unpinned.

        Nothing is hashed here, because the process that loads the files hashes them first.
        """
        path, pin = self.prepared_file, self.pin(self.how)
        if path is None or pin is None:
            return None
        return self.located(path, pin, pinned_adapters(self.adapters))

    def located(
        self,
        path: Path,
        sha256: str,
        adapters: tuple[LocalAdapter, ...],
        reader: "LocalModel | None" = None,
    ) -> "LocalModel":
        """Return this model with the file at `path`."""
        return LocalModel(
            self.name,
            path,
            sha256,
            self.chat,
            self.description,
            adapters,
            self.prompts,
            self.n_ctx,
            reader,
        )

    def check(self, path: Path) -> str:
        """Return the SHA-256 of `path`; raises ModelError unless it is the pinned one."""
        digest = hash_file(path)
        if self.sha256 not in (None, digest):
            raise ModelError(
                f"{path}: not the pinned file of {self.name}: its SHA-256 is {digest}, the "
                f"catalogue pins {self.sha256}; delete it and pull the model again"
            )
        return digest

    @model_validator(mode="after")
    def _compact_prompts_have_adapters(self) -> Self:
        if self.prompts == "compact" and not {"planner", "judge"} <= set(self.adapters):
            raise ValueError("prompts: compact needs an adapter for planner and for judge")
        return self


@dataclass(frozen=True)
class LocalModel:
    """A checked model file on this machine; `sha256` is the hash of the file that is loaded."""

    name: str
    path: Path
    sha256: str
    chat: ChatFormat = "template"
    description: str = ""
    adapters: tuple[LocalAdapter, ...] = ()
    prompts: PromptFormatName = "examples"
    n_ctx: int = N_CTX
    second_reader: "LocalModel | None" = None
    """The model that reads an order again if this model is unsure about it; None if there is none.
    """

    @property
    def fingerprint(self) -> str:
        """A hash of weights and adapters; models with the same fingerprint give equal answers."""
        if not self.adapters:
            return self.sha256
        parts = [self.sha256, *(f"{item.role} {item.sha256}" for item in self.adapters)]
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()


class ServerEntry(StrictModel):
    """A model on a server; its `address`, such as openai:BASE_URL#NAME, contains no key."""

    name: str = Field(pattern=MODEL_NAME)
    title: str
    address: str

    @field_validator("address")
    @classmethod
    def _is_one(cls, address: str) -> str:
        if names_backend(address) and not address.startswith(PREFIX):
            return address
        try:
            return str(ServerAddress.parse(address))
        except ModelError as error:
            raise ValueError(str(error)) from error


class Catalog(StrictModel):
    """All models of a catalogue, and the name of the default model."""

    default: str
    models: tuple[ModelEntry, ...] = Field(min_length=1)
    servers: tuple[ServerEntry, ...] = ()

    @classmethod
    def load(cls, path: Path | None = None) -> "Catalog":
        """Read a catalogue, by default the installed one; raises DocumentError."""
        return Document.read(path or data_folder() / "models" / "catalog.yaml").parse(cls)

    def get(self, name: str) -> ModelEntry:
        """Return the model called `name`, or an entry for the GGUF file at the path `name`.

        Otherwise raises ModelError with the known names, and the name that is most like `name`.
        """
        entries = {entry.name: entry for entry in self.models}
        if name in entries:
            return entries[name]
        if names_backend(name) or name in {entry.name for entry in self.servers}:
            raise ModelError(
                f"{name} is on a server, but a model on this machine is needed here; a server's "
                "model plans only in console and mission"
            )
        path = Path(name).expanduser()
        if path.suffix == ".gguf" or path.is_file():
            return _entry_from_file(path)
        if path.exists():
            raise ModelError(
                f"{path}: not a GGUF file; give the path of a GGUF file, or the name of a model"
            )
        nearest = process.extractOne(name, list(entries), scorer=fuzz.ratio, score_cutoff=60)
        hint = f" Did you mean {nearest[0]}?" if nearest else ""
        raise ModelError(
            f"unknown model {name!r}.{hint} Known: {', '.join(entries)}; or give a path to a .gguf"
        )

    def locate(
        self, name: str, progress: Progress = silent, second_reader: str = NO_READER
    ) -> LocalModel:
        """Return the model `name` with its checked file on this machine.

        `second_reader` is the name of a model; '' means the model that the entry names, if it is on
        this machine. Hashing takes about 1 s per GB. Unprepared weights are prepared now, which
        takes 1 s per 100 MB. Raises ModelError if the model is unknown, was not pulled yet or
        cannot be prepared, or if a file is not the pinned one.
        """
        entry = self.get(name)
        path = entry.local_file
        if path is None:
            raise ModelError(
                f"model {entry.name} is not on this machine ({entry.size_mb} MB): "
                f"run `pa-console models pull {entry.name}`"
            )
        try:
            path, digest = entry.ready_file(path, progress)
        except OSError as error:
            raise ModelError(f"{path}: {error.strerror or error}") from error
        adapters = check_adapters(entry.name, entry.adapters)
        reader = self._reader_after(entry, second_reader, progress)
        return entry.located(path, digest, adapters, reader)

    def _reader_after(
        self, entry: ModelEntry, override: str, progress: Progress
    ) -> LocalModel | None:
        """Return the second reader of `entry`, or the model `override`; None if there is none."""
        name = override or entry.second_reader
        if name in {"", NO_READER, entry.name} or entry.prompts != "compact":
            return None
        if not override and self.get(name).local_file is None:
            return None
        return self.get(name).as_pinned() or self.locate(name, progress)

    @model_validator(mode="after")
    def _names_are_unique(self) -> Self:
        names = [entry.name for entry in (*self.models, *self.servers)]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"models: the name {name!r} appears twice")
        for entry in self.models:
            twin = next((e for e in self.models if e.name == entry.stem), None)
            if twin is None or twin.sha256 != entry.sha256:
                raise ValueError(f"{entry.name}: weights: no model {entry.stem!r} has this SHA-256")
            if entry.second_reader and entry.second_reader not in names:
                raise ValueError(f"{entry.name}: second_reader: no model {entry.second_reader!r}")
            if entry.second_reader == entry.name:
                raise ValueError(f"{entry.name}: second_reader: it must be another model")
        if self.default not in names:
            raise ValueError(f"default: {self.default!r} is not one of the models")
        return self


def find_model(
    name: str | None, progress: Progress = silent, second_reader: str = NO_READER
) -> LocalModel:
    """Return a model of the installed catalogue or of a file; the name None means the default.

    `second_reader` and the errors are those of `Catalog.locate`.
    """
    catalog = Catalog.load()
    return catalog.locate(name or catalog.default, progress, second_reader)


def _entry_from_file(path: Path) -> ModelEntry:
    if not path.is_file():
        raise ModelError(f"{path}: no such model file")
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise ModelError(f"{path}: not a GGUF file; fetch it again, or use another file")
    size_mb = max(1, path.stat().st_size // 1_000_000)
    return ModelEntry.model_construct(
        name=path.stem,
        title=path.name,
        licence="licence unknown",
        parameters="?",
        quantisation="GGUF",
        size_mb=size_mb,
        sha256=None,
        chat="template",
        notes="",
        sources=(PathSource(path=str(path.resolve())),),
    )
