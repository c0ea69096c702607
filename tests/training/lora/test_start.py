"""A run goes on from an adapter's file; what it cannot go on from is said."""

from dataclasses import replace
from pathlib import Path

import gguf
import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from pa_console.llm.models.cache import hash_file
from pa_training.lora.adapter import BASE, BASE_SHA256, Adapter, AdapterFile
from pa_training.lora.checkpoint import RunFolder, State, start_weights
from pa_training.lora.config import Lesson, TrainConfig
from pa_training.lora.export import export_adapter, write_adapter
from pa_training.lora.loop import Progress, train
from pa_training.lora.shape import open_gguf
from tests.training.lora.small_run import config, ignore
from tests.training.lora.tiny import write_tiny


class BegunError(Exception):
    """Ends a run in its first step: its checkpoint is still the one of its beginning."""


def begun(chosen: TrainConfig, out: Path) -> State:
    """Return how the run of `chosen` begins."""

    def end(_: Progress) -> None:
        raise BegunError

    with pytest.raises(BegunError):
        train(chosen, out, False, end)
    state = RunFolder(out).load()
    assert state.step == 0
    return state


def matrices(file: Path) -> dict[str, bytes]:
    """Return the tensors of an adapter as they lie in its file."""
    return {name: tensor.data.tobytes() for name, tensor in AdapterFile.open(file).stored.items()}


@pytest.mark.parametrize("architecture", ["llama", "qwen2"])
def test_a_run_begins_with_the_weights_that_were_exported(
    architecture: str, data: Path, tmp_path: Path
) -> None:
    base = write_tiny(tmp_path / "base.gguf", architecture)
    first, second = tmp_path / "first", tmp_path / "second"
    train(config(base, data, steps=3), first, False, ignore)
    export_adapter(first, tmp_path / "first.gguf")
    chosen = config(base, data, start=str(tmp_path / "first.gguf"), seed=7)
    state, trained = begun(chosen, second), RunFolder(first).load().masters
    assert all(bool(master.any()) for master in trained)
    for new, old in zip(state.masters, trained, strict=True):
        assert torch.equal(new, old.half().float())
    export_adapter(second, tmp_path / "second.gguf")
    assert matrices(tmp_path / "second.gguf") == matrices(tmp_path / "first.gguf")


def test_a_run_that_began_from_a_file_is_resumed_without_it(
    tiny: Path, data: Path, tmp_path: Path
) -> None:
    file, out = tmp_path / "first.gguf", tmp_path / "second"
    train(config(tiny, data, steps=1), tmp_path / "first", False, ignore)
    export_adapter(tmp_path / "first", file)
    begun(config(tiny, data, start=str(file)), out)
    file.unlink()
    assert train(config(tiny, data), out, True, ignore).last.step == 8


def test_a_share_of_what_another_run_learnt_is_added(
    tiny: Path, data: Path, tmp_path: Path
) -> None:
    for name, steps in (("own", 2), ("before", 1), ("after", 3)):
        train(config(tiny, data, steps=steps), tmp_path / name, False, ignore)
    ends = {"before": str(tmp_path / "before"), "after": str(tmp_path / "after"), "share": 0.5}
    chosen = config(tiny, data, start=str(tmp_path / "own"), lesson=ends)
    state = begun(chosen, tmp_path / "second")
    own, before, after = (
        RunFolder(tmp_path / n).load().masters for n in ("own", "before", "after")
    )
    for new, old, first, last in zip(state.masters, own, before, after, strict=True):
        assert torch.allclose(new, old + 0.5 * (last - first))
    assert any(not torch.equal(new, old) for new, old in zip(state.masters, own, strict=True))


