"""Attention of a shared prefix and its branches, as plain matrix products over a pack of tokens.

Linear layers see all tokens in a row; only attention goes branch by branch.

Written by hand, forward and backward: the CPU kernel behind `scaled_dot_product_attention` took
68 % of a training step with a mask, and no library attends to a prefix that branches share.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Any, cast

import torch
from torch import Tensor

from pa_training.lora.shape import Shape


@dataclass(frozen=True)
class Layout:
    """Where the prefix and the branches of a pack lie."""

    prefix: int
    spans: tuple[tuple[int, int], ...]
    """First token and end of the prefix, then of every branch."""
    positions: Tensor
    """Position in the text of every token of the pack, float32 (tokens)."""
    ahead: Tensor
    """True above the diagonal: what a token may not see of its own span (longest, longest)."""

    def beyond(self, start: int, end: int, window: int) -> Tensor | None:
        """Return which keys each token of the span from `start` to `end` is too far from to see.

        Keys are the prefix and the span itself (tokens, keys); it sees those less than `window`
        positions behind it. None: it sees all that is before it, which a window of 0 means too.
        """
        own = self.positions[start:end]
        if not window or len(own) == 0 or own[-1] < window:
            return None
        keys = torch.cat((self.positions[: self.prefix], own)) if start else own
        return own[:, None] - keys >= window

    @classmethod
    def make(cls, prefix: int, lengths: Sequence[int], device: str | torch.device) -> "Layout":
        """Lay out branches of `lengths` tokens behind `prefix` tokens."""
        longest = max((prefix, *lengths))
        positions = [*range(prefix), *(prefix + t for length in lengths for t in range(length))]
        return cls(
            prefix=prefix,
            spans=tuple(pairwise(accumulate((prefix, *lengths), initial=0))),
            positions=torch.tensor(positions, dtype=torch.float32, device=device),
            ahead=torch.ones(longest, longest, dtype=torch.bool, device=device).triu(1),
        )


@dataclass(frozen=True)
class Rotation:
    """Cosine and sine of every token's angles, float32 (tokens, 1, 1, head_width / 2)."""

    cosine: Tensor
    sine: Tensor

    @classmethod
    def at(cls, positions: Tensor, frequencies: Tensor) -> "Rotation":
        """Return the rotation of tokens at `positions` (tokens)."""
        angles = (positions[:, None] * frequencies)[:, None, None, :]
        return cls(angles.cos(), angles.sin())

    def turn(self, heads: Tensor, *, back: bool = False) -> Tensor:
        """Rotate (tokens, groups, heads, head_width), or undo it."""
        half = heads.shape[-1] // 2
        x, y = heads[..., :half], heads[..., half:]
        sine = -self.sine if back else self.sine
        turned = torch.cat((x * self.cosine - y * sine, y * self.cosine + x * sine), -1)
        return turned.to(heads.dtype)


def attend(
    qkv: Tensor, rotation: Rotation, layout: Layout, shape: Shape, window: int = 0
) -> Tensor:
    """Return what every token gathers, (tokens, q_width), from `qkv` (tokens, q, k and v).

    It sees the last `window` positions, its own among them, or with 0 all of them.
    """
    return cast(Tensor, _Attend.apply(qkv, rotation, layout, shape, window))


