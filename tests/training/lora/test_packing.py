"""A pack of samples gives what its samples give one by one, forward and backward."""

from pathlib import Path

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from pa_training.lora.adapter import Adapter
from pa_training.lora.attention import Layout, Rotation, attend
from pa_training.lora.base import read_base
from pa_training.lora.frozen import Exact
from pa_training.lora.kernels import adapted, answer_loss, gated, normed
from pa_training.lora.material import Tokeniser, make_packs
from pa_training.lora.model import gradients, score
from pa_training.lora.packs import Pack
from pa_training.lora.shape import Shape
from pa_training.samples.sample import read_samples

SMALL = Shape("qwen2", 1, 24, 16, 6, 2, 4, 64, 10000.0, 1e-6)


def random(*shape: int, seed: int = 0, dtype: torch.dtype = torch.float64) -> Tensor:
    generator = torch.Generator().manual_seed(seed + sum(shape))
    return torch.randn(shape, generator=generator, dtype=dtype).requires_grad_()


def plain_attention(qkv: Tensor, layout: Layout, rotation: Rotation, seen: Tensor) -> Tensor:
    """Return what attention comes to when `seen` (tokens, tokens) says who sees whom."""
    count = SMALL.heads // SMALL.kv_heads
    q, k, v = torch.split(qkv, [SMALL.q_width, SMALL.kv_width, SMALL.kv_width], 1)
    q, k, v = (x.reshape(len(x), -1, 1, SMALL.head_width) for x in (q, k, v))
    q, k = rotation.turn(q)[:, :, 0], rotation.turn(k)[:, :, 0].repeat_interleave(count, 1)
    scores = torch.einsum("thd,shd->hts", q, k) / SMALL.head_width**0.5
    weights = scores.masked_fill(~seen, -torch.inf).softmax(-1)
    return torch.einsum("hts,shd->thd", weights, v[:, :, 0].repeat_interleave(count, 1)).flatten(1)


@settings(deadline=None, max_examples=25)
@given(
    prefix=st.integers(1, 5),
    lengths=st.lists(st.integers(1, 4), max_size=3),
    window=st.integers(0, 9),
)
def test_a_branch_sees_the_prefix_and_its_own_past_only(
    prefix: int, lengths: list[int], window: int
) -> None:
    layout = Layout.make(prefix, lengths, "cpu")
    owner = torch.tensor([0] * prefix + [n + 1 for n, t in enumerate(lengths) for _ in range(t)])
    past = torch.ones(len(owner), len(owner), dtype=torch.bool).tril()
    seen = past & ((owner[:, None] == owner) | (owner == 0))
    if window:
        seen &= layout.positions[:, None] - layout.positions < window
    frequencies = 10.0 ** -torch.arange(2, dtype=torch.float64)
    rotation = Rotation.at(layout.positions.double(), frequencies)
    qkv = random(len(owner), SMALL.q_width + 2 * SMALL.kv_width)
    ours = attend(qkv, rotation, layout, SMALL, window)
    plain = plain_attention(qkv, layout, rotation, seen)
    torch.testing.assert_close(ours, plain)
    wanted = random(*ours.shape, seed=1)
    found = [torch.autograd.grad((x * wanted).sum(), qkv)[0] for x in (ours, plain)]
    torch.testing.assert_close(found[0], found[1])


def test_the_gradients_of_the_kernels_are_those_of_their_values() -> None:
    x, weight, a, b = random(5, 6), random(8, 6).detach(), random(2, 6), random(8, 2)
    residual, scale = random(5, 8), random(6).detach()
    matrix = Exact(weight)
    assert torch.autograd.gradcheck(lambda *v: adapted(v[0], matrix, *v[1:]), (x, a, b))
    assert torch.autograd.gradcheck(lambda *v: adapted(v[0], matrix, *v[1:]), (x, a, b, residual))
    assert torch.autograd.gradcheck(gated, (x,))
    assert torch.autograd.gradcheck(lambda v: gated(v, "gelu"), (x,))
    single = random(5, 6, dtype=torch.float32)
    mean = single.square().mean(-1, keepdim=True)
    wanted = random(5, 6, seed=2, dtype=torch.float32).detach()
    values = [normed(single, scale.float(), 1e-5), single * (mean + 1e-5).rsqrt() * scale.float()]
    found = [torch.autograd.grad((value * wanted).sum(), single)[0] for value in values]
    torch.testing.assert_close(values[0], values[1])
    torch.testing.assert_close(found[0], found[1])


def test_the_loss_is_the_weighted_cross_entropy() -> None:
    x, head = random(300, 8, dtype=torch.float32), random(20, 8, dtype=torch.float32).detach()
    targets, weights = torch.arange(300) % 20, torch.linspace(0.1, 2.0, 300)
    each = torch.nn.functional.cross_entropy(x @ head.t(), targets, reduction="none")
    losses = [answer_loss(x, head, targets, weights), (each * weights).sum()]
    found = [torch.autograd.grad(loss, x)[0] for loss in losses]
    torch.testing.assert_close(losses[0], losses[1])
    torch.testing.assert_close(found[0], found[1])


@pytest.fixture(scope="module")
def packs(tiny: Path, data: Path) -> dict[int, list[Pack]]:
    """The samples packed by group, and one by one."""
    tokeniser = Tokeniser(tiny, "template")
    samples = list(read_samples(data))
    return {size: make_packs(samples, tokeniser, size) for size in (2048, 1)}


def test_a_pack_counts_the_shared_prefix_once(packs: dict[int, list[Pack]]) -> None:
    together, alone = packs[2048], packs[1]
    assert [len(pack.branches) for pack in together] == [4, 4, 4]
    assert len(alone) == 12
    assert sum(pack.size for pack in together) < 0.6 * sum(pack.size for pack in alone)
    assert sum(p.loss_weight for p in together) == sum(p.loss_weight for p in alone)


def test_a_pack_learns_what_its_samples_learn_one_by_one(
    packs: dict[int, list[Pack]], tiny: Path
) -> None:
    base = read_base(tiny)
    adapter = Adapter(base.shape, 4, 8.0, 0, "cpu")
    with torch.no_grad():
        for number, master in enumerate(adapter.masters):
            master.add_(random(*master.shape, seed=number, dtype=torch.float32), alpha=0.1)
    pairs = adapter.working(torch.float32)
    found = {
        size: [gradients(base, pairs, pack, pack.loss_weight) for pack in some[:1] or some]
        for size, some in {2048: packs[2048][:1], 1: packs[1][:4]}.items()
    }
    whole = [gradients(base, pairs, pack, packs[2048][0].loss_weight) for pack in packs[1][:4]]
    loss, grads = found[2048][0]
    assert loss == pytest.approx(sum(one for one, _ in whole), rel=1e-4)
    for number, grad in enumerate(grads):
        torch.testing.assert_close(grad, sum(g[number] for _, g in whole), rtol=1e-3, atol=1e-5)


def test_scores_add_up(packs: dict[int, list[Pack]], tiny: Path) -> None:
    base = read_base(tiny)
    pairs = Adapter(base.shape, 4, 8.0, 0, "cpu").working(torch.float32)
    together = score(base, pairs, packs[2048][0])
    alone = [score(base, pairs, pack) for pack in packs[1][:4]]
    assert together.samples == 4
    assert together.loss == pytest.approx(sum(s.loss for s in alone), rel=1e-4)
    assert together.right == sum(s.right for s in alone)
