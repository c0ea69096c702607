"""The trainable weights: low-rank corrections of every linear layer, and the file of an adapter.

A lower rank keeps what it can: the nearest correction of that rank in the sum of squares (Eckart
and Young 1936).

Layers that read the same input are computed as one (q, k and v; gate and up): their A matrices are
stacked and their B matrices stand on the diagonal of one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import gguf
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pa_training.lora.shape import Shape

PREFIX = "pa_console.training"
"""Begins the metadata keys that say where an adapter comes from."""
CONFIG, BASE, BASE_SHA256, SAMPLES, EARLIER = (
    f"{PREFIX}.{key}" for key in ("config", "base", "base_sha256", "samples", "earlier")
)
REMEDY = "name the file of an adapter that this trainer has made"


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


@dataclass(frozen=True)
class Slot:
    """Linear layers that share an input, by llama.cpp's names, with their output widths."""

    parts: tuple[str, ...]
    inputs: int
    outputs: tuple[int, ...]


def slots(shape: Shape) -> tuple[Slot, ...]:
    """Return the four slots of every layer, in the order in which they are computed."""
    return (
        Slot(
            ("attn_q", "attn_k", "attn_v"),
            shape.width,
            (shape.q_width, shape.kv_width, shape.kv_width),
        ),
        Slot(("attn_output",), shape.q_width, (shape.width,)),
        Slot(("ffn_gate", "ffn_up"), shape.width, (shape.hidden, shape.hidden)),
        Slot(("ffn_down",), shape.hidden, (shape.width,)),
    )


@dataclass(frozen=True)
class Pair:
    """What the forward pass multiplies with: A (ranks, inputs) and scaled B (outputs, ranks)."""

    a: Tensor
    b: Tensor


class Adapter:
    """Float32 master weights of a fresh adapter: A random, B zero, so that it changes nothing.

    `masters` holds, layer after layer and slot after slot, A of (rank * parts, inputs) and then B
    of (outputs, rank).
    """

    def __init__(
        self, shape: Shape, rank: int, alpha: float, seed: int, device: str | torch.device
    ) -> None:
        self.rank, self.alpha = rank, alpha
        self.slots = slots(shape) * shape.layers
        generator = torch.Generator().manual_seed(seed)
        self.masters: list[Tensor] = []
        for slot in self.slots:
            bound = slot.inputs**-0.5
            a = torch.rand(rank * len(slot.parts), slot.inputs, generator=generator)
            b = torch.zeros(sum(slot.outputs), rank)
            self.masters += [(a * 2 * bound - bound).to(device), b.to(device)]
        for master in self.masters:
            master.requires_grad_()

    @property
    def size(self) -> int:
        """How many numbers are trained."""
        return sum(master.numel() for master in self.masters)

    def working(self, dtype: torch.dtype) -> list[Pair]:
        """Return copies for the forward pass, leaves of their own graph, one pair a slot."""
        with torch.no_grad():
            scale = self.alpha / self.rank
            pairs: list[Pair] = []
            for slot, a, b in self._each(self.masters):
                blocks = cast(Tensor, torch.block_diag(*torch.split(b, list(slot.outputs)))) * scale
                pairs.append(Pair(a.to(dtype, copy=True), blocks.to(dtype)))
        for pair in pairs:
            pair.a.requires_grad_()
            pair.b.requires_grad_()
        return pairs

    def set_gradients(self, gradients: Sequence[Tensor]) -> None:
        """Give the masters the `gradients` of their working copies (A, B, A, B...)."""
        scale = self.alpha / self.rank
        for number, (slot, a, b) in enumerate(self._each(self.masters)):
            a.grad = gradients[2 * number].float()
            blocks = torch.split(gradients[2 * number + 1], list(slot.outputs))
            kept = [x[:, n * self.rank : (n + 1) * self.rank] for n, x in enumerate(blocks)]
            b.grad = torch.cat(kept).float() * scale

    def _each(self, tensors: Sequence[Tensor]) -> list[tuple[Slot, Tensor, Tensor]]:
        return [(s, tensors[2 * n], tensors[2 * n + 1]) for n, s in enumerate(self.slots)]


def of_other_rank(masters: Sequence[Tensor], rank: int, alpha: float, wanted: Adapter) -> None:
    """Write to the masters of `wanted` what `masters`, of `rank` and `alpha`, correct.

    `wanted` is fresh: where it is of a higher rank, its further rows are left as they are.
    """
    kept = min(rank, wanted.rank)
    scale = (alpha / rank) / (wanted.alpha / wanted.rank)
    with torch.no_grad():
        for number, slot in enumerate(wanted.slots):
            parts = len(slot.parts)
            new_a, new_b = wanted.masters[2 * number : 2 * number + 2]
            a = masters[2 * number].view(parts, rank, slot.inputs)
            b = torch.split(masters[2 * number + 1] * scale, list(slot.outputs))
            pairs = [_nearest(*pair, kept) for pair in zip(a, b, strict=True)]
            new_a.view(parts, wanted.rank, -1)[:, :kept] = torch.stack([a for a, _ in pairs])
            new_b[:, :kept] = torch.cat([b for _, b in pairs])


def _nearest(a: Tensor, b: Tensor, rank: int) -> tuple[Tensor, Tensor]:
    """Return matrices of `rank` whose product b a is the nearest to that of A and B."""
    if rank == a.shape[0]:
        return a, b
    basis_a, small_a = torch.linalg.qr(a.T)
    basis_b, small_b = torch.linalg.qr(b)
    left, sizes, right = torch.linalg.svd(small_b @ small_a.T)
    roots = sizes[:rank].sqrt()
    return (roots[:, None] * right[:rank]) @ basis_a.T, basis_b @ (left[:, :rank] * roots)
