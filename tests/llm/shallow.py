"""Cuts a model of few layers from a real one: it reads and writes as fast as tests want it to.

Its vocabulary, chat template and context are those of the whole model; what it says makes no sense.
"""

import re
from pathlib import Path

import gguf

LAYERS = 2
_LAYER = re.compile(r"blk\.(\d+)\.")


def write_shallow(source: Path, target: Path) -> None:
    """Write the first `LAYERS` layers of the GGUF model `source` to `target`."""
    reader = gguf.GGUFReader(source)
    architecture = reader.fields[gguf.Keys.General.ARCHITECTURE].contents()
    count = gguf.Keys.LLM.BLOCK_COUNT.format(arch=architecture)
    writer = gguf.GGUFWriter(target, architecture)
    for name, field in reader.fields.items():
        if name.startswith("GGUF.") or name == gguf.Keys.General.ARCHITECTURE:
            continue
        kinds = field.types
        array = kinds[0] == gguf.GGUFValueType.ARRAY
        value = LAYERS if name == count else field.contents()
        writer.add_key_value(name, value, kinds[0], sub_type=kinds[-1] if array else None)
    for tensor in reader.tensors:
        layer = _LAYER.match(tensor.name)
        if layer is None or int(layer[1]) < LAYERS:
            writer.add_tensor(tensor.name, tensor.data, raw_dtype=tensor.tensor_type)
    writer.write_header_to_file()
    writer.write_kv_data_to_file()
    writer.write_tensors_to_file()
    writer.close()
