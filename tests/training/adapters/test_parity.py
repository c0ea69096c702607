"""What is trained is what llama.cpp computes, with and without an adapter."""

from pathlib import Path

import numpy as np
import pytest

from pa_console.llm.models.catalogue import LocalModel
from pa_console.resources import data_folder
from pa_training.adapters.adapter_file import BASE_SHA256, AdapterFile, Matrices, write_adapter
from pa_training.adapters.config import TrainConfig
from pa_training.adapters.network import adapted, load_base, matrices, paired_heads
from tests.llm.conftest import smallest_model
from tests.training.adapters.parity import compare
from tests.training.adapters.tiny import ARCHITECTURES, write_tiny

__all__ = ["smallest_model"]

TOKENS = np.random.default_rng(1).integers(3, 259, 40).tolist()


def configured(base: Path) -> TrainConfig:
    return TrainConfig(
        task="planner", base=str(base), data="none.jsonl", rank=3, alpha=6.0, device="cpu"
    )


def busy_adapter(base: Path, strength: float, target: Path) -> Matrices:
    """Return an adapter that changes every layer, and write it to `target`."""
    config, random = configured(base), np.random.default_rng(5)
    network = load_base(base, config)
    heads = paired_heads(base, network)
    found = {
        name: (a, (random.standard_normal(b.shape) * strength).astype(np.float32))
        for name, (a, b) in matrices(adapted(network, config)).items()
    }
    architecture = str(network.config.model_type).removesuffix("_text")
    write_adapter(target, architecture, found, heads, config, {BASE_SHA256: "0" * 64})
    return found


@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_the_network_that_is_trained_is_llama_cpps(architecture: str, tmp_path: Path) -> None:
    base = write_tiny(tmp_path / "base.gguf", architecture)
    found = compare(base, configured(base), None, None, TOKENS)
    assert found.correlation > 0.99999
    assert found.largest < 1e-2


@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_an_exported_adapter_computes_what_was_trained(architecture: str, tmp_path: Path) -> None:
    base, file = write_tiny(tmp_path / "base.gguf", architecture), tmp_path / "adapter.gguf"
    adapter = busy_adapter(base, 0.3, file)
    assert compare(base, configured(base), adapter, file, TOKENS).correlation > 0.99999
    assert compare(base, configured(base), None, file, TOKENS).correlation < 0.99


@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_an_exported_adapter_is_read_as_it_was(architecture: str, tmp_path: Path) -> None:
    base, file = write_tiny(tmp_path / "base.gguf", architecture), tmp_path / "adapter.gguf"
    written = busy_adapter(base, 0.3, file)
    heads = paired_heads(base, load_base(base, configured(base)))
    assert bool(heads) == (architecture == "llama")
    read = AdapterFile.open(file).matrices(heads)
    assert read.keys() == written.keys()
    for name, pair in written.items():
        for one, other in zip(read[name], pair, strict=True):
            np.testing.assert_array_equal(one, other.astype(np.float16).astype(np.float32))


def test_an_adapter_of_another_base_is_refused(tmp_path: Path, tiny: Path) -> None:
    other, file = write_tiny(tmp_path / "base.gguf", "qwen2"), tmp_path / "adapter.gguf"
    busy_adapter(other, 0.1, file)
    with pytest.raises(ValueError, match="not an adapter"):
        compare(tiny, configured(tiny), None, file, TOKENS)


def test_the_smallest_real_model_agrees_up_to_its_rounding(
    smallest_model: LocalModel, tmp_path: Path
) -> None:
    file = tmp_path / "adapter.gguf"
    adapter = busy_adapter(smallest_model.path, 0.01, file)
    config = configured(smallest_model.path)
    found = compare(smallest_model.path, config, adapter, file, TOKENS)
    assert found.correlation > 0.995
    assert found.largest < 0.1


def test_a_shipped_adapter_is_read_as_llama_cpp_reads_it(smallest_model: LocalModel) -> None:
    base, file = smallest_model.path, data_folder() / "models" / "planner.lora.gguf"
    config = configured(base).model_copy(update={"rank": 16, "alpha": 32.0})
    adapter = AdapterFile.open(file).matrices(paired_heads(base, load_base(base, config)))
    found = compare(base, config, adapter, file, TOKENS)
    assert found.correlation > 0.995
    assert compare(base, config, None, file, TOKENS).correlation < 0.95
