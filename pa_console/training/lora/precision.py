"""The number format in which the frozen weights are held: the one that this machine computes in."""

from time import perf_counter
from typing import Literal

import torch

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
