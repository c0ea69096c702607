"""The network that is trained: the weights of a GGUF file, frozen, with an adapter by peft.

The base is read from the very file that llama.cpp runs, so what is trained is what is computed.
"""

from pathlib import Path
from typing import Any, cast

import gguf
import torch
from peft import LoraConfig, PeftModel, get_peft_model
from peft.tuners.lora import LoraLayer
from torch import Tensor
from transformers import AutoConfig, AutoModelForCausalLM, GgufConfig, PreTrainedModel

from pa_training.adapters.adapter_file import Array, Matrices
from pa_training.adapters.config import TrainConfig

LAYERS = {
    "attn_q": "self_attn.q_proj",
    "attn_k": "self_attn.k_proj",
    "attn_v": "self_attn.v_proj",
    "attn_output": "self_attn.o_proj",
    "ffn_gate": "mlp.gate_proj",
    "ffn_up": "mlp.up_proj",
    "ffn_down": "mlp.down_proj",
}
"""The linear layers that are adapted, by llama.cpp's names."""


def load_base(path: Path, config: TrainConfig) -> PreTrainedModel:
    """Return the network of the GGUF file at `path`, its weights in the precision of `config`.

    Raises ValueError for a file or an architecture that transformers cannot read.
    """
    place = {"pretrained_model_name_or_path": str(path.parent), "gguf_file": path.name}
    shape = cast(Any, AutoConfig.from_pretrained(**place))
    shape.use_cache = False
    if shape.model_type == "gemma3_text":
        # llama.cpp scales by the width of a head; transformers has a default that no file changes.
        shape.query_pre_attn_scalar = shape.head_dim
    network: Any = AutoModelForCausalLM.from_pretrained(
        **place,
        config=shape,
        dtype=torch.bfloat16 if in_bfloat16(config) else torch.float32,
        quantization_config=GgufConfig(dequantize=True),
    )
    # The weights are unpacked; as long as it is marked as quantized, it may not be trained.
    network.is_quantized, network.hf_quantizer = False, None
    return network


def in_bfloat16(config: TrainConfig) -> bool:
    """Return whether the run of `config` computes in bfloat16."""
    if config.precision == "auto":
        return config.device == "auto" and torch.cuda.is_available()
    return config.precision == "bfloat16"


def adapted(base: PreTrainedModel, config: TrainConfig) -> PeftModel:
    """Return `base` with a fresh adapter: A random, B zero, so that it changes nothing."""
    targets = [name.rpartition(".")[2] for name in LAYERS.values()]
    alpha = cast(int, config.alpha)  # any number will do
    return get_peft_model(base, LoraConfig(r=config.rank, lora_alpha=alpha, target_modules=targets))


def matrices(model: PeftModel) -> Matrices:
    """Return the adapter of `model`, by llama.cpp's names."""
    return {
        name: (_array(layer.lora_A["default"].weight), _array(layer.lora_B["default"].weight))
        for name, layer in _adapted_layers(model)
    }


def set_matrices(model: PeftModel, values: Matrices) -> None:
    """Give `model` another adapter of the same shape."""
    with torch.no_grad():
        for name, layer in _adapted_layers(model):
            for own, value in zip((layer.lora_A, layer.lora_B), values[name], strict=True):
                own["default"].weight.copy_(torch.from_numpy(value))


def paired_heads(path: Path, base: PreTrainedModel) -> dict[str, int]:
    """Return the heads of the layers whose rows the file at `path` holds in pairs."""
    if architecture(path) != "llama":
        return {}
    shape: Any = base.config
    return {"attn_q": shape.num_attention_heads, "attn_k": shape.num_key_value_heads}


def _adapted_layers(model: PeftModel) -> list[tuple[str, Any]]:
    names = {theirs: own for own, theirs in LAYERS.items()}
    found: list[tuple[str, Any]] = []
    layers: list[tuple[str, Any]] = list(cast(Any, model).named_modules())
    for name, layer in layers:
        if isinstance(layer, LoraLayer):
            _, _, place = name.partition(".layers.")
            number, _, part = place.partition(".")
            found.append((f"blk.{number}.{names[part]}", layer))
    return found


def _array(weight: Tensor) -> Array:
    return weight.detach().float().cpu().numpy()


def architecture(path: Path) -> str:
    """Return the architecture of the GGUF file at `path`."""
    return str(gguf.GGUFReader(path).fields[gguf.Keys.General.ARCHITECTURE].contents())