def test_a_lesson_needs_weights_to_be_added_to(tiny: Path, data: Path, tmp_path: Path) -> None:
    train(config(tiny, data, steps=1), tmp_path / "one", False, ignore)
    ends = {"before": str(tmp_path / "one"), "after": str(tmp_path / "one")}
    with pytest.raises(ValueError, match=r"lesson: .* set start"):
        train(config(tiny, data, lesson=ends), tmp_path / "run", False, ignore)
    wider = config(tiny, data, start=str(tmp_path / "one"), rank=8)
    train(config(tiny, data, rank=8, steps=1), tmp_path / "wide", False, ignore)
    other = {"before": str(tmp_path / "one"), "after": str(tmp_path / "wide")}
    mixed = wider.model_copy(update={"rank": 4, "lesson": Lesson.model_validate(other)})
    with pytest.raises(ValueError, match="wide: is of rank 8, the run of 4: a lesson"):
        train(mixed, tmp_path / "run2", False, ignore)


def written(tiny: Path, target: Path, **changed: int) -> Path:
    """Write an adapter of rank 4 and alpha 32 for `tiny`, or for its shape with sizes `changed`."""
    shape = replace(open_gguf(tiny)[1], **changed)
    made = TrainConfig(task="planner", base="tiny", data="data.jsonl", rank=4)
    origin = {BASE: "tiny", BASE_SHA256: hash_file(tiny)}
    write_adapter(target, Adapter(shape, 4, 32.0, 0, "cpu"), shape, made, origin)
    return target


@pytest.mark.parametrize("folder", [True, False])
@pytest.mark.parametrize("settings", [{"rank": 8}, {"alpha": 16.0}, {"rank": 12, "alpha": 5.0}])
def test_a_run_of_higher_rank_or_another_alpha_begins_with_the_same_corrections(
    settings: dict[str, float], folder: bool, tiny: Path, data: Path, tmp_path: Path
) -> None:
    first, file = tmp_path / "first", tmp_path / "first.gguf"
    train(config(tiny, data, steps=2, rank=4), first, False, ignore)
    export_adapter(first, file)
    wide = config(tiny, data, rank=4, start=str(first if folder else file)).model_copy(
        update=settings
    )
    begun(wide, tmp_path / "wide")
    export_adapter(tmp_path / "wide", tmp_path / "wide.gguf")
    before, after = corrections(file), corrections(tmp_path / "wide.gguf")
    assert before.keys() == after.keys()
    for name, correction in before.items():
        np.testing.assert_allclose(after[name], correction, rtol=0.01, atol=1e-4)


def corrections(file: Path) -> dict[str, NDArray[np.float32]]:
    """Return what an adapter adds to each matrix of its base."""
    found = AdapterFile.open(file)
    values = {
        name: gguf.dequantize(tensor.data, tensor.tensor_type)
        for name, tensor in found.stored.items()
    }
    scale = found.alpha / found.rank
    parts = (name.removesuffix(".lora_a") for name in values if name.endswith(".lora_a"))
    return {part: scale * values[f"{part}.lora_b"] @ values[f"{part}.lora_a"] for part in parts}


def test_a_run_of_lower_rank_begins_with_the_nearest_corrections(
    tiny: Path, data: Path, tmp_path: Path
) -> None:
    first, file = tmp_path / "first", tmp_path / "first.gguf"
    train(config(tiny, data, steps=2, rank=8), first, False, ignore)
    export_adapter(first, file)
    begun(config(tiny, data, start=str(first), rank=3, alpha=5.0), tmp_path / "cut")
    export_adapter(tmp_path / "cut", tmp_path / "cut.gguf")
    after = corrections(tmp_path / "cut.gguf")
    for name, whole in corrections(file).items():
        left, sizes, right = np.linalg.svd(whole)
        nearest = (left[:, :3] * sizes[:3]) @ right[:3]
        np.testing.assert_allclose(after[name], nearest, rtol=0.01, atol=1e-4)


def test_an_adapter_in_eight_bits_corrects_by_the_same_and_can_be_gone_on_from(
    tiny: Path, data: Path, tmp_path: Path
) -> None:
    chosen = config(tiny, data, steps=2, rank=32)
    for stored in ("f16", "q8_0"):
        train(chosen.model_copy(update={"stored": stored}), tmp_path / stored, False, ignore)
        export_adapter(tmp_path / stored, tmp_path / f"{stored}.gguf")
    exact, coarse = (corrections(tmp_path / f"{name}.gguf") for name in ("f16", "q8_0"))
    for name, correction in exact.items():
        largest = float(np.abs(correction).max())
        np.testing.assert_allclose(coarse[name], correction, atol=0.02 * largest)
    begun(config(tiny, data, rank=32, start=str(tmp_path / "q8_0.gguf")), tmp_path / "next")