class _Attend(torch.autograd.Function):
    """Goes span by span, so that nothing is padded and the weights of a branch fit in the cache.

    Heads of one key/value group are stacked: keys are never copied for each head.
    """

    @staticmethod
    def forward(  # noqa: PLR0917
        ctx: Any, qkv: Tensor, rotation: Rotation, layout: Layout, shape: Shape, window: int
    ) -> Tensor:
        q, k, v = _split(qkv, shape)
        q = rotation.turn(q).mul_(shape.head_width**-0.5)
        k = rotation.turn(k)
        k_prefix, v_prefix = _grouped(k[: layout.prefix]), _grouped(v[: layout.prefix])
        out = torch.empty(len(qkv), shape.q_width, dtype=qkv.dtype, device=qkv.device)
        saved: list[Tensor] = []
        for start, end in layout.spans:
            queries, keys, values = _grouped(q[start:end]), k_prefix, v_prefix
            if start:
                keys = torch.cat((keys, _grouped(k[start:end])), 1)
                values = torch.cat((values, _grouped(v[start:end])), 1)
            ahead = layout.ahead[: end - start, : end - start]
            weights = _weights(queries, keys, ahead, layout.beyond(start, end, window))
            _ungroup(_split_heads(out[start:end], shape), weights @ values)
            saved += [queries, keys, values, weights]
        ctx.save_for_backward(*saved)
        ctx.rotation, ctx.layout, ctx.shape = rotation, layout, shape
        return out

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, ...]:
        layout, shape, rotation = ctx.layout, ctx.shape, ctx.rotation
        grad, prefix = _split_heads(grads[0], shape), layout.prefix
        out = grads[0].new_empty(len(grad), shape.q_width + 2 * shape.kv_width)
        dq, dk = torch.empty_like(grad), grad.new_empty(len(grad), shape.kv_heads, 1, grad.shape[3])
        q_out, k_out, v_out = _split(out, shape)
        shared = [dk.new_zeros(shape.kv_heads, prefix, dk.shape[3], dtype=torch.float32)] * 2
        for number, (start, end) in enumerate(layout.spans):
            saved = ctx.saved_tensors[4 * number : 4 * number + 4]
            d_queries, *d_others = _backward(_grouped(grad[start:end]), *saved)
            _ungroup(dq[start:end], d_queries)
            shared = [total + own[:, :prefix] for total, own in zip(shared, d_others, strict=True)]
            if start:
                for target, own in zip((dk, v_out), d_others, strict=True):
                    _ungroup(target[start:end], own[:, prefix:])
        for target, total in zip((dk, v_out), shared, strict=True):
            _ungroup(target[:prefix], total)
        q_out.copy_(rotation.turn(dq.mul_(shape.head_width**-0.5), back=True))
        k_out.copy_(rotation.turn(dk, back=True))
        return out, None, None, None, None


def _split(qkv: Tensor, shape: Shape) -> tuple[Tensor, Tensor, Tensor]:
    """Return views (tokens, kv_heads, heads of the group, head_width) of q, k and v."""
    parts = torch.split(qkv, [shape.q_width, shape.kv_width, shape.kv_width], 1)
    q, k, v = (_split_heads(part, shape) for part in parts)
    return q, k, v


def _split_heads(x: Tensor, shape: Shape) -> Tensor:
    """View (tokens, width) as (tokens, kv_heads, heads of the group, head_width)."""
    return x.view(len(x), shape.kv_heads, -1, shape.head_width)


def _grouped(heads: Tensor) -> Tensor:
    """Turn (tokens, groups, heads, width) into (groups, heads * tokens, width)."""
    return heads.permute(1, 2, 0, 3).reshape(heads.shape[1], -1, heads.shape[3])


def _ungroup(target: Tensor, grouped: Tensor) -> None:
    """Write (groups, heads * tokens, width) into `target` (tokens, groups, heads, width)."""
    tokens, groups, heads, width = target.shape
    target.copy_(grouped.reshape(groups, heads, tokens, width).permute(2, 0, 1, 3))


def _weights(queries: Tensor, keys: Tensor, ahead: Tensor, beyond: Tensor | None) -> Tensor:
    """Return the attention weights (groups, heads * tokens, keys).

    `ahead` masks the last keys, `beyond` any of them.
    """
    tokens = len(ahead)
    scores = queries @ keys.transpose(1, 2)
    by_token = scores.view(len(scores), -1, tokens, keys.shape[1])
    by_token[..., keys.shape[1] - tokens :].masked_fill_(ahead, -torch.inf)
    if beyond is not None:
        by_token.masked_fill_(beyond, -torch.inf)
    return scores.softmax(-1)


def _backward(
    grad: Tensor, q: Tensor, k: Tensor, v: Tensor, p: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Return the gradients of q, k and v, all (batch, rows, width), from that of p @ v."""
    dv = p.transpose(1, 2) @ grad
    dp = grad @ v.transpose(1, 2)
    ds = torch.ops.aten._softmax_backward_data(dp, p, -1, p.dtype)
    return ds @ k, ds.transpose(1, 2) @ q, dv
