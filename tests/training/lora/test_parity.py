"""What is trained is what llama.cpp computes, with and without an adapter."""

from pathlib import Path

import pytest
import torch

from pa_console.llm.models.catalogue import LocalModel
from pa_training.lora.adapter import BASE_SHA256, Adapter
from pa_training.lora.config import TrainConfig
from pa_training.lora.export import write_adapter
from pa_training.lora.shape import ARCHITECTURES, open_gguf
from tests.llm.conftest import smallest_model
from tests.training.lora.parity import compare
from tests.training.lora.tiny import write_tiny

__all__ = ["smallest_model"]

TOKENS = [int(x) for x in torch.randint(3, 259, (40,), generator=torch.Generator().manual_seed(1))]


def busy_adapter(base: Path, strength: float) -> Adapter:
    """Return an adapter that changes every layer."""
    adapter = Adapter(open_gguf(base)[1], rank=3, alpha=6.0, seed=4, device="cpu")
    generator = torch.Generator().manual_seed(5)
    with torch.no_grad():
        for master in adapter.masters[1::2]:
            master.copy_(torch.randn(master.shape, generator=generator) * strength)
    return adapter


def exported(adapter: Adapter, base: Path, target: Path) -> Path:
    config = TrainConfig(task="planner", base=str(base), data="none.jsonl", rank=3, alpha=6.0)
    write_adapter(target, adapter, open_gguf(base)[1], config, {BASE_SHA256: "0" * 64})
    return target


@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_the_forward_pass_is_llama_cpps(architecture: str, tmp_path: Path) -> None:
    base = write_tiny(tmp_path / "base.gguf", architecture)
    found = compare(base, None, None, TOKENS)
    assert found.correlation > 0.99999
    assert found.largest < 1e-2


@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_an_exported_adapter_computes_what_was_trained(architecture: str, tmp_path: Path) -> None:
    base = write_tiny(tmp_path / "base.gguf", architecture)
    adapter = busy_adapter(base, 0.3)
    file = exported(adapter, base, tmp_path / "adapter.gguf")
    assert compare(base, adapter, file, TOKENS).correlation > 0.99999
    assert compare(base, None, file, TOKENS).correlation < 0.99


def test_an_adapter_of_another_base_is_refused(tmp_path: Path, tiny: Path) -> None:
    other = write_tiny(tmp_path / "base.gguf", "qwen2")
    file = exported(busy_adapter(other, 0.1), other, tmp_path / "adapter.gguf")
    with pytest.raises(ValueError, match="not an adapter"):
        compare(tiny, None, file, TOKENS)


def test_the_smallest_real_model_agrees_up_to_its_rounding(
    smallest_model: LocalModel, tmp_path: Path
) -> None:
    adapter = busy_adapter(smallest_model.path, 0.01)
    file = exported(adapter, smallest_model.path, tmp_path / "adapter.gguf")
    found = compare(smallest_model.path, adapter, file, TOKENS)
    assert found.correlation > 0.995
    assert found.largest < 0.1
