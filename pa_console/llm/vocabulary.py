"""Leaves out of a GGUF file the pieces of its vocabulary that no operator's English needs.

A vocabulary for every script of the world is most of a small model: of the 270 million weights of
Gemma 3 270M, 168 million are its 262,144 rows. What is left out is written in smaller pieces or
bytes, as a name in another script is.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gguf
import numpy as np

TOKENS, SCORES, TYPES = (f"tokenizer.ggml.{name}" for name in ("tokens", "scores", "token_type"))
VOCABULARY_SIZE, TOKEN_ID = ".vocab_size", "_token_id"
ROWS = frozenset({"token_embd.weight", "output.weight"})
"""The tensors that have a row for every piece."""
SCORED_MODEL = "llama"
"""The kind of tokeniser that merges two neighbours whenever the whole is a piece of its own."""
SPACE = "\u2581"
ALWAYS = frozenset({gguf.TokenType.BYTE, gguf.TokenType.USER_DEFINED})
SPARE = 256
"""The first control piece that nothing uses."""
PLAIN_CHARACTERS = (range(0x250), range(0x2000, 0x2300))
"""Latin letters, punctuation, currencies, arrows and operators: kept where they are pieces."""


def cut_vocabulary(source: Path, target: Path, pieces: int) -> int:
    """Write the model of `source` to `target` with a smaller vocabulary, and return its size.

    Kept are bytes, characters, the control pieces that are in use, and of the first `pieces` those
    in ASCII. Pieces are in the order in which they were found, the commonest first, and the two
    parts of a piece were found before it: what remains is the vocabulary of a tokeniser that
    stopped looking earlier, and text in pieces that remain is read as before. Raises ValueError
    for a file that is not of that kind.
    """
    reader = gguf.GGUFReader(source)
    if SCORES not in reader.fields or _content(reader, "tokenizer.ggml.model") != SCORED_MODEL:
        raise ValueError(f"{source}: only a vocabulary of scored pieces can be cut")
    kept = kept_pieces(_content(reader, TOKENS), _content(reader, TYPES), pieces)
    architecture = _content(reader, gguf.Keys.General.ARCHITECTURE)
    writer = gguf.GGUFWriter(target, architecture)
    for field in reader.fields.values():
        if field.name.startswith("GGUF.") or field.name == gguf.Keys.General.ARCHITECTURE:
            continue
        kinds = field.types
        array = kinds[0] == gguf.GGUFValueType.ARRAY
        value = _cut(field.name, field.contents(), kept)
        writer.add_key_value(field.name, value, kinds[0], sub_type=kinds[-1] if array else None)
    rows = np.array(kept)
    for tensor in reader.tensors:
        data = tensor.data[rows] if tensor.name in ROWS else tensor.data
        writer.add_tensor(tensor.name, data, raw_dtype=tensor.tensor_type)
    writer.write_header_to_file()
    writer.write_kv_data_to_file()
    writer.write_tensors_to_file()
    writer.close()
    return len(kept)


def kept_pieces(words: Sequence[str], types: Sequence[int], pieces: int) -> list[int]:
    """Return the numbers of the pieces that are kept, in order."""
    return [
        number
        for number, (word, kind) in enumerate(zip(words, types, strict=True))
        if _kept(number, word, gguf.TokenType(kind), pieces)
    ]


def _kept(number: int, word: str, kind: gguf.TokenType, pieces: int) -> bool:
    if kind in ALWAYS:
        return True
    if kind != gguf.TokenType.NORMAL:
        return number < SPARE
    if len(word) == 1:
        return word == SPACE or any(ord(word) in block for block in PLAIN_CHARACTERS)
    return number < pieces and word.replace(SPACE, " ").isascii()


def _cut(name: str, value: Any, kept: Sequence[int]) -> Any:
    """Return what the field called `name` says of the pieces that are `kept`."""
    if name in {TOKENS, SCORES, TYPES}:
        return [value[number] for number in kept]
    if name.endswith(VOCABULARY_SIZE):
        return len(kept)
    return kept.index(value) if name.endswith(TOKEN_ID) else value


def _content(reader: gguf.GGUFReader, name: str) -> Any:
    field = reader.get_field(name)
    if field is None:
        raise ValueError(f"{name} is missing")
    return field.contents()
