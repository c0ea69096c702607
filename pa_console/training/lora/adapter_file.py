"""Reads the file of an adapter: what it says of itself, and its matrices."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gguf
import numpy as np
from numpy.typing import NDArray

PREFIX = "pa_console.training"
"""Begins the metadata keys that say where an adapter comes from."""
CONFIG, BASE, BASE_SHA256, SAMPLES, EARLIER = (
    f"{PREFIX}.{key}" for key in ("config", "base", "base_sha256", "samples", "earlier")
)
REMEDY = "name the file of an adapter that pa-console train has made"


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
        """What the update is scaled by, times the rank; 0.0 where the file does not say."""
        value = self.metadata.get(gguf.Keys.Adapter.LORA_ALPHA)
        return value if isinstance(value, float) else 0.0

    @property
    def rank(self) -> int:
        """Rows of the first A; 0 where there is none."""
        found = (int(t.shape[-1]) for name, t in self.stored.items() if name.endswith(".lora_a"))
        return next(found, 0)

    def values(self, name: str, shape: tuple[int, int]) -> NDArray[np.float32]:
        """Return tensor `name`; raises ValueError when it is not there or not of `shape`."""
        if name not in self.stored:
            raise ValueError(f"{self.path}: tensor {name} is missing: {REMEDY}")
        tensor = self.stored[name]
        values = np.asarray(gguf.dequantize(tensor.data, tensor.tensor_type), np.float32)
        if values.shape != shape:
            raise ValueError(f"{self.path}: {name}: is of {values.shape}, not of {shape}: {REMEDY}")
        return values
