"""A matrix in eight bits does what the exact one does, whatever its inputs are like."""

from pathlib import Path

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from pa_training.lora.adapter import Adapter
from pa_training.lora.base import read_base
from pa_training.lora.eight_bits import in_eight_bits
from pa_training.lora.frozen import EightBits, Exact, Measured
from pa_training.lora.material import Tokeniser, make_packs
from pa_training.lora.model import gradients
from pa_training.samples.sample import read_samples


def random(seed: int, *shape: int) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def error(found: Tensor, wanted: Tensor) -> float:
    return float((found - wanted).norm() / wanted.norm())


@settings(deadline=None, max_examples=20)
@given(
    rows=st.integers(2, 40),
    inputs=st.integers(32, 80),
    outputs=st.integers(32, 80),
    loud=st.floats(1.0, 100.0),
    seed=st.integers(0, 1000),
)
def test_products_both_ways_are_off_by_a_few_percent_at_most(
    rows: int, inputs: int, outputs: int, loud: float, seed: int
) -> None:
    x, weight, grad = (
        random(seed, rows, inputs),
        random(1, outputs, inputs),
        random(2, rows, outputs),
    )
    x[:, 3] *= loud
    measured = Measured(weight)
    measured.ahead(x)
    small, exact = EightBits.of(measured), Exact(weight)
    assert error(small.ahead(x), exact.ahead(x)) < 0.05
    assert error(small.back(grad), exact.back(grad)) < 0.05


def test_an_input_that_is_always_nothing_spoils_nothing() -> None:
    x, weight = random(0, 9, 32), random(1, 40, 32)
    x[:, 5] = 0.0
    measured = Measured(weight)
    measured.ahead(x)
    assert error(EightBits.of(measured).ahead(x), x @ weight.t()) < 0.05


def test_the_gradients_of_a_pack_are_nearly_those_of_float32(tiny: Path, data: Path) -> None:
    base, tokeniser = read_base(tiny), Tokeniser(tiny, "template")
    packs = make_packs(read_samples(data, "planner"), tokeniser, 512)
    adapter = Adapter(base.shape, 4, 8.0, 0, "cpu")
    with torch.no_grad():
        for number, master in enumerate(adapter.masters):
            master.add_(random(number, *master.shape), alpha=0.1)
    pairs = adapter.working(torch.float32)
    found = [
        torch.cat([x.flatten() for x in gradients(kind, pairs, packs[0], 1.0)[1]])
        for kind in (in_eight_bits(base, packs), base)
    ]
    assert torch.cosine_similarity(found[0], found[1], 0) == pytest.approx(1.0, abs=0.02)
