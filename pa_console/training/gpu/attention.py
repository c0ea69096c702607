"""Attention of many prefixes and their branches at once, as plain batched matrix products.

Keys of a prefix are never copied for its branches or for the heads of a group.
"""

import torch
from torch import Tensor

from pa_console.training.gpu.batches import Grid
from pa_console.training.lora.attention import Rotation
from pa_console.training.lora.shape import Shape


def attend(qkv: Tensor, rotation: Rotation, grid: Grid, shape: Shape, window: int = 0) -> Tensor:
    """Return what every token gathers, (tokens, q_width), from `qkv` (tokens, q, k and v)."""
    q, k, v = torch.split(qkv, [shape.q_width, shape.kv_width, shape.kv_width], 1)
    q, k, v = (x.reshape(len(x), shape.kv_heads, -1, shape.head_width) for x in (q, k, v))
    q = rotation.turn(q) * shape.head_width**-0.5
    k = rotation.turn(k)
    q, k, v = (torch.cat((x, x.new_zeros(1, *x.shape[1:]))) for x in (q, k, v))
    near = window and grid.near is not None
    sees_prefix = grid.near_prefix if near else grid.sees_prefix
    sees = grid.near if near else grid.sees
    assert sees_prefix is not None
    assert sees is not None
    kp, vp = (x[grid.prefix].squeeze(3).transpose(1, 2) for x in (k, v))  # (G, kv, P, D)
    at_prefix = _prefix(q[grid.prefix], kp, vp, sees_prefix)
    at_branches = _branches(q[grid.branches], k[grid.branches], v[grid.branches], kp, vp, sees)
    out = qkv.new_empty(len(qkv) + 1, shape.q_width)
    slots = torch.cat((grid.prefix.flatten(), grid.branches.flatten()))
    gathered = torch.cat((at_prefix.flatten(0, 1), at_branches.flatten(0, 2)))
    return out.index_copy(0, slots, gathered)[: len(qkv)]


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
    ko, vo = (x.squeeze(4).permute(0, 3, 1, 2, 4) for x in (k, v))  # (G, kv, B, T, D)
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
