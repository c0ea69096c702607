"""The frozen weights: a GGUF file dequantised exactly as it is stored.

The adapter learns on the rounding errors of the quantisation that will run, so that it can make
up for them.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gguf
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pa_training.lora.frozen import Exact, Frozen
from pa_training.lora.shape import LOCAL_ROPE_BASE, Shape, open_gguf


@dataclass(frozen=True)
class Layer:
    """Frozen weights of one layer; matrices (outputs, inputs), parallel ones joined by rows."""

    attention_norm: Tensor
    qkv: Frozen
    qkv_bias: Tensor | None
    head_norms: tuple[Tensor, Tensor] | None
    """Of each head of q and of k (head_width)."""
    output: Frozen
    output_norm: Tensor | None
    hidden_norm: Tensor
    gate_up: Frozen
    down: Frozen
    down_norm: Tensor | None


@dataclass(frozen=True)
class Base:
    """All frozen weights; `embedding` and `head` are (vocabulary, width), often the same."""

    path: Path
    shape: Shape
    embedding: Tensor
    layers: tuple[Layer, ...]
    norm: Tensor
    head: Tensor
    frequencies: Tensor
    """Radians a position of each pair of a head, float32 (head_width / 2)."""
    local_frequencies: Tensor
    """The same in layers with a window."""


def read_base(path: Path, device: str = "cpu", dtype: torch.dtype = torch.float32) -> Base:
    """Read the GGUF file at `path`; raises ValueError when it cannot be trained, or OSError."""
    weights = _Weights(path, device, dtype)
    embedding = weights.get("token_embd")
    return Base(
        path=path,
        shape=weights.shape,
        embedding=embedding,
        layers=tuple(_layer(weights, f"blk.{n}") for n in range(weights.shape.layers)),
        norm=weights.get("output_norm"),
        head=weights.get("output") if weights.has("output") else embedding,
        frequencies=_frequencies(weights).to(device),
        local_frequencies=_turns(weights.shape, LOCAL_ROPE_BASE).to(device),
    )


def to_halves(rows: NDArray[np.float32], heads: int) -> NDArray[np.float32]:
    """Reorder the rows of each head from pairs (x0, y0, x1, y1) to halves (x0, x1, y0, y1)."""
    return rows.reshape(heads, -1, 2, *rows.shape[1:]).swapaxes(1, 2).reshape(rows.shape)


def to_pairs(rows: NDArray[np.float32], heads: int) -> NDArray[np.float32]:
    """Reorder the rows of each head as llama.cpp keeps them: the inverse of `to_halves`."""
    return rows.reshape(heads, 2, -1, *rows.shape[1:]).swapaxes(1, 2).reshape(rows.shape)


class _Weights:
    """The tensors of one file, by llama.cpp's names."""

    def __init__(self, path: Path, device: str, dtype: torch.dtype) -> None:
        self._path, self._device, self._dtype = path, device, dtype
        reader, self.shape = open_gguf(path)
        self._stored = {tensor.name: tensor for tensor in reader.tensors}

    def has(self, name: str, part: str = "weight") -> bool:
        return f"{name}.{part}" in self._stored

    def values(self, name: str, part: str = "weight") -> NDArray[np.float32]:
        """Return a tensor as it is stored; raises ValueError when the file has none."""
        if not self.has(name, part):
            raise ValueError(f"{self._path}: tensor {name}.{part} is missing")
        tensor: Any = self._stored[f"{name}.{part}"]
        return np.asarray(gguf.dequantize(tensor.data, tensor.tensor_type), np.float32)

    def optional(self, name: str) -> Tensor | None:
        """Return a tensor, None when the file has none."""
        return self.get(name) if self.has(name) else None

    def get(self, *names: str, part: str = "weight") -> Tensor:
        """Return tensors joined by rows, q and k with their heads in halves."""
        rows: list[NDArray[np.float32]] = []
        for name in names:
            values = self.values(name, part)
            heads = self.shape.paired_heads.get(name.rpartition(".")[2])
            if heads is not None:
                values = to_halves(values, heads)
            rows.append(values)
        joined = torch.from_numpy(np.ascontiguousarray(np.concatenate(rows)))
        return joined.to(device=self._device, dtype=self._dtype)


def _layer(weights: _Weights, name: str) -> Layer:
    qkv = [f"{name}.attn_{part}" for part in "qkv"]
    q_norm, k_norm = (weights.optional(f"{name}.attn_{part}_norm") for part in "qk")
    return Layer(
        attention_norm=weights.get(f"{name}.attn_norm"),
        qkv=Exact(weights.get(*qkv)),
        qkv_bias=weights.get(*qkv, part="bias") if weights.has(qkv[0], "bias") else None,
        head_norms=None if q_norm is None or k_norm is None else (q_norm, k_norm),
        output=Exact(weights.get(f"{name}.attn_output")),
        output_norm=weights.optional(f"{name}.post_attention_norm"),
        hidden_norm=weights.get(f"{name}.ffn_norm"),
        gate_up=Exact(weights.get(f"{name}.ffn_gate", f"{name}.ffn_up")),
        down=Exact(weights.get(f"{name}.ffn_down")),
        down_norm=weights.optional(f"{name}.post_ffw_norm"),
    )


def _frequencies(weights: _Weights) -> Tensor:
    """Return the rotary frequencies, stretched where the file says so (`rope_freqs`)."""
    frequencies = _turns(weights.shape, weights.shape.rope_base)
    if weights.has("rope_freqs"):
        frequencies /= torch.from_numpy(weights.values("rope_freqs"))
    return frequencies


def _turns(shape: Shape, base: float) -> Tensor:
    half = shape.head_width // 2
    return base ** -(torch.arange(half, dtype=torch.float32) / half)
