"""Attention of prefixes and branches with the flash kernels: no scores are kept, nothing is padded.

Every prefix and every branch attends to itself, causally; then branches attend to their prefix, all
of it. The two results of a branch are one softmax when each is weighted by its share of the sum
(Dao 2023, equation for blocks; Liu et al. 2023 for the gradients of the parts).
"""

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pa_training.lora.attention import Rotation
from pa_training.lora.shape import Shape


@dataclass(frozen=True)
class Segments:
    """Tokens of all prefixes, then of all branches; limits are int32 and begin with 0."""

    positions: Tensor
    prefix: int
    """Tokens of all prefixes."""
    every: Tensor
    """Limits of every prefix and branch."""
    longest: int
    prefixes: Tensor
    """Limits of the prefixes."""
    longest_prefix: int
    behind: Tensor
    """Limits of what stands behind each prefix, counted from the end of the last prefix."""
    most_behind: int

    @classmethod
    def of(
        cls,
        positions: Tensor,
        prefixes: NDArray[np.int64],
        branches: NDArray[np.int64],
        counts: NDArray[np.int64],
    ) -> "Segments":
        """Lay out prefixes and branches of these lengths; `counts` are the branches of a prefix."""
        lengths = np.concatenate((prefixes, branches))
        behind = np.add.reduceat(branches, np.concatenate(([0], np.cumsum(counts)[:-1])))

        def limits(of: NDArray[np.int64]) -> Tensor:
            whole = np.concatenate(([0], np.cumsum(of))).astype(np.int32)
            return torch.from_numpy(whole).to(positions.device)

        return cls(
            positions=positions,
            prefix=int(prefixes.sum()),
            every=limits(lengths),
            longest=int(lengths.max()),
            prefixes=limits(prefixes),
            longest_prefix=int(prefixes.max()),
            behind=limits(behind),
            most_behind=int(behind.max()),
        )


def attend(
    qkv: Tensor, rotation: Rotation, segments: Segments, shape: Shape, window: int = 0
) -> Tensor:
    """Return what every token gathers, (tokens, q_width), from `qkv` (tokens, q, k and v).

    Raises ValueError for a layer with a window, which these kernels are not used for.
    """
    if window:
        raise ValueError("layers with a window need pa_training.gpu.attention")
    parts = torch.split(qkv, [shape.q_width, shape.kv_width, shape.kv_width], 1)
    q, k = (x.reshape(len(x), shape.kv_heads, -1, shape.head_width) for x in parts[:2])
    q, k = rotation.turn(q).flatten(1, 2), rotation.turn(k).flatten(1, 2)
    v = parts[2].reshape(len(q), shape.kv_heads, shape.head_width)
    return cast(Tensor, _Attended.apply(q, k, v, segments)).flatten(1)


class _Attended(torch.autograd.Function):
    """Both parts, with the sum of both: the kernels' gradients of a part need no other change."""

    @staticmethod
    def forward(ctx: Any, q: Tensor, k: Tensor, v: Tensor, segments: Segments) -> Tensor:
        s, p = segments, segments.prefix
        v = v.contiguous()
        out, total, *seeds = ahead(q, k, v, (s.every, s.every), (s.longest, s.longest), True)
        limits, longest = (s.behind, s.prefixes), (s.most_behind, s.longest_prefix)
        other, others, *more = ahead(q[p:], k[:p], v[:p], limits, longest, False)
        own = total[:, p:]
        both = torch.logaddexp(own, others)
        shares = ((part - both).exp().t()[..., None] for part in (own, others))
        merged = out[p:] * next(shares) + other * next(shares)
        out = torch.cat((out[:p], merged.to(out.dtype)))
        total = torch.cat((total[:, :p], both), 1)
        ctx.save_for_backward(q, k, v, out, total, *seeds, *more)
        ctx.segments = segments
        return out

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, ...]:
        q, k, v, out, total, *seeds = ctx.saved_tensors
        s: Segments = ctx.segments
        p, grad = s.prefix, grads[0].contiguous()
        dq, dk, dv = back(
            (grad, q, k, v, out, total),
            (s.every, s.every),
            (s.longest, s.longest),
            True,
            seeds[:2],
        )
        dq_more, dk_more, dv_more = back(
            (grad[p:], q[p:], k[:p], v[:p], out[p:], total[:, p:].contiguous()),
            (s.behind, s.prefixes),
            (s.most_behind, s.longest_prefix),
            False,
            seeds[2:],
        )
        dq[p:] += dq_more
        dk[:p] += dk_more
        dv[:p] += dv_more
        return dq, dk, dv, None


def ahead(  # noqa: PLR0917
    q: Tensor,
    k: Tensor,
    v: Tensor,
    limits: tuple[Tensor, Tensor],
    longest: tuple[int, int],
    causal: bool,
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return what is gathered (tokens, heads, D), the logarithm of each sum (heads, tokens), seeds.

    `limits` and `longest` are of the queries' segments and of the keys'.
    """
    found = torch.ops.aten._flash_attention_forward(
        q, k, v, *limits, *longest, 0.0, causal, False, scale=q.shape[-1] ** -0.5
    )
    return found[0], found[1], found[2], found[3]


def back(
    tensors: tuple[Tensor, ...],
    limits: tuple[Tensor, Tensor],
    longest: tuple[int, int],
    causal: bool,
    seeds: list[Tensor],
) -> tuple[Tensor, Tensor, Tensor]:
    """Return the gradients of q, k and v; `tensors` are grad, q, k, v, out and the sums."""
    scale = tensors[1].shape[-1] ** -0.5
    return cast(
        tuple[Tensor, Tensor, Tensor],
        torch.ops.aten._flash_attention_backward(
            *tensors, *limits, *longest, 0.0, causal, *seeds, scale=scale
        ),
    )
