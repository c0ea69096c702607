"""The flash kernels written out: what they gather, the logs of their sums, their gradients."""

from collections.abc import Iterator

import torch
from torch import Tensor

Pair = tuple[Tensor, Tensor]


def _parts(limits: Pair) -> Iterator[tuple[slice, slice]]:
    queries, keys = (limit.tolist() for limit in limits)
    for n in range(len(queries) - 1):
        yield slice(queries[n], queries[n + 1]), slice(keys[n], keys[n + 1])


def _scores(q: Tensor, k: Tensor, causal: bool) -> Tensor:
    """Return (heads, queries, keys)."""
    k = k.repeat_interleave(q.shape[1] // k.shape[1], 1)
    scores = torch.einsum("qhd,khd->hqk", q, k) * q.shape[-1] ** -0.5
    if causal:
        later = torch.ones(scores.shape[1:], dtype=torch.bool).triu(1)
        scores = scores.masked_fill(later, -torch.inf)
    return scores


def ahead(  # noqa: PLR0917
    q: Tensor, k: Tensor, v: Tensor, limits: Pair, longest: tuple[int, int], causal: bool
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    out, total = torch.empty_like(q), q.new_empty(q.shape[1], q.shape[0])
    for rows, keys in _parts(limits):
        assert rows.stop - rows.start <= longest[0]
        assert keys.stop - keys.start <= longest[1]
        scores = _scores(q[rows], k[keys], causal)
        values = v[keys].repeat_interleave(q.shape[1] // v.shape[1], 1)
        out[rows] = torch.einsum("hqk,khd->qhd", scores.softmax(-1), values)
        total[:, rows] = scores.logsumexp(-1)
    return out, total, torch.zeros(2), torch.zeros(0)


def back(
    tensors: tuple[Tensor, ...],
    limits: Pair,
    longest: tuple[int, int],
    causal: bool,
    seeds: list[Tensor],
) -> tuple[Tensor, Tensor, Tensor]:
    assert len(seeds) == 2
    grad, q, k, v, out, total = tensors
    dq, dk, dv = (torch.zeros_like(x) for x in (q, k, v))
    groups, scale = q.shape[1] // k.shape[1], q.shape[-1] ** -0.5
    for rows, keys in _parts(limits):
        shares = (_scores(q[rows], k[keys], causal) - total[:, rows, None]).exp()
        many = [x[keys].repeat_interleave(groups, 1) for x in (k, v)]
        through = torch.einsum("qhd,khd->hqk", grad[rows], many[1])
        mean = (grad[rows] * out[rows]).sum(-1).t()[..., None]
        inner = shares * (through - mean) * scale
        dq[rows] = torch.einsum("hqk,khd->qhd", inner, many[0])
        per_head = torch.einsum("hqk,qhd->khd", inner, q[rows])
        dk[keys] += per_head.unflatten(1, (-1, groups)).sum(2)
        per_head = torch.einsum("hqk,qhd->khd", shares, grad[rows])
        dv[keys] += per_head.unflatten(1, (-1, groups)).sum(2)
    return dq, dk, dv
