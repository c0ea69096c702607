"""Adapter files: the matrices that llama.cpp loads beside a base, and their origin as metadata.

A linear layer has two matrices, A (rank, inputs) and B (outputs, rank), by llama.cpp's names. In
memory the rows of B are in the order that the network computes with.
"""

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gguf
import numpy as np
from numpy.typing import NDArray

from pa_training.adapters.config import TrainConfig

Array = NDArray[np.float32]
Matrices = dict[str, tuple[Array, Array]]
"""A and B by the name of their layer, such as `blk.0.attn_q`."""

PREFIX = "pa_console.training"
"""Begins the metadata keys about an adapter's origin."""
CONFIG, BASE, BASE_SHA256, DATA_SHA256, STEPS, SAMPLES, EARLIER = (
    f"{PREFIX}.{key}"
    for key in ("config", "base", "base_sha256", "data_sha256", "steps", "samples", "earlier")
)
REMEDY = "name the file of an adapter that this trainer has made"
ENDS = ("lora_a", "lora_b")


@dataclass(frozen=True)
class AdapterFile:
    """An adapter's metadata, and its tensors by llama.cpp's names."""

    path: Path
    metadata: Mapping[str, object]
    stored: Mapping[str, Any]

    @classmethod
    def open(cls, path: Path) -> "AdapterFile":
        """Open the file at `path`; raises ValueError when it is no adapter, or OSError."""
        with path.open("rb") as file:
            if file.read(4) != b"GGUF":
                raise ValueError(f"{path}: not a GGUF file: {REMEDY}")
        try:
            reader = gguf.GGUFReader(path)
            metadata = {name: field.contents() for name, field in reader.fields.items()}
        except Exception as error:  # gguf raises what it likes
            raise ValueError(f"{path}: not a whole GGUF file ({error}): copy it anew") from error
        kinds = metadata.get(gguf.Keys.General.TYPE), metadata.get(gguf.Keys.Adapter.TYPE)
        if kinds != (gguf.GGUFType.ADAPTER, "lora"):
            raise ValueError(f"{path}: is not a LoRA adapter: {REMEDY}")
        return cls(path, metadata, {tensor.name: tensor for tensor in reader.tensors})

    def text(self, key: str) -> str:
        """Return the metadata under `key`; empty where there is none."""
        return str(self.metadata.get(key, ""))

    @property
    def alpha(self) -> float:
        """The scale of the update, times the rank; 0.0 where the file does not have it."""
        value = self.metadata.get(gguf.Keys.Adapter.LORA_ALPHA)
        return value if isinstance(value, float) else 0.0

    def matrices(self, paired_heads: Mapping[str, int]) -> Matrices:
        """Return the matrices of every layer; raises ValueError where half of a pair is missing.

        `paired_heads` are as in `write_adapter`.
        """
        found: Matrices = {}
        for layer in dict.fromkeys(name.rpartition(".weight.")[0] for name in self.stored):
            a, b = (self._values(f"{layer}.weight.{end}") for end in ENDS)
            heads = paired_heads.get(layer.rpartition(".")[2])
            found[layer] = a, b if heads is None else to_halves(b, heads)
        return found

    def _values(self, name: str) -> Array:
        if name not in self.stored:
            raise ValueError(f"{self.path}: tensor {name} is missing: {REMEDY}")
        tensor = self.stored[name]
        return np.asarray(gguf.dequantize(tensor.data, tensor.tensor_type), np.float32)


def write_adapter(  # noqa: PLR0917
    target: Path,
    architecture: str,
    matrices: Matrices,
    paired_heads: Mapping[str, int],
    config: TrainConfig,
    origin: Mapping[str, str],
) -> str:
    """Write `matrices` to `target` and return its SHA-256; `origin` is metadata by its keys.

    `paired_heads` has the heads of the layers whose rows a base of that `architecture` holds in
    pairs, by the last part of their names. Raises ValueError when the matrices do not fit the type
    that the config asks for, or OSError.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = target.with_name(f"{target.name}.partial")
    writer = gguf.GGUFWriter(partial, architecture)
    writer.add_type(gguf.GGUFType.ADAPTER)
    writer.add_string(gguf.Keys.Adapter.TYPE, "lora")
    writer.add_float32(gguf.Keys.Adapter.LORA_ALPHA, config.alpha)
    named = config.without_folders()
    writer.add_name(f"{named.task} adapter of {named.base}")
    for key, value in {CONFIG: named.model_dump_json(), **origin}.items():
        writer.add_string(key, value)
    kind = gguf.GGMLQuantizationType[config.stored.upper()]
    for layer, (a, b) in matrices.items():
        heads = paired_heads.get(layer.rpartition(".")[2])
        for end, values in zip(ENDS, (a, b if heads is None else to_pairs(b, heads)), strict=True):
            try:
                stored = gguf.quantize(np.ascontiguousarray(values), kind)
            except gguf.QuantError as error:
                raise ValueError(f"stored: {layer}: {error}: set stored=f16") from error
            writer.add_tensor(f"{layer}.weight.{end}", stored, raw_dtype=kind)
    writer.write_header_to_file()
    writer.write_kv_data_to_file()
    writer.write_tensors_to_file()
    writer.close()
    os.replace(partial, target)
    return hashlib.sha256(target.read_bytes()).hexdigest()


def to_halves(rows: Array, heads: int) -> Array:
    """Reorder the rows of each head from pairs (x0, y0, x1, y1) to halves (x0, x1, y0, y1)."""
    return rows.reshape(heads, -1, 2, *rows.shape[1:]).swapaxes(1, 2).reshape(rows.shape)


def to_pairs(rows: Array, heads: int) -> Array:
    """Reorder the rows of each head as llama.cpp keeps them: the inverse of `to_halves`."""
    return rows.reshape(heads, 2, -1, *rows.shape[1:]).swapaxes(1, 2).reshape(rows.shape)
