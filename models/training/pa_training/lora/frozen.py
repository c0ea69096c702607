"""The frozen matrix of a linear layer, as it is stored; number formats and fused steps.

Needs a C++ compiler; where that fails, the steps are computed one by one, as they are written.

In eight bits, inputs and gradients are rounded too, each row by its own largest value, and the
products are sums of whole numbers: with VNNI a CPU makes four of them for one in float32. Inputs of
large magnitude meet weights that were made smaller by as much, so that both are rounded alike
(SmoothQuant, Xiao et al. 2023, with an alpha of 0.5).
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import Any, Literal, Protocol, TypeVar

import torch
from torch import Tensor

torch._dynamo.config.suppress_errors = True
torch._logging.set_logs(dynamo=logging.ERROR)

F = TypeVar("F", bound=Callable[..., Any])


def fused(function: F) -> F:
    """Return `function` compiled at its first call, for tensors of any length."""
    return torch.compile(function, dynamic=True)


Precision = Literal["bfloat16", "float32", "int8"]
FORMATS: dict[Precision, torch.dtype] = {
    "bfloat16": torch.bfloat16,
    "float32": torch.float32,
    "int8": torch.float32,
}
"""What all is computed in but, in int8, the products with frozen matrices."""
FLOATS: tuple[Precision, ...] = ("bfloat16", "float32")
_ROWS, _WIDTH, _TRIES = 64, 576, 3


def fastest_precision(device: str) -> Precision:
    """Return the format in which `device` multiplies matrices faster; the smaller one on a GPU.

    A CPU without instructions for bfloat16 emulates it: with AVX2 alone, 1.1 GFLOP/s on two cores
    where float32 has 42. The two are tried for some hundredths of a second.
    """
    if device != "cpu":
        return "bfloat16"
    return min(FLOATS, key=_seconds)


def _seconds(precision: Precision) -> float:
    """Return how long a product of the size of a small pack takes, at best."""
    x = torch.ones(_ROWS, _WIDTH, dtype=FORMATS[precision])
    weight = torch.ones(_WIDTH, _WIDTH, dtype=FORMATS[precision])
    seconds = list[float]()
    for _ in range(_TRIES):
        began = perf_counter()
        x @ weight
        seconds.append(perf_counter() - began)
    return min(seconds)


STEPS = 127.0
"""Of a signed byte, either way."""
SMALLEST = 1e-5
"""No input, weight or row of weights is taken to be smaller when it is scaled."""
NOTHING = 1e-30
"""Gradients may be as small."""


class Frozen(Protocol):
    """A matrix (outputs, inputs) that takes rows of inputs to rows of outputs."""

    def ahead(self, x: Tensor) -> Tensor:
        """Return x W', (rows, outputs) of `x` (rows, inputs)."""
        ...

    def back(self, grad: Tensor) -> Tensor:
        """Return the gradient of `x`, (rows, inputs), from that of `ahead` (rows, outputs)."""
        ...


@dataclass(frozen=True)
class Exact:
    """A matrix in the format in which it is computed."""

    weight: Tensor

    def ahead(self, x: Tensor) -> Tensor:
        """Return x W'."""
        return x @ self.weight.t()

    def back(self, grad: Tensor) -> Tensor:
        """Return grad W."""
        return grad @ self.weight


class Measured(Exact):
    """A matrix that keeps the largest magnitude of every input it has met (inputs)."""

    def __init__(self, weight: Tensor) -> None:
        super().__init__(weight)
        self.largest = weight.new_zeros(weight.shape[1])

    def ahead(self, x: Tensor) -> Tensor:
        """Return x W'."""
        torch.maximum(self.largest, x.detach().abs().amax(0), out=self.largest)
        return super().ahead(x)


@dataclass(frozen=True)
class EightBits:
    """W as `outputs` * `weight` * `inputs`: signed bytes between the scales of rows and columns."""

    weight: Tensor
    outputs: Tensor
    """Float32 (outputs)."""
    inputs: Tensor
    """Float32 (inputs)."""

    @classmethod
    def of(cls, measured: Measured) -> "EightBits":
        """Return the matrix rounded to what its inputs need."""
        weight = measured.weight.float()
        largest = weight.abs().amax(0).clamp_min(SMALLEST)
        inputs = (largest / measured.largest.float().clamp_min(SMALLEST)).sqrt()
        inputs /= inputs.log().mean().exp()
        outputs = (weight / inputs).abs().amax(1).clamp_min(SMALLEST) / STEPS
        return cls((weight / inputs / outputs[:, None]).round_().to(torch.int8), outputs, inputs)

    def ahead(self, x: Tensor) -> Tensor:
        """Return x W' about."""
        rounded, steps = _rounded(x.detach(), self.inputs)
        return _restored(torch._int_mm(rounded, self.weight.t()), steps, self.outputs)

    def back(self, grad: Tensor) -> Tensor:
        """Return grad W about."""
        rounded, steps = _rounded(grad.detach(), self.outputs)
        return _restored(torch._int_mm(rounded, self.weight), steps, self.inputs)


@fused
def _rounded(x: Tensor, scales: Tensor) -> tuple[Tensor, Tensor]:
    """Return `x` * `scales` as signed bytes, and what each row of them is to be multiplied by."""
    scaled = x * scales
    steps = scaled.abs().amax(1, keepdim=True).clamp_min(NOTHING) / STEPS
    return (scaled / steps).round().to(torch.int8), steps


@fused
def _restored(sums: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
    return sums.float() * rows * columns
