"""A run goes on from an adapter's file; what it cannot go on from is said."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pa_console.llm.models.cache import hash_file
from pa_training.adapters.adapter_file import (
    BASE,
    BASE_SHA256,
    AdapterFile,
    Matrices,
    write_adapter,
)
from pa_training.adapters.config import TrainConfig
from pa_training.adapters.starts import first_matrices
from pa_training.adapters.trainer import train
from pa_training.results.lineage import ADAPTER
from tests.training.adapters.small_run import config, ignore
from tests.training.adapters.tiny import HEADS, HIDDEN, KV_HEADS, LAYERS, WIDTH, write_tiny

PAIRED = {"attn_q": HEADS, "attn_k": KV_HEADS}
INPUTS = {"ffn_down": HIDDEN}
OUTPUTS = {"attn_k": WIDTH // 2, "attn_v": WIDTH // 2, "ffn_gate": HIDDEN, "ffn_up": HIDDEN}
PARTS = ("attn_q", "attn_k", "attn_v", "attn_output", "ffn_gate", "ffn_up", "ffn_down")


def fresh(rank: int = 4, layers: int = LAYERS, hidden: int = HIDDEN) -> Matrices:
    """Return what an adapter of the tiny model begins with, or one of other sizes."""
    random = np.random.default_rng(3)
    sizes = {HIDDEN: hidden}
    return {
        f"blk.{layer}.{part}": (
            random.standard_normal((rank, sizes.get(i, i))).astype(np.float32),
            np.zeros((sizes.get(o, o), rank), np.float32),
        )
        for layer in range(layers)
        for part in PARTS
        for i, o in [(INPUTS.get(part, WIDTH), OUTPUTS.get(part, WIDTH))]
    }


def busy(seed: int, rank: int = 4) -> Matrices:
    """Return an adapter of the tiny model that changes every layer."""
    random = np.random.default_rng(seed)
    return {
        name: (a, random.standard_normal(b.shape).astype(np.float32))
        for name, (a, b) in fresh(rank).items()
    }


def written(base: Path, target: Path, values: Matrices, **changed: float) -> Path:
    """Write the adapter `values` of `base` to `target`."""
    rank = len(next(iter(values.values()))[0])
    made = TrainConfig(task="planner", base="tiny", data="data.jsonl", rank=rank)
    origin = {BASE: "tiny", BASE_SHA256: hash_file(base)}
    write_adapter(target, "llama", values, PAIRED, made.model_copy(update=changed), origin)
    return target


def begun(chosen: TrainConfig) -> Matrices:
    """Return what the run of `chosen` begins with."""
    base = Path(chosen.base)
    return first_matrices(chosen, fresh(chosen.rank), PAIRED, hash_file(base))


def rounded(values: NDArray[np.float32]) -> NDArray[np.float32]:
    return values.astype(np.float16).astype(np.float32)


def corrections(values: Matrices, alpha: float) -> dict[str, NDArray[np.floating[Any]]]:
    """Return what an adapter adds to each matrix of its base."""
    return {name: alpha / len(a) * b @ a for name, (a, b) in values.items()}


def test_a_run_begins_with_the_weights_that_were_exported(tiny: Path, tmp_path: Path) -> None:
    values = busy(1)
    file = written(tiny, tmp_path / "first.gguf", values)
    found = begun(config(tiny, tmp_path, start=str(file)))
    assert found.keys() == values.keys()
    for name, pair in values.items():
        for one, other in zip(found[name], pair, strict=True):
            np.testing.assert_array_equal(one, rounded(other))


@pytest.mark.parametrize("architecture", ["llama", "qwen2", "gemma3"])
def test_a_run_goes_on_from_a_folder_and_without_it(
    architecture: str, data: Path, tmp_path: Path
) -> None:
    base = write_tiny(tmp_path / "base.gguf", architecture)
    first, second = tmp_path / "first", tmp_path / "second"
    train(config(base, data, steps=3), first, False, ignore)
    chosen = config(base, data, start=str(first), steps=1, learning_rate=1e-12, seed=7)
    train(chosen, second, False, ignore)
    before, after = (AdapterFile.open(place / ADAPTER) for place in (first, second))
    for name, tensor in before.stored.items():
        np.testing.assert_array_equal(after.stored[name].data, tensor.data)
    assert any(tensor.data.any() for name, tensor in before.stored.items() if "lora_b" in name)


def test_fresh_weights_change_nothing(tiny: Path, data: Path, tmp_path: Path) -> None:
    chosen = config(tiny, data, steps=1, learning_rate=1e-12)
    train(chosen, tmp_path / "run", False, ignore)
    stored = AdapterFile.open(tmp_path / "run" / ADAPTER).stored
    assert stored.keys() == {
        f"{name}.weight.{end}" for name in fresh() for end in ("lora_a", "lora_b")
    }


@pytest.mark.parametrize("settings", [{"rank": 8}, {"alpha": 16.0}, {"rank": 12, "alpha": 5.0}])
def test_a_run_of_higher_rank_or_another_alpha_begins_with_the_same_corrections(
    settings: dict[str, float], tiny: Path, tmp_path: Path
) -> None:
    values = busy(1)
    file = written(tiny, tmp_path / "first.gguf", values)
    chosen = config(tiny, tmp_path, start=str(file)).model_copy(update=settings)
    before, after = corrections(values, 32.0), corrections(begun(chosen), chosen.alpha)
    assert before.keys() == after.keys()
    for name, correction in before.items():
        np.testing.assert_allclose(after[name], correction, rtol=0.01, atol=0.1)


def test_a_run_of_lower_rank_begins_with_the_nearest_corrections(
    tiny: Path, tmp_path: Path
) -> None:
    values = busy(1, rank=8)
    file = written(tiny, tmp_path / "first.gguf", values)
    after = corrections(begun(config(tiny, tmp_path, start=str(file), rank=3, alpha=5.0)), 5.0)
    for name, whole in corrections(values, 32.0).items():
        left, sizes, right = np.linalg.svd(whole)
        nearest = (left[:, :3] * sizes[:3]) @ right[:3]
        np.testing.assert_allclose(after[name], nearest, atol=0.01 * float(np.abs(whole).max()))


def test_an_adapter_in_eight_bits_corrects_by_the_same_and_can_be_gone_on_from(
    tiny: Path, tmp_path: Path
) -> None:
    values = {name: (np.tile(a, (8, 1)), np.tile(b, (1, 8))) for name, (a, b) in busy(1).items()}
    file = written(tiny, tmp_path / "q8.gguf", values, stored="q8_0")  # pyright: ignore[reportArgumentType]
    found = begun(config(tiny, tmp_path, start=str(file), rank=32))
    coarse = corrections(found, 32.0)
    for name, correction in corrections(values, 32.0).items():
        largest = float(np.abs(correction).max())
        np.testing.assert_allclose(coarse[name], correction, atol=0.02 * largest)


def test_a_rank_that_eight_bits_cannot_hold_is_refused(tiny: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"stored: .*: set stored=f16"):
        written(tiny, tmp_path / "q8.gguf", busy(1), stored="q8_0")  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(
    ("made", "says"),
    [
        (lambda: fresh(layers=1), r"tensor blk\.1\.attn_k\.weight\.lora_a is missing"),
        (lambda: fresh(layers=3), r"blk\.2\.attn_k: is of a layer that is not trained here"),
        (lambda: fresh(hidden=40), r"blk\.0\.ffn_gate: is of \(40, 32\), not of \(64, 32\)"),
    ],
)
def test_a_file_with_other_layers_is_refused(
    made: Callable[[], Matrices], says: str, tiny: Path, tmp_path: Path
) -> None:
    file = written(tiny, tmp_path / "adapter.gguf", made())
    with pytest.raises(ValueError, match=f"adapter.gguf: {says}"):
        begun(config(tiny, tmp_path, start=str(file)))


def test_an_adapter_of_another_base_of_the_same_shape_is_refused(
    tiny: Path, data: Path, tmp_path: Path
) -> None:
    file = written(tiny, tmp_path / "adapter.gguf", busy(1))
    other = write_tiny(tmp_path / "other.gguf", seed=1)
    says = "adapter.gguf: is an adapter of another base, tiny .* set base, or start from another"
    with pytest.raises(ValueError, match=says):
        train(config(other, data, start=str(file)), tmp_path / "run", False, ignore)


def test_an_adapter_that_does_not_name_its_base_or_its_alpha_is_refused(
    tiny: Path, tmp_path: Path
) -> None:
    chosen, file = config(tiny, tmp_path), tmp_path / "adapter.gguf"
    write_adapter(file, "llama", fresh(), PAIRED, chosen, {})
    with pytest.raises(ValueError, match="does not say of which base it is"):
        begun(config(tiny, tmp_path, start=str(file)))
    nothing = chosen.model_copy(update={"alpha": 0.0})
    write_adapter(file, "llama", fresh(), PAIRED, nothing, {BASE_SHA256: hash_file(tiny)})
    with pytest.raises(ValueError, match="does not say its alpha"):
        begun(config(tiny, tmp_path, start=str(file)))


def test_what_is_no_adapter_is_refused(tiny: Path, data: Path, tmp_path: Path) -> None:
    whole = written(tiny, tmp_path / "adapter.gguf", busy(1)).read_bytes()
    cut, head = tmp_path / "cut.gguf", tmp_path / "head.gguf"
    cut.write_bytes(whole[:-64])
    head.write_bytes(whole[:100])
    for file, says in (
        (data, "not a GGUF file: name the file of an adapter"),
        (tiny, "is not a LoRA adapter: name the file of an adapter"),
        (cut, "not a whole GGUF file"),
        (head, "not a whole GGUF file"),
        (tmp_path / "gone.gguf", "is not here: name a run's folder or an adapter's file"),
    ):
        with pytest.raises(ValueError, match=re.escape(f"{file.name}: {says}")):
            begun(config(tiny, data, start=str(file)))
