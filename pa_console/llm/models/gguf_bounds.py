"""Bounds on the header of a GGUF file, checked before llama.cpp parses it.

llama.cpp takes lengths, counts and offsets from the file. This module reads the same header in
Python, where a wrong length causes an error and not a read beyond the buffer. It compares every
number with the size of the file and with the needs of published models. It does not parse weights,
but checks that each tensor lies inside the file, directly after the one before.
"""

import mmap
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, NamedTuple

GgufKind = Literal["model", "adapter"]

MAGIC, VERSIONS = b"GGUF", (2, 3)
MOST_FIELDS, MOST_TENSORS = 4096, 65_536
"""The limits on the numbers of fields and of tensors. Published models have fewer than 100 fields
and 10,000 tensors."""
MOST_KEY_BYTES, MOST_NAME_BYTES = 256, 63
"""The limits on the length of a key, and of the name of a tensor (ggml's limit), in bytes."""
MOST_STRING_BYTES = 1 << 22
MOST_ITEMS = 1 << 22
"""The limit on the length of an array; the largest vocabularies have 262,144 pieces and 514,906
merges."""
MOST_DIMENSIONS = 4
MOST_WIDTH = 1 << 40
MOST_ALIGNMENT = 1 << 16
ALIGNMENT = 32
"""The default alignment of tensors, in bytes."""

STRING, ARRAY, BOOL, UINT32, FLOAT32 = 8, 9, 7, 4, 6
SCALARS = {
    0: "<B", 1: "<b", 2: "<H", 3: "<h", UINT32: "<I", 5: "<i", FLOAT32: "<f", BOOL: "<B",
    10: "<Q", 11: "<q", 12: "<d",
}  # fmt: skip
"""The layout of a number in a header, by its type."""

BLOCKS = {
    0: (1, 4), 1: (1, 2), 2: (32, 18), 3: (32, 20), 6: (32, 22), 7: (32, 24), 8: (32, 34),
    9: (32, 40), 10: (256, 84), 11: (256, 110), 12: (256, 144), 13: (256, 176), 14: (256, 210),
    15: (256, 292), 16: (256, 66), 17: (256, 74), 18: (256, 98), 19: (256, 50), 20: (32, 18),
    21: (256, 110), 22: (256, 82), 23: (256, 136), 24: (1, 1), 25: (1, 2), 26: (1, 4), 27: (1, 8),
    28: (1, 8), 29: (256, 56), 30: (1, 2), 34: (256, 54), 35: (256, 66), 39: (32, 17),
}  # fmt: skip
"""The number of weights in a block, and its size in bytes, by the number of the tensor's type."""
PLAIN_NUMBERS = frozenset((0, 1, 30))
"""The types f32, f16 and bf16."""

SIZES: dict[str, tuple[int, int]] = {
    ".block_count": (1, 1024),
    ".context_length": (1, 1 << 27),
    ".embedding_length": (1, 1 << 20),
    ".feed_forward_length": (0, 1 << 24),
    ".attention.head_count": (1, 4096),
    ".attention.head_count_kv": (0, 4096),
    ".attention.key_length": (1, 1 << 16),
    ".attention.value_length": (1, 1 << 16),
    ".attention.sliding_window": (0, 1 << 27),
    ".rope.dimension_count": (0, 1 << 16),
    ".expert_count": (0, 4096),
    ".expert_used_count": (0, 4096),
    ".vocab_size": (1, MOST_ITEMS),
}
"""The least and greatest values of the numbers from which llama.cpp computes the sizes of buffers.
"""

ARCHITECTURE, TYPE = "general.architecture", "general.type"
TOKENS = "tokenizer.ggml.tokens"
KINDS = {
    ARCHITECTURE: STRING, TYPE: STRING, "general.alignment": UINT32, "adapter.type": STRING,
    "adapter.lora.alpha": FLOAT32, "adapter.alora.invocation_tokens": ARRAY,
}  # fmt: skip
"""The types of values whose type llama.cpp does not check; it aborts the process if one differs."""
PER_TOKEN = ("tokenizer.ggml.scores", "tokenizer.ggml.token_type")
REMEDY = "fetch it again, or use another file"


class _Array(NamedTuple):
    """A list in a header, of which only the type and the length are kept."""

    kind: int
    length: int


_Value = int | float | str | _Array


