"""The forward pass of a decoder with an adapter, over packs that share a prefix.

Written by hand: the hub's model classes cannot attend to a prefix that many branches share, and
keep GGUF weights packed (445 tokens/s forward and backward on two cores).
"""

from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional

from pa_console.training.lora.adapter import Pair
from pa_console.training.lora.attention import Rotation, attend
from pa_console.training.lora.base import Base
from pa_console.training.lora.frozen import Frozen
from pa_console.training.lora.kernels import adapted, gated, normed
from pa_console.training.lora.layout import Layout
from pa_console.training.lora.shape import Shape


def hidden(
    base: Base,
    pairs: Sequence[Pair],
    tokens: Tensor,
    layout: Layout | Any,
    gather: Callable[[Tensor, Rotation, Any, Shape, int], Tensor] = attend,
) -> Tensor:
    """Return the normed last hidden states (tokens, width) of a pack; four pairs a layer.

    `gather` is attention over what `layout` lays out, which knows the `positions` of the tokens.
    """
    shape = base.shape
    rotation = Rotation.at(layout.positions, base.frequencies)
    local = Rotation.at(layout.positions, base.local_frequencies) if shape.window else rotation
    epsilon = shape.norm_epsilon
    x = functional.embedding(tokens, base.embedding) * shape.embedding_scale
    for number, layer in enumerate(base.layers):
        qkv, output, gate_up, down = pairs[4 * number : 4 * number + 4]
        window = shape.seen(number)
        h = normed(x, layer.attention_norm, epsilon)
        h = adapted(h, layer.qkv, qkv.a, qkv.b, layer.qkv_bias)
        if layer.head_norms is not None:
            h = _heads_normed(h, layer.head_norms, shape)
        h = gather(h, local if window else rotation, layout, shape, window)
        x = _added(x, h, layer.output, output, layer.output_norm, epsilon)
        h = normed(x, layer.hidden_norm, epsilon)
        h = gated(adapted(h, layer.gate_up, gate_up.a, gate_up.b), shape.activation)
        x = _added(x, h, layer.down, down, layer.down_norm, epsilon)
    return normed(x, base.norm, epsilon)


def _added(  # noqa: PLR0917
    x: Tensor, h: Tensor, weight: Frozen, pair: Pair, norm: Tensor | None, epsilon: float
) -> Tensor:
    """Return `x` plus what a linear layer makes of `h`, normed first where there is a `norm`."""
    if norm is None:
        return adapted(h, weight, pair.a, pair.b, x)
    return x + normed(adapted(h, weight, pair.a, pair.b), norm, epsilon)


def _heads_normed(qkv: Tensor, norms: tuple[Tensor, Tensor], shape: Shape) -> Tensor:
    """Return `qkv` (tokens, q, k and v) with every head of q and k normed."""
    q, k, v = torch.split(qkv, [shape.q_width, shape.kv_width, shape.kv_width], 1)
    heads = (part.reshape(-1, shape.head_width) for part in (q, k))
    q, k = (normed(x, n, shape.norm_epsilon) for x, n in zip(heads, norms, strict=True))
    return torch.cat((q.view(len(v), -1), k.view(len(v), -1), v), 1)
