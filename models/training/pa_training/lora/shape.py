"""What kind of network a GGUF file holds, read from its metadata."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import gguf

ARCHITECTURES = ("llama", "qwen2", "gemma3")
"""Those whose forward pass `model.py` knows: RMS norm, gated units, rotary positions."""

GLOBAL_EVERY = 6
"""Where layers look back no further than a window, one of so many looks back all the way."""
LOCAL_ROPE_BASE = 10000.0
"""Of the layers with a window; llama.cpp has the same number for them."""

Activation = Literal["silu", "gelu"]


@dataclass(frozen=True)
class Shape:
    """Sizes of one decoder; widths in numbers, not bytes."""

    architecture: str
    layers: int
    width: int
    hidden: int
    heads: int
    kv_heads: int
    head_width: int
    context: int
    rope_base: float
    norm_epsilon: float
    window: int = 0
    """Positions that a local layer sees, its own among them; 0: every layer sees all of them."""

    @property
    def q_width(self) -> int:
        """Width of all query heads side by side."""
        return self.heads * self.head_width

    @property
    def kv_width(self) -> int:
        """Width of all key (or value) heads side by side."""
        return self.kv_heads * self.head_width

    @property
    def activation(self) -> Activation:
        """What the gate of a gated unit goes through."""
        return "gelu" if self.architecture == "gemma3" else "silu"

    @property
    def embedding_scale(self) -> float:
        """What embeddings are multiplied by before the first layer."""
        return self.width**0.5 if self.architecture == "gemma3" else 1.0

    def seen(self, layer: int) -> int:
        """Return how many positions `layer` (from 0) sees, 0 for all."""
        return self.window if (layer + 1) % GLOBAL_EVERY else 0

    @property
    def permuted(self) -> bool:
        """Whether the file holds the rows of q and k in pairs (x0, x1), not in halves."""
        return self.architecture == "llama"

    @property
    def paired_heads(self) -> dict[str, int]:
        """Heads of the layers whose rows the file holds in pairs, by llama.cpp's names."""
        return {"attn_q": self.heads, "attn_k": self.kv_heads} if self.permuted else {}


def read_shape(metadata: Mapping[str, object], source: str) -> Shape:
    """Return the shape that `metadata` tells; raises ValueError, naming `source` and the key."""
    architecture = str(metadata.get("general.architecture", ""))
    if architecture not in ARCHITECTURES:
        raise ValueError(
            f"{source}: general.architecture: {architecture!r} cannot be trained; "
            f"use a base of {' or '.join(ARCHITECTURES)}"
        )

    def number(key: str, default: float | None = None) -> float:
        value = metadata.get(f"{architecture}.{key}", default)
        if not isinstance(value, (int, float)):
            raise ValueError(f"{source}: {architecture}.{key}: not a number in the metadata")
        return value

    width, heads = int(number("embedding_length")), int(number("attention.head_count"))
    head_width = int(number("attention.key_length", width // heads))
    if int(number("rope.dimension_count", head_width)) != head_width:
        raise ValueError(f"{source}: rope.dimension_count: only whole heads can be rotated")
    return Shape(
        architecture=architecture,
        layers=int(number("block_count")),
        width=width,
        hidden=int(number("feed_forward_length")),
        heads=heads,
        kv_heads=int(number("attention.head_count_kv", heads)),
        head_width=head_width,
        context=int(number("context_length")),
        rope_base=number("rope.freq_base", 10000.0),
        norm_epsilon=number("attention.layer_norm_rms_epsilon"),
        window=int(number("attention.sliding_window", 0)) if architecture == "gemma3" else 0,
    )


def open_gguf(path: Path) -> tuple[gguf.GGUFReader, Shape]:
    """Open the GGUF file at `path`; raises ValueError when it cannot be trained, or OSError."""
    with path.open("rb") as file:
        if file.read(4) != b"GGUF":
            raise ValueError(f"{path}: not a GGUF file")
    reader = gguf.GGUFReader(path)
    metadata = {name: field.contents() for name, field in reader.fields.items()}
    return reader, read_shape(metadata, str(path))
