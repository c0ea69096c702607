"""The other operations of a layer, each with its own backward: no temporary that is not needed.

Gradients reach activations and adapter only; the frozen weights get none.
"""

from typing import Any, cast

import torch
from torch import Tensor
from torch.nn import functional

from pa_training.lora.frozen import Frozen, fused
from pa_training.lora.shape import Activation

ROWS, GPU_ROWS = 128, 4096
"""Positions whose logits are held at once: on a CPU 49,152 float32 each are 25 MB."""


SMALLEST = 1e-37
"""No probability is taken to be less, so that every loss is finite."""


def adapted(x: Tensor, weight: Frozen, a: Tensor, b: Tensor, added: Tensor | None = None) -> Tensor:
    """Return x W' + (x A') B' (+ `added`), rows are tokens; W is `weight`.

    `a` is (ranks, inputs) and `b` (outputs, ranks), already scaled by alpha / rank; `added` is a
    bias (outputs) or a residual (tokens, outputs).
    """
    return cast(Tensor, _Adapted.apply(x, weight, a, b, added))


def normed(x: Tensor, weight: Tensor, epsilon: float) -> Tensor:
    """Return `x` (tokens, width) over its root mean square, times `weight`."""
    return cast(Tensor, _Normed.apply(x, weight, epsilon))


def gated(x: Tensor, activation: Activation = "silu") -> Tensor:
    """Return activation(gate) * up of `x` (tokens, gate and up side by side)."""
    return cast(Tensor, _Gated.apply(x, activation))


def answer_loss(x: Tensor, head: Tensor, targets: Tensor, weights: Tensor) -> Tensor:
    """Return the weighted sum of the cross-entropies, in nats, float32.

    `x` is (positions, width), `targets` and `weights` (positions).
    """
    return cast(Tensor, _AnswerLoss.apply(x, head, targets, weights))


def score_answers(x: Tensor, head: Tensor, targets: Tensor) -> tuple[Tensor, Tensor]:
    """Return the cross-entropy of every target, and whether it is the most likely token."""
    losses: list[Tensor] = []
    hits: list[Tensor] = []
    each = _rows(x)
    for rows, target in zip(torch.split(x, each), torch.split(targets, each), strict=True):
        scores = (rows @ head.t()).float()
        losses.append(functional.cross_entropy(scores, target, reduction="none"))
        hits.append(scores.argmax(-1) == target)
    return torch.cat(losses), torch.cat(hits)


def _rows(x: Tensor) -> int:
    return GPU_ROWS if x.is_cuda else ROWS


class _Adapted(torch.autograd.Function):
    @staticmethod
    def forward(  # noqa: PLR0917
        ctx: Any, x: Tensor, weight: Frozen, a: Tensor, b: Tensor, added: Tensor | None
    ) -> Tensor:
        low = x @ a.t()
        y = weight.ahead(x).addmm_(low, b.t())
        if added is not None:
            y += added
        ctx.save_for_backward(x, a, b, low)
        ctx.weight, ctx.residual = weight, added is not None and added.dim() == 2
        return y

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, ...]:
        grad = grads[0]
        x, a, b, low = ctx.saved_tensors
        low_grad = grad @ b
        dx = ctx.weight.back(grad).addmm_(low_grad, a) if ctx.needs_input_grad[0] else None
        return dx, None, low_grad.t() @ x, grad.t() @ low, grad if ctx.residual else None


class _Normed(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, weight: Tensor, epsilon: float) -> Tensor:
        ctx.save_for_backward(x, weight)
        ctx.epsilon = epsilon
        return functional.rms_norm(x, (x.shape[-1],), weight, epsilon)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, ...]:
        x, weight = ctx.saved_tensors
        return _norm_back(grads[0], x.detach(), weight, ctx.epsilon), None, None


@fused
def _norm_back(grad: Tensor, x: Tensor, weight: Tensor, epsilon: float) -> Tensor:
    values = x.float()
    scale = (values.square().mean(-1, keepdim=True) + epsilon).rsqrt()
    values = values * scale
    grad = grad * weight.float()
    return ((grad - values * (grad * values).mean(-1, keepdim=True)) * scale).to(x.dtype)


class _Gated(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, activation: Activation) -> Tensor:
        ctx.save_for_backward(x)
        ctx.activation = activation
        return _gate(x.detach(), activation)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, ...]:
        (x,) = ctx.saved_tensors
        return _gate_back(grads[0], x.detach(), ctx.activation), None


@fused
def _gate(x: Tensor, activation: Activation) -> Tensor:
    gate, up = x.chunk(2, -1)
    return _activated(gate, activation) * up


@fused
def _gate_back(grad: Tensor, x: Tensor, activation: Activation) -> Tensor:
    gate, up = x.chunk(2, -1)
    through = grad * up
    if activation == "gelu":
        d_gate = torch.ops.aten.gelu_backward(through, gate, approximate="tanh")
    else:
        d_gate = torch.ops.aten.silu_backward(through, gate)
    return torch.cat((d_gate, grad * _activated(gate, activation)), -1)


def _activated(gate: Tensor, activation: Activation) -> Tensor:
    if activation == "gelu":
        return functional.gelu(gate, approximate="tanh")
    return functional.silu(gate)


class _AnswerLoss(torch.autograd.Function):
    """The gradient is computed on the way forward, while the logits of some rows are at hand."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, head: Tensor, targets: Tensor, weights: Tensor) -> Tensor:
        total = torch.zeros((), dtype=torch.float32, device=x.device)
        dx = torch.empty_like(x)
        each = _rows(x)
        for start in range(0, len(x), each):
            rows = slice(start, start + each)
            target = targets[rows, None]
            shares = (x[rows] @ head.t()).softmax(-1, dtype=torch.float32)
            weight = weights[rows, None]
            total -= (shares.gather(1, target).clamp_min_(SMALLEST).log_() * weight).sum()
            shares.scatter_add_(1, target, torch.full_like(weight, -1.0))
            dx[rows] = shares.mul_(weight).to(x.dtype) @ head
        ctx.save_for_backward(dx)
        return total

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, ...]:
        (dx,) = ctx.saved_tensors
        return dx * grads[0].to(dx.dtype), None, None, None