def test_a_rank_that_eight_bits_cannot_hold_is_refused(
    tiny: Path, data: Path, tmp_path: Path
) -> None:
    train(config(tiny, data, steps=1, rank=4, stored="q8_0"), tmp_path / "run", False, ignore)
    with pytest.raises(ValueError, match=r"stored: .*: set stored=f16"):
        export_adapter(tmp_path / "run", tmp_path / "q8.gguf")


def test_a_folder_of_another_base_is_refused(tiny: Path, data: Path, tmp_path: Path) -> None:
    shape = replace(open_gguf(tiny)[1], hidden=40)
    other = RunFolder(tmp_path / "other")
    other.begin(config(tiny, data))
    other.save(State(Adapter(shape, 4, 32.0, 0, "cpu").masters, {}))
    for rank in (4, 8):
        chosen = config(tiny, data, start=str(tmp_path / "other"), rank=rank)
        with pytest.raises(ValueError, match="other: is of another base than"):
            train(chosen, tmp_path / f"run{rank}", False, ignore)


@pytest.mark.parametrize(
    ("sizes", "says"),
    [
        ({"layers": 1}, r"tensor blk\.1\.attn_q\.weight\.lora_a is missing"),
        ({"layers": 3}, r"blk\.2\.attn_k\.weight\.lora_a: is of a layer that is not trained here"),
        ({"hidden": 40}, r"blk\.0\.ffn_gate\.weight\.lora_b: is of \(40, 4\), not of \(64, 4\)"),
    ],
)
def test_a_file_with_other_layers_is_refused(
    sizes: dict[str, int], says: str, tiny: Path, data: Path, tmp_path: Path
) -> None:
    file = written(tiny, tmp_path / "adapter.gguf", **sizes)
    chosen = config(tiny, data)
    with pytest.raises(ValueError, match=f"adapter.gguf: {says}"):
        start_weights(file, chosen, open_gguf(tiny)[1], hash_file(tiny))


def test_an_adapter_of_another_base_of_the_same_shape_is_refused(
    tiny: Path, data: Path, tmp_path: Path
) -> None:
    file = written(tiny, tmp_path / "adapter.gguf")
    other = write_tiny(tmp_path / "other.gguf", seed=1)
    says = "adapter.gguf: is an adapter of another base, tiny .* set base, or start from another"
    with pytest.raises(ValueError, match=says):
        train(config(other, data, start=str(file)), tmp_path / "run", False, ignore)


def test_an_adapter_that_does_not_name_its_base_is_refused(
    tiny: Path, data: Path, tmp_path: Path
) -> None:
    shape, chosen = open_gguf(tiny)[1], config(tiny, data)
    file = tmp_path / "adapter.gguf"
    write_adapter(file, Adapter(shape, 4, 32.0, 0, "cpu"), shape, chosen, {})
    with pytest.raises(ValueError, match="does not say of which base it is"):
        start_weights(file, chosen, shape, hash_file(tiny))


def test_an_adapter_that_does_not_say_its_alpha_is_refused(
    tiny: Path, data: Path, tmp_path: Path
) -> None:
    shape, chosen = open_gguf(tiny)[1], config(tiny, data)
    file, origin = tmp_path / "adapter.gguf", {BASE_SHA256: hash_file(tiny)}
    write_adapter(file, Adapter(shape, 4, 0.0, 0, "cpu"), shape, chosen, origin)
    with pytest.raises(ValueError, match="does not say its alpha"):
        start_weights(file, chosen, shape, hash_file(tiny))


def test_what_is_no_adapter_is_refused(tiny: Path, data: Path, tmp_path: Path) -> None:
    whole = written(tiny, tmp_path / "adapter.gguf").read_bytes()
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
        with pytest.raises(ValueError, match=f"{file.name}: {says}"):
            start_weights(file, config(tiny, data), open_gguf(tiny)[1], hash_file(tiny))
