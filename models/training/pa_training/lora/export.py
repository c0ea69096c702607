"""Writes a trained adapter as llama.cpp reads it: a GGUF file beside the one of its base."""

import hashlib
import os
from pathlib import Path

import gguf
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pa_training.lora.adapter import (
    BASE,
    BASE_SHA256,
    CONFIG,
    EARLIER,
    PREFIX,
    SAMPLES,
    Adapter,
)
from pa_training.lora.base import to_pairs
from pa_training.lora.checkpoint import RunFolder
from pa_training.lora.config import TrainConfig, find_base
from pa_training.lora.shape import Shape, open_gguf
from pa_training.results.lineage import kept_earlier, run_row, to_json


def export_adapter(run: Path, target: Path) -> str:
    """Write the adapter of the run in folder `run` to `target` and return its SHA-256.

    Weights are of the config's `stored`; the metadata tells the runs that it went through
    (`lineage.py`). Raises ValueError when there is no run, its base is not here, or its matrices do
    not fit that type, or OSError.
    """
    folder = RunFolder(run)
    config, state = folder.config(), folder.load()
    path, _ = find_base(config)
    shape = open_gguf(path)[1]
    adapter = Adapter(shape, config.rank, config.alpha, config.seed, "cpu")
    sizes = [master.shape for master in adapter.masters]
    if sizes != [master.shape for master in state.masters]:
        raise ValueError(f"{run}: was trained on another base than {path}")
    adapter.masters = state.masters
    origin = {
        BASE: config.without_folders().base,
        BASE_SHA256: state.base_sha256,
        f"{PREFIX}.data_sha256": state.data_sha256,
        f"{PREFIX}.steps": str(state.step),
        SAMPLES: str(state.samples),
        EARLIER: to_json([*kept_earlier(run, config), run_row(run, config)]),
    }
    write_adapter(target, adapter, shape, config.without_folders(), origin)
    return hashlib.sha256(target.read_bytes()).hexdigest()


def write_adapter(
    target: Path, adapter: Adapter, shape: Shape, config: TrainConfig, origin: dict[str, str]
) -> None:
    """Write `adapter` to `target`; `origin` becomes metadata by its keys, beside the config."""
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = target.with_name(f"{target.name}.partial")
    writer = gguf.GGUFWriter(partial, shape.architecture)
    writer.add_type(gguf.GGUFType.ADAPTER)
    writer.add_string(gguf.Keys.Adapter.TYPE, "lora")
    writer.add_float32(gguf.Keys.Adapter.LORA_ALPHA, adapter.alpha)
    writer.add_name(f"{config.task} adapter of {config.base}")
    writer.add_string(CONFIG, config.model_dump_json())
    for key, value in origin.items():
        writer.add_string(key, value)
    kind = gguf.GGMLQuantizationType[config.stored.upper()]
    for name, pair in matrices(adapter, shape).items():
        for end, values in zip(("lora_a", "lora_b"), pair, strict=True):
            try:
                stored = gguf.quantize(values, kind)
            except gguf.QuantError as error:
                raise ValueError(f"stored: {name}: {error}: set stored=f16") from error
            writer.add_tensor(f"{name}.weight.{end}", stored, raw_dtype=kind)
    writer.write_header_to_file()
    writer.write_kv_data_to_file()
    writer.write_tensors_to_file()
    writer.close()
    os.replace(partial, target)


def matrices(
    adapter: Adapter, shape: Shape
) -> dict[str, tuple[NDArray[np.float32], NDArray[np.float32]]]:
    """Return A (rank, inputs) and B (outputs, rank) of every linear layer, by llama.cpp's names.

    B of q and k has its rows where the base has them (`Shape.paired_heads`).
    """
    found: dict[str, tuple[NDArray[np.float32], NDArray[np.float32]]] = {}
    per_layer = len(adapter.slots) // shape.layers
    for number, slot in enumerate(adapter.slots):
        a, b = adapter.masters[2 * number : 2 * number + 2]
        each = zip(
            slot.parts,
            torch.split(a, adapter.rank),
            torch.split(b, list(slot.outputs)),
            strict=True,
        )
        for part, own_a, own_b in each:
            rows = _array(own_b)
            if part in shape.paired_heads:
                rows = to_pairs(rows, shape.paired_heads[part])
            found[f"blk.{number // per_layer}.{part}"] = _array(own_a), rows
    return found


def _array(tensor: Tensor) -> NDArray[np.float32]:
    return tensor.detach().cpu().numpy()
