"""Attention of a shared prefix and its branches, as plain matrix products.

Written by hand, forward and backward: the CPU kernel behind `scaled_dot_product_attention` took
68 % of a training step with a mask, and no library attends to a prefix that branches share.
"""

from dataclasses import dataclass
from typing import Any, cast

import torch
from torch import Tensor

from pa_console.training.lora.layout import Layout
from pa_console.training.lora.shape import Shape


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


def attend(qkv: Tensor, rotation: Rotation, layout: Layout, shape: Shape) -> Tensor:
    """Return what every token gathers, (tokens, q_width), from `qkv` (tokens, q, k and v)."""
    return cast(Tensor, _Attend.apply(qkv, rotation, layout, shape))


class _Attend(torch.autograd.Function):
    """Heads of one key/value group are stacked, so that keys are never copied for each head."""

    @staticmethod
    def forward(ctx: Any, qkv: Tensor, rotation: Rotation, layout: Layout, shape: Shape) -> Tensor:
        q, k, v = _split(qkv, shape)
        q = rotation.turn(q).mul_(shape.head_width**-0.5)
        k = rotation.turn(k)
        prefix = layout.prefix
        q_prefix, k_prefix, v_prefix = (_grouped(x[:prefix]) for x in (q, k, v))
        p_prefix = _weights(q_prefix, k_prefix, layout.prefix_ahead)
        out = torch.empty(len(qkv), shape.q_width, dtype=qkv.dtype, device=qkv.device)
        _ungroup(out[:prefix], p_prefix @ v_prefix, shape)
        saved = [q_prefix, k_prefix, v_prefix, p_prefix]
        if layout.branches:
            q_branch, k_branch, v_branch = (_padded(x[prefix:], layout) for x in (q, k, v))
            k_all = _after_prefix(k_prefix, k_branch, layout)
            v_all = _after_prefix(v_prefix, v_branch, layout)
            p_branch = _weights(q_branch, k_all, layout.ahead)
            out[prefix:] = _packed(p_branch @ v_all, layout, shape.heads)
            saved += [q_branch, k_all, v_all, p_branch]
        ctx.save_for_backward(*saved)
        ctx.rotation, ctx.layout, ctx.shape = rotation, layout, shape
        return out

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, ...]:
        layout, shape, rotation = ctx.layout, ctx.shape, ctx.rotation
        grad, prefix = grads[0], layout.prefix
        heads = grad.view(len(grad), shape.kv_heads, -1, shape.head_width)
        out = torch.empty(
            len(grad), shape.q_width + 2 * shape.kv_width, dtype=grad.dtype, device=grad.device
        )
        q_out, k_out, v_out = _split(out, shape)
        q, k, v, p = ctx.saved_tensors[:4]
        dq, dk, dv = _backward(_grouped(heads[:prefix]), q, k, v, p)
        dq_all = torch.empty_like(heads)
        dk_all = torch.empty_like(k_out)
        _ungroup(dq_all[:prefix].view(prefix, -1), dq, shape)
        if layout.branches:
            q, k, v, p = ctx.saved_tensors[4:]
            dqb, dkb, dvb = _backward(_padded(heads[prefix:], layout), q, k, v, p)
            dkb, dvb = (
                x.view(layout.branches, shape.kv_heads, -1, shape.head_width) for x in (dkb, dvb)
            )
            dk += dkb[:, :, :prefix].sum(0)
            dv += dvb[:, :, :prefix].sum(0)
            dq_all[prefix:] = _packed(dqb, layout, shape.heads).view_as(dq_all[prefix:])
            for target, x in ((dk_all, dkb), (v_out, dvb)):
                own = x[:, :, prefix:].reshape(-1, layout.longest, shape.head_width)
                target[prefix:] = _packed(own, layout, shape.kv_heads).view_as(target[prefix:])
        dk_all[:prefix, :, 0] = dk.transpose(0, 1)
        v_out[:prefix, :, 0] = dv.transpose(0, 1)
        q_out.copy_(rotation.turn(dq_all.mul_(shape.head_width**-0.5), back=True))
        k_out.copy_(rotation.turn(dk_all, back=True))
        return out, None, None, None


def _split(qkv: Tensor, shape: Shape) -> tuple[Tensor, Tensor, Tensor]:
    """Return views (tokens, kv_heads, heads of the group, head_width) of q, k and v."""
    parts = torch.split(qkv, [shape.q_width, shape.kv_width, shape.kv_width], 1)
    q, k, v = (x.view(len(x), shape.kv_heads, -1, shape.head_width) for x in parts)
    return q, k, v


def _grouped(heads: Tensor) -> Tensor:
    """Turn (tokens, groups, heads, width) into (groups, heads * tokens, width)."""
    return heads.permute(1, 2, 0, 3).reshape(heads.shape[1], -1, heads.shape[3])


def _ungroup(target: Tensor, grouped: Tensor, shape: Shape) -> None:
    """Write (groups, heads * tokens, width) into `target` (tokens, groups * heads * width)."""
    heads = grouped.view(shape.kv_heads, -1, len(target), shape.head_width)
    target.view(len(target), shape.kv_heads, -1, shape.head_width).copy_(heads.permute(2, 0, 1, 3))


def _padded(heads: Tensor, layout: Layout) -> Tensor:
    """Turn branch tokens (tokens, groups, heads, width) into padded ones.

    The result is (branches * groups, heads * longest, width); what is padded is zero.
    """
    tokens, groups, count, width = heads.shape
    rows = heads.new_zeros(layout.branches * layout.longest, groups * count * width)
    rows.index_copy_(0, layout.places, heads.reshape(tokens, -1))
    rows = rows.view(layout.branches, layout.longest, groups, count, width)
    return rows.permute(0, 2, 3, 1, 4).reshape(layout.branches * groups, -1, width)


def _packed(padded: Tensor, layout: Layout, heads: int) -> Tensor:
    """Undo `_padded`: return (tokens, heads * width)."""
    width = padded.shape[-1]
    rows = padded.view(layout.branches, heads, layout.longest, width).transpose(1, 2)
    return rows.reshape(-1, heads * width).index_select(0, layout.places)


def _after_prefix(prefix: Tensor, branch: Tensor, layout: Layout) -> Tensor:
    """Put `prefix` (groups, P, width) before every branch: (branches * groups, P + t, width)."""
    groups, size, width = prefix.shape
    every = prefix.new_empty(layout.branches, groups, size + layout.longest, width)
    every[:, :, :size] = prefix
    every[:, :, size:] = branch.view(layout.branches, groups, layout.longest, width)
    return every.flatten(0, 1)


def _weights(q: Tensor, k: Tensor, ahead: Tensor) -> Tensor:
    """Return the attention weights (batch, heads * tokens, keys); `ahead` masks the last keys."""
    size = len(ahead)
    scores = q @ k.transpose(1, 2)
    own = scores.view(len(q), -1, size, k.shape[1])[..., k.shape[1] - size :]
    own.masked_fill_(ahead, -torch.inf)
    return scores.softmax(-1)


def _backward(
    grad: Tensor, q: Tensor, k: Tensor, v: Tensor, p: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Return the gradients of q, k and v, all (batch, rows, width), from that of p @ v."""
    dv = p.transpose(1, 2) @ grad
    dp = grad @ v.transpose(1, 2)
    ds = torch.ops.aten._softmax_backward_data(dp, p, -1, p.dtype)
    return ds @ k, ds.transpose(1, 2) @ q, dv
