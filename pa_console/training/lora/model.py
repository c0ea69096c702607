"""The forward pass of a decoder with an adapter, over packs that share a prefix.

Written by hand: the hub's model classes cannot attend to a prefix that many branches share, and
keep GGUF weights packed (445 tokens/s forward and backward on two cores).
"""

from collections.abc import Sequence

from torch import Tensor
from torch.nn import functional

from pa_console.training.lora.adapter import Pair
from pa_console.training.lora.attention import Rotation, attend
from pa_console.training.lora.base import Base
from pa_console.training.lora.kernels import adapted, gated, normed
from pa_console.training.lora.layout import Layout


def hidden(base: Base, pairs: Sequence[Pair], tokens: Tensor, layout: Layout) -> Tensor:
    """Return the normed last hidden states (tokens, width) of a pack; four pairs a layer."""
    rotation = Rotation.at(layout.positions, base.frequencies)
    epsilon = base.shape.norm_epsilon
    x = functional.embedding(tokens, base.embedding)
    for number, layer in enumerate(base.layers):
        qkv, output, gate_up, down = pairs[4 * number : 4 * number + 4]
        h = normed(x, layer.attention_norm, epsilon)
        h = adapted(h, layer.qkv, qkv.a, qkv.b, layer.qkv_bias)
        h = attend(h, rotation, layout, base.shape)
        x = adapted(h, layer.output, output.a, output.b, x)
        h = normed(x, layer.hidden_norm, epsilon)
        h = gated(adapted(h, layer.gate_up, gate_up.a, gate_up.b))
        x = adapted(h, layer.down, down.a, down.b, x)
    return normed(x, base.norm, epsilon)
