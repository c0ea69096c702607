"""The kit for a GPU learns what the trainer for a CPU learns, and brings it back."""

import json
import random
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from pa_training.gpu import attention, flash
from pa_training.gpu.batches import in_batches, make_batch
from pa_training.gpu.corpus import Branch, Pack, read_corpus, write_corpus
from pa_training.lora import packs as lora_packs
from pa_training.lora.base import Base, read_base
from pa_training.lora.kernels import answer_loss
from pa_training.lora.model import gradients, hidden
from tests.training.lora.gpu import plain_flash
from tests.training.lora.test_parity import busy_adapter
from tests.training.lora.tiny import write_tiny

pytestmark = pytest.mark.long


def random_packs(count: int, seed: int) -> list[Pack]:
    drawn = np.random.default_rng(seed)

    def words(most: int, least: int = 1) -> np.ndarray:
        return drawn.integers(3, 250, drawn.integers(least, most + 1)).astype(np.int32)

    packs: list[Pack] = []
    for _ in range(count):
        branches: list[Branch] = []
        for _ in range(int(drawn.integers(1, 5))):
            rest, answer = words(12), words(7, 2)
            learnt = drawn.random(len(answer)) < 0.8
            learnt[0] = True
            branches.append(Branch(np.concatenate([rest, answer[:-1]]), answer, learnt))
        packs.append(Pack(words(30), tuple(branches)))
    return packs


def plain(pack: Pack) -> lora_packs.Pack:
    """Return `pack` as the trainer for a CPU has it."""
    return lora_packs.Pack(
        pack.prefix,
        tuple(
            lora_packs.Branch(b.tokens, b.targets, b.learnt.astype(np.float32))
            for b in pack.branches
        ),
    )


@pytest.fixture(params=["llama", "qwen2", "gemma3"])
def base(request: pytest.FixtureRequest, tmp_path: Path) -> Base:
    return read_base(write_tiny(tmp_path / "base.gguf", request.param))


@pytest.mark.parametrize("way", ["grid", "flash"])
def test_a_batch_of_packs_has_the_loss_and_the_gradients_of_its_packs(
    base: Base, way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_flash = way == "flash"
    if with_flash and base.shape.window:
        with pytest.raises(ValueError, match="window"):
            flash.attend(*[None] * 3, base.shape, base.shape.window)  # type: ignore[arg-type]
        return
    monkeypatch.setattr(flash, "ahead", plain_flash.ahead)
    monkeypatch.setattr(flash, "back", plain_flash.back)
    attend = flash.attend if with_flash else attention.attend
    packs = random_packs(5, seed=3)
    pairs = busy_adapter(base.path, 0.3).working(torch.float32)
    weight = sum(plain(pack).loss_weight for pack in packs)
    batch = make_batch(packs, base.shape.window, "cpu", with_flash)
    states = hidden(base, pairs, batch.tokens, batch.layout, attend).index_select(0, batch.rows)
    loss = answer_loss(states, base.head, batch.targets, batch.learnt.float() / weight)
    found = torch.autograd.grad(loss, [x for pair in pairs for x in (pair.a, pair.b)])
    each = [gradients(base, pairs, plain(pack), weight) for pack in packs]
    assert loss.item() == pytest.approx(sum(share for share, _ in each), rel=1e-4)
    for number, gradient in enumerate(found):
        wanted = torch.stack([grads[number] for _, grads in each]).sum(0)
        torch.testing.assert_close(gradient, wanted, rtol=2e-3, atol=2e-5)


def test_a_corpus_is_read_as_it_was_written(tmp_path: Path) -> None:
    packs = random_packs(9, seed=1)
    write_corpus(tmp_path / "corpus", packs)
    for ours, read in zip(packs, read_corpus(tmp_path / "corpus"), strict=True):
        np.testing.assert_array_equal(ours.prefix, read.prefix)
        for one, other in zip(ours.branches, read.branches, strict=True):
            for field in ("tokens", "targets", "learnt"):
                np.testing.assert_array_equal(getattr(one, field), getattr(other, field))


def test_what_is_no_corpus_is_named(tmp_path: Path) -> None:
    (tmp_path / "broken").write_bytes(b"no corpus")
    with pytest.raises(ValueError, match=r"broken: is no corpus.*make it anew"):
        read_corpus(tmp_path / "broken")


@pytest.mark.parametrize("padded", [True, False])
def test_batches_hold_every_branch_once_behind_its_prefix(padded: bool) -> None:
    packs = random_packs(40, seed=2)
    batches = list(in_batches(packs, 300, random.Random(0), padded))
    told = sorted((id(p.prefix), id(b.tokens)) for p in packs for b in p.branches)
    found = sorted(
        (id(p.prefix), id(b.tokens)) for batch in batches for p in batch for b in p.branches
    )
    assert found == told
    assert all(len(b) == 1 or sum(p.size for p in b) <= 300 for b in batches)


def test_a_run_goes_on_where_it_was_stopped_and_learns(tmp_path: Path) -> None:
    write_tiny(tmp_path / "base.gguf", "gemma3")
    write_corpus(tmp_path / "corpus", random_packs(6, seed=4))

    def run(steps: int, *more: str) -> list[dict[str, float]]:
        command = [sys.executable, "-m", "pa_training.gpu.train", *more]
        command += ["--base", str(tmp_path / "base.gguf"), "--out", str(tmp_path / "run")]
        command += ["--corpus", f"all={tmp_path / 'corpus'}:1", "--device", "cpu"]
        command += ["--dtype", "float32", "--steps", str(steps), "--rank", "4", "--alpha", "8"]
        command += ["--tokens", "400", "--rate", "0.02", "--warmup", "2"]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        return [json.loads(line) for line in done.stdout.splitlines()]

    first = run(4)
    later = run(60, "--resume")
    assert first[-1]["step"] == 4
    assert later[-1]["step"] == 60
    losses = [line["loss"] for line in (*first, *later) if "loss" in line]
    assert losses[-1] < losses[0]
    masters = np.load(tmp_path / "run" / "masters-0.npy")
    assert np.isfinite(masters).all()


def test_the_machine_with_the_gpu_needs_nothing_of_the_console() -> None:
    names = ["pydantic", "llama_cpp", "rapidfuzz", "textual", "pymunk"]
    blocked = "; ".join(f"sys.modules[{name!r}] = None" for name in names)
    script = f"import sys; {blocked}; import pa_training.gpu.train"
    subprocess.run([sys.executable, "-c", script], check=True)