class _Header:
    """A cursor in a GGUF file; every step raises ValueError if the file ends before it."""

    def __init__(self, content: mmap.mmap) -> None:
        self.content, self.size, self.at = content, len(content), 0

    def number(self, layout: str, label: str) -> Any:
        """Return the next number."""
        end = self.at + struct.calcsize(layout)
        if end > self.size:
            raise ValueError(f"the file ends within {label}")
        (value,) = struct.unpack_from(layout, self.content, self.at)
        self.at = end
        return value

    def count(self, layout: str, most: int, label: str) -> int:
        """Return the next whole number, which may be at most `most`."""
        value: int = self.number(layout, label)
        if value > most:
            raise ValueError(f"{label} is {value:,}, which is more than {most:,}")
        return value

    def skip(self, size: int, label: str) -> None:
        """Skip `size` bytes."""
        if size > self.size - self.at:
            raise ValueError(f"{label} goes beyond the end of the file")
        self.at += size

    def text(self, most: int, label: str) -> str:
        """Return the next text of at most `most` bytes."""
        size = self.count("<Q", most, f"the length of {label}")
        start = self.at
        self.skip(size, label)
        try:
            return self.content[start : self.at].decode("utf-8")
        except UnicodeDecodeError:
            raise ValueError(f"{label} is not UTF-8") from None

    def value(self, kind: int, key: str) -> _Value:
        """Return the next value of a field."""
        if kind == STRING:
            return self.text(MOST_STRING_BYTES, key)
        if kind == ARRAY:
            return self._array(key)
        if kind not in SCALARS:
            raise ValueError(f"{key} has a value of unknown type {kind}")
        value = self.number(SCALARS[kind], key)
        if kind == BOOL and value > 1:
            raise ValueError(f"{key} is {value}, which is neither true nor false")
        return value

    def _array(self, key: str) -> _Array:
        kind = self.number("<I", f"the type of {key}")
        count = self.count("<Q", MOST_ITEMS, f"the length of {key}")
        if kind == STRING and key == TOKENS:
            self._distinct_texts(count, key)
        elif kind == STRING:
            self._texts(count, key)
        elif kind in SCALARS:
            self.skip(count * struct.calcsize(SCALARS[kind]), key)
        else:
            raise ValueError(f"{key} is a list of unknown type {kind}")
        return _Array(kind, count)

    def _texts(self, count: int, key: str) -> None:
        """Skip `count` texts quickly, because a vocabulary has hundreds of thousands of texts."""
        content, at, last = self.content, self.at, self.size - 8
        length_of: Callable[[mmap.mmap, int], tuple[int]] = struct.Struct("<Q").unpack_from
        for _ in range(count):
            if at > last:
                raise ValueError(f"the file ends within {key}")
            at += 8 + length_of(content, at)[0]
        self.skip(at - self.at, key)

    def _distinct_texts(self, count: int, key: str) -> None:
        """Skip `count` texts, which must be distinct; otherwise llama.cpp aborts the process."""
        seen: set[bytes] = set()
        for _ in range(count):
            size: int = self.number("<Q", key)
            start = self.at
            self.skip(size, key)
            seen.add(self.content[start : self.at])
        if len(seen) < count:
            raise ValueError(f"{key} contains a text twice")


class _Tensor(NamedTuple):
    """The type and the place of a tensor: `size` bytes from `offset` bytes after the header."""

    name: str
    kind: int
    offset: int
    size: int


def check_gguf(path: str, kind: GgufKind, *, name: str = "") -> bool:
    """Raise ValueError, with the file and the problem, unless it is safe to parse `path`.

    Returns whether more than half of the weights, by bytes, are quantised. If `name` is given,
    errors use it as the name of the file. The check takes 1 s per 4 million pieces of a vocabulary.
    """
    try:
        with open(path, "rb") as stream:
            if not Path(path).stat().st_size:
                raise ValueError("the file is empty")
            with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
                tensors = _check(_Header(content), kind)
    except ValueError as error:
        raise ValueError(f"{name or path}: not a sound GGUF file: {error}; {REMEDY}") from error
    quantised = sum(tensor.size for tensor in tensors if tensor.kind not in PLAIN_NUMBERS)
    return 2 * quantised > sum(tensor.size for tensor in tensors)


