"""Makes an adapter with random weights for a GGUF model: it knows nothing and changes answers."""

from pathlib import Path

import numpy as np
import pytest

RANK = 4
STRENGTH = 0.02


def write_random_adapter(model: Path, target: Path, seed: int) -> Path:
    """Write an adapter for all linear layers of `model` to `target`; skips where gguf is not."""
    gguf = pytest.importorskip("gguf")
    reader = gguf.GGUFReader(model)
    random = np.random.default_rng(seed)
    writer = gguf.GGUFWriter(target, reader.get_field("general.architecture").contents())
    writer.add_type(gguf.GGUFType.ADAPTER)
    writer.add_string(gguf.Keys.Adapter.TYPE, "lora")
    writer.add_float32(gguf.Keys.Adapter.LORA_ALPHA, float(RANK))
    for tensor in reader.tensors:
        if tensor.name.startswith("blk.") and len(tensor.shape) == 2:
            columns, rows = (int(size) for size in tensor.shape)
            for name, shape in (("lora_a", (RANK, columns)), ("lora_b", (rows, RANK))):
                weights = random.standard_normal(shape) * STRENGTH**0.5
                writer.add_tensor(f"{tensor.name}.{name}", weights.astype(np.float16))
    writer.write_header_to_file()
    writer.write_kv_data_to_file()
    writer.write_tensors_to_file()
    writer.close()
    return target
