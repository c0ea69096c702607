"""Attention of many prefixes and their branches at once, as plain batched matrix products.

Keys of a prefix are never copied for its branches or for the heads of a group.
"""

from typing import Any, cast

import torch
from torch import Tensor

from pa_training.gpu.batches import Grid
from pa_training.lora.attention import Rotation
from pa_training.lora.shape import Shape


def attend(qkv: Tensor, rotation: Rotation, grid: Grid, shape: Shape, window: int = 0) -> Tensor:
    """Return what every token gathers, (tokens, q_width), from `qkv` (tokens, q, k and v)."""
    parts = torch.split(qkv, [shape.q_width, shape.kv_width, shape.kv_width], 1)
    q, k = (x.reshape(len(x), shape.kv_heads, -1, shape.head_width) for x in parts[:2])
    q = rotation.turn(q) * shape.head_width**-0.5
    k = rotation.turn(k)
    near = window and grid.near is not None
    sees_prefix = grid.near_prefix if near else grid.sees_prefix
    sees = grid.near if near else grid.sees
    assert sees_prefix is not None
    assert sees is not None
    turned = torch.cat((q.flatten(1), k.flatten(1), parts[2]), 1)
    placed = cast(Tensor, _Placed.apply(turned, grid.slots, grid.rows))
    first = grid.prefix.numel()
    heads = shape.heads + 2 * shape.kv_heads
    ahead = placed[:first].view(*grid.prefix.shape, heads, shape.head_width)
    behind = placed[first:].view(*grid.branches.shape, heads, shape.head_width)
    kp, vp = (x.transpose(1, 2) for x in _keys(ahead, shape))  # (G, kv, P, D)
    at_prefix = _prefix(_queries(ahead, shape), kp, vp, sees_prefix)
    at_branches = _branches(_queries(behind, shape), *_keys(behind, shape), kp, vp, sees)
    gathered = torch.cat((at_prefix.flatten(0, 1), at_branches.flatten(0, 2)))
    return cast(Tensor, _Placed.apply(gathered, grid.rows, grid.slots))


class _Placed(torch.autograd.Function):
    """Rows in another order; a number behind the last row is a row of zeros.

    `slots` and `rows` undo each other, so that the gradient is placed and never added up: adding
    what belongs to nobody, row upon row, took most of a step.
    """

    @staticmethod
    def forward(ctx: Any, x: Tensor, slots: Tensor, rows: Tensor) -> Tensor:
        ctx.rows, ctx.slots = rows, slots
        return _rows(x, slots)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, ...]:
        return _rows(grads[0], ctx.rows), None, None


def _rows(x: Tensor, numbers: Tensor) -> Tensor:
    return torch.cat((x, x.new_zeros(1, x.shape[1]))).index_select(0, numbers)


def _queries(placed: Tensor, shape: Shape) -> Tensor:
    """Return (..., kv, heads of the group, D) of (..., heads of q, k and v, D)."""
    return placed[..., : shape.heads, :].unflatten(-2, (shape.kv_heads, -1))


def _keys(placed: Tensor, shape: Shape) -> tuple[Tensor, Tensor]:
    """Return keys and values, (..., kv, D) each."""
    k, v = placed[..., shape.heads :, :].split(shape.kv_heads, -2)
    return k, v


def _prefix(q: Tensor, k: Tensor, v: Tensor, sees: Tensor) -> Tensor:
    """Return (G, P, q_width) of q (G, P, kv, heads, D), k and v (G, kv, P, D)."""
    packs, tokens, groups, heads, width = q.shape
    queries = q.permute(0, 2, 3, 1, 4).reshape(packs, groups, heads * tokens, width)
    scores = (queries @ k.transpose(2, 3)).view(packs, groups, heads, tokens, tokens)
    weights = scores.masked_fill(~sees[:, None, None], -torch.inf).softmax(-1)
    found = weights.view(packs, groups, heads * tokens, tokens) @ v
    found = found.view(packs, groups, heads, tokens, width)
    return found.permute(0, 3, 1, 2, 4).reshape(packs, tokens, -1)


def _branches(  # noqa: PLR0917
    q: Tensor, k: Tensor, v: Tensor, kp: Tensor, vp: Tensor, sees: Tensor
) -> Tensor:
    """Return (G, B, T, q_width) of q (G, B, T, kv, heads, D), of own and of prefix keys."""
    packs, branches, tokens, groups, heads, width = q.shape
    prefix = kp.shape[2]
    queries = q.permute(0, 3, 1, 4, 2, 5)  # (G, kv, B, heads, T, D)
    flat = queries.reshape(packs, groups, branches * heads * tokens, width)
    ko, vo = (x.permute(0, 3, 1, 2, 4) for x in (k, v))  # (G, kv, B, T, D)
    rows = (packs, groups, branches, heads * tokens)
    scores = torch.cat(
        (
            (flat @ kp.transpose(2, 3)).view(*rows, prefix),
            flat.view(*rows, width) @ ko.transpose(3, 4),
        ),
        -1,
    ).view(packs, groups, branches, heads, tokens, prefix + tokens)
    weights = scores.masked_fill(~sees[:, None, :, None], -torch.inf).softmax(-1)
    weights = weights.view(*rows, prefix + tokens)
    of_prefix = weights[..., :prefix].reshape(packs, groups, branches * heads * tokens, prefix) @ vp
    found = of_prefix.view(*rows, width) + weights[..., prefix:] @ vo
    found = found.view(packs, groups, branches, heads, tokens, width)
    return found.permute(0, 2, 4, 1, 3, 5).reshape(packs, branches, tokens, -1)