def _check(header: _Header, kind: GgufKind) -> list[_Tensor]:
    if header.content[: len(MAGIC)] != MAGIC:
        raise ValueError("the file does not begin with GGUF")
    header.skip(len(MAGIC), "the beginning")
    if (version := header.number("<I", "the version")) not in VERSIONS:
        raise ValueError(f"the version is {version}, but only 2 and 3 are supported")
    tensor_count = header.count("<Q", MOST_TENSORS, "the number of tensors")
    field_count = header.count("<Q", MOST_FIELDS, "the number of fields")
    fields: dict[str, _Value] = {}
    for _ in range(field_count):
        key = header.text(MOST_KEY_BYTES, "a key")
        if not key or key in fields:
            raise ValueError(f"the key {key!r} appears twice" if key else "a key is empty")
        kind_of_value = header.number("<I", f"the type of {key}")
        if kind_of_value != (needed := KINDS.get(key, kind_of_value)):
            raise ValueError(f"{key} has a value of type {kind_of_value}, not {needed}")
        fields[key] = header.value(kind_of_value, key)
    _check_fields(fields, kind)
    alignment = fields.get("general.alignment", ALIGNMENT)
    if not isinstance(alignment, int) or not 0 < alignment <= MOST_ALIGNMENT:
        raise ValueError("general.alignment is out of range")
    if alignment & (alignment - 1):
        raise ValueError(f"general.alignment is {alignment}, which is not a power of two")
    tensors = [_tensor(header) for _ in range(tensor_count)]
    begin = header.at + -header.at % alignment
    _check_places(tensors, alignment, header.size - begin)
    return tensors


def _check_fields(fields: dict[str, _Value], kind: GgufKind) -> None:
    """Raise ValueError if a field does not fit the kind of file or another field."""
    if not isinstance(fields.get(ARCHITECTURE), str):
        raise ValueError(f"{ARCHITECTURE} is missing")
    is_adapter = fields.get(TYPE) == "adapter"
    if is_adapter != (kind == "adapter"):
        raise ValueError("it is an adapter, not a model" if is_adapter else "it is not an adapter")
    for key, value in fields.items():
        suffix = next((end for end in SIZES if key.endswith(end)), None)
        if suffix is not None and not isinstance(value, _Array):
            least, most = SIZES[suffix]
            if not isinstance(value, int) or not least <= value <= most:
                raise ValueError(f"{key} is {value!r}, which is not from {least} to {most:,}")
        if isinstance(value, float) and not abs(value) < float("inf"):
            raise ValueError(f"{key} is {value}")
    tokens = fields.get(TOKENS)
    if tokens is None:
        return
    if not isinstance(tokens, _Array) or tokens.kind != STRING or not tokens.length:
        raise ValueError(f"{TOKENS} is not a list of texts")
    for key in PER_TOKEN:
        listed = fields.get(key)
        if listed is not None and not (
            isinstance(listed, _Array) and listed.length == tokens.length and listed.kind in SCALARS
        ):
            raise ValueError(f"{key} does not have the same length as {TOKENS}")


def _tensor(header: _Header) -> _Tensor:
    """Return the next tensor; raises ValueError for a type or shape that is not possible."""
    name = header.text(MOST_NAME_BYTES, "the name of a tensor")
    count = header.count("<I", MOST_DIMENSIONS, f"the number of dimensions of {name}")
    shape = tuple(header.count("<Q", MOST_WIDTH, f"a dimension of {name}") for _ in range(count))
    kind = header.number("<I", f"the type of {name}")
    if kind not in BLOCKS:
        raise ValueError(f"{name} has weights of unknown type {kind}")
    weights, size = BLOCKS[kind]
    if not shape or 0 in shape or shape[0] % weights:
        raise ValueError(f"{name} has the shape {shape}, which is not possible for its type")
    for width in shape:
        size *= width
    return _Tensor(name, kind, header.number("<Q", f"the offset of {name}"), size // weights)


def _check_places(tensors: list[_Tensor], alignment: int, room: int) -> None:
    """Raise ValueError unless the tensors lie directly one after another within `room` bytes."""
    names = [tensor.name for tensor in tensors]
    if len(set(names)) < len(names):
        raise ValueError("two tensors have the same name")
    end = 0
    for tensor in tensors:
        if tensor.offset != end:
            raise ValueError(f"{tensor.name} begins at {tensor.offset:,}, not at {end:,}")
        if tensor.size > room - tensor.offset:
            raise ValueError(f"{tensor.name} goes beyond the end of the file")
        end = tensor.offset + tensor.size + -tensor.size % alignment
