"""Conversion of a GGUF file to a smaller vocabulary and to weights of another type.

In a small model, the vocabulary takes most of the weights if it covers all scripts of the world: in
Gemma 3 270M, its 262,144 rows have 168 of 270 million weights. If a piece is removed, text that
needs it is written in smaller pieces or bytes. An output layer that only repeats the embeddings is
removed too.

`python -m pa_console.llm.models.gguf_conversion SOURCE TARGET TYPE PIECES` exits with 0 when TARGET
is complete. It is a separate process, so that it can be stopped. The TYPE `stored` keeps the type
of the weights, and 0 for PIECES keeps the whole vocabulary.
"""

import sys
from collections.abc import Sequence, Set
from pathlib import Path
from typing import Any

import gguf
import llama_cpp
import numpy as np
from numpy.typing import NDArray

from pa_console.llm.models.gguf_bounds import check_gguf
from pa_console.llm.models.preparing import AS_STORED, Quantisation

TOKENS, SCORES, TYPES, MERGES = (
    f"tokenizer.ggml.{name}" for name in ("tokens", "scores", "token_type", "merges")
)
VOCABULARY_SIZE, TOKEN_ID = ".vocab_size", "_token_id"
EMBEDDINGS, OUTPUT = "token_embd.weight", "output.weight"
"""The tensors with a row for every piece."""
SCORED_MODEL = "llama"
"""The kind of tokeniser that merges two neighbouring pieces whenever the result is a piece."""
MERGING_MODEL = "gpt2"
"""The kind of tokeniser that merges neighbouring pieces by rules; its pieces are in the order of
the rules.
"""
SPACE = "\u2581"
BYTE_SPACES = str.maketrans({"\u0120": " ", "\u010a": "\n", "\u0109": "\t", "\u010d": "\r"})
"""The white space of a byte-level tokeniser, and the characters that it stands for."""
ALIKE = 0.99
"""The least cosine of two rows that differ only in rounding."""
IN_USE = frozenset({gguf.TokenType.CONTROL, gguf.TokenType.USER_DEFINED})
ALWAYS = frozenset({gguf.TokenType.BYTE, gguf.TokenType.USER_DEFINED})
SPARE = 256
"""The number of the first unused control piece."""
PLAIN_CHARACTERS = (range(0x250), range(0x2000, 0x2300))
"""The code points of Latin letters, punctuation, currencies, arrows and operators. A piece that is
one of these characters is kept.
"""

_api: Any = llama_cpp
FILE_TYPES: dict[Quantisation, int] = {
    "f16": _api.LLAMA_FTYPE_MOSTLY_F16,
    "bf16": _api.LLAMA_FTYPE_MOSTLY_BF16,
    "q8_0": _api.LLAMA_FTYPE_MOSTLY_Q8_0,
    "q4_0": _api.LLAMA_FTYPE_MOSTLY_Q4_0,
}


def cut_vocabulary(source: Path, target: Path, pieces: int) -> int:
    """Write the model of `source` to `target` with a smaller vocabulary; return its size.

    The result keeps bytes, characters, the control pieces that are used, and the ASCII pieces among
    the first `pieces`. The pieces of a vocabulary are in the order in which its training found
    them: the commonest first, and each after the two parts that form it. Therefore, the remaining
    pieces are like the vocabulary of a training that stopped earlier, and text that uses only
    remaining pieces is tokenised as before. The size is the number of pieces kept. Raises
    ValueError for another kind of vocabulary.
    """
    reader = gguf.GGUFReader(source)
    kept = _kept_of(reader, source, pieces)
    all_words = _content(reader, TOKENS)
    words = {all_words[number] for number in kept}
    architecture = _content(reader, gguf.Keys.General.ARCHITECTURE)
    writer = gguf.GGUFWriter(target, architecture)
    for field in reader.fields.values():
        if field.name.startswith("GGUF.") or field.name == gguf.Keys.General.ARCHITECTURE:
            continue
        kinds = field.types
        array = kinds[0] == gguf.GGUFValueType.ARRAY
        value = _cut(field.name, field.contents(), kept, words)
        writer.add_key_value(field.name, value, kinds[0], sub_type=kinds[-1] if array else None)
    tensors = {tensor.name: tensor for tensor in reader.tensors}
    rows = np.array(kept)
    if OUTPUT in tensors and _repeats(tensors[EMBEDDINGS], tensors[OUTPUT], rows):
        tensors[EMBEDDINGS] = tensors.pop(OUTPUT)
    for name, tensor in tensors.items():
        data = tensor.data[rows] if name in {EMBEDDINGS, OUTPUT} else tensor.data
        writer.add_tensor(name, data, raw_dtype=tensor.tensor_type)
    writer.write_header_to_file()
    writer.write_kv_data_to_file()
    writer.write_tensors_to_file()
    writer.close()
    return len(kept)


def _repeats(embeddings: Any, output: Any, rows: NDArray[np.int64]) -> bool:
    """Return whether the output layer repeats the embeddings with eight bits per weight."""
    if output.tensor_type != gguf.GGMLQuantizationType.Q8_0:
        return False
    some = rows[:: max(1, len(rows) // 1000)]
    a, b = (gguf.dequantize(t.data[some], t.tensor_type) for t in (embeddings, output))
    cosines = (a * b).sum(1) / (np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1) + 1e-9)
    return bool(np.median(cosines) > ALIKE)


def _kept_of(reader: gguf.GGUFReader, source: Path, pieces: int) -> list[int]:
    model = _content(reader, "tokenizer.ggml.model")
    words, types = _content(reader, TOKENS), _content(reader, TYPES)
    if model == SCORED_MODEL and SCORES in reader.fields:
        return kept_pieces(words, types, pieces)
    if model == MERGING_MODEL and MERGES in reader.fields:
        return kept_merged_pieces(words, types, pieces)
    raise ValueError(f"{source}: only a vocabulary of scored or merged pieces can be cut")


def kept_pieces(words: Sequence[str], types: Sequence[int], pieces: int) -> list[int]:
    """Return the indices of the scored pieces to keep, in ascending order."""
    return [
        number
        for number, (word, kind) in enumerate(zip(words, types, strict=True))
        if _kept(number, word, gguf.TokenType(kind), pieces)
    ]


def kept_merged_pieces(words: Sequence[str], types: Sequence[int], pieces: int) -> list[int]:
    """Return the indices of the merged pieces to keep, in ascending order.

    In a byte-level BPE model, every byte is a piece of one character, and all of these are kept.
    """
    return [
        number
        for number, (word, kind) in enumerate(zip(words, types, strict=True))
        if kind in IN_USE
        or len(word) == 1
        or (number < pieces and word.translate(BYTE_SPACES).isascii())
    ]


def _kept(number: int, word: str, kind: gguf.TokenType, pieces: int) -> bool:
    if kind in ALWAYS:
        return True
    if kind != gguf.TokenType.NORMAL:
        return number < SPARE
    if len(word) == 1:
        return word == SPACE or any(ord(word) in block for block in PLAIN_CHARACTERS)
    return number < pieces and word.replace(SPACE, " ").isascii()


def _cut(name: str, value: Any, kept: Sequence[int], words: Set[str]) -> Any:
    """Return the field `name` for the pieces that remain: their indices `kept`, and `words`."""
    if name in {TOKENS, SCORES, TYPES}:
        return [value[number] for number in kept]
    if name == MERGES:
        return [rule for rule in value if _within(rule, words)]
    if name.endswith(VOCABULARY_SIZE):
        return len(kept)
    return kept.index(value) if name.endswith(TOKEN_ID) else value


def _within(rule: str, words: Set[str]) -> bool:
    left, right = rule.split(" ")
    return left in words and right in words and left + right in words


def _content(reader: gguf.GGUFReader, name: str) -> Any:
    field = reader.get_field(name)
    if field is None:
        raise ValueError(f"{name} is missing")
    return field.contents()


def quantise(source: str, target: str, quantisation: Quantisation) -> None:
    """Write the weights of `source` to `target` as `quantisation`; raises ValueError on failure.

    The embeddings and the output layer always become Q8_0. They are read one row or one token at a
    time, so a wider type would only cost memory.
    """
    parameters = _api.llama_model_quantize_default_params()
    parameters.ftype = FILE_TYPES[quantisation]
    parameters.allow_requantize = True
    parameters.token_embedding_type = parameters.output_tensor_type = _api.GGML_TYPE_Q8_0
    if _api.llama_model_quantize(source.encode(), target.encode(), parameters) != 0:
        raise ValueError(f"llama.cpp could not write {target} from {source}")


def convert(source: str, target: str, kind: str, pieces: int) -> None:
    """Convert `source` to `target` with weights of type `kind` and the first `pieces`, if not 0.

    The header of `source` is checked before a library parses it, because this process is not
    confined. Raises ValueError or OSError.
    """
    check_gguf(source, "model")
    if pieces and kind == AS_STORED:
        cut_vocabulary(Path(source), Path(target), pieces)
    elif pieces:
        smaller = f"{target}.cut"
        cut_vocabulary(Path(source), Path(smaller), pieces)
        quantise(smaller, target, kind)  # type: ignore[arg-type]
        Path(smaller).unlink()
    else:
        quantise(source, target, kind)  # type: ignore[arg-type]


@_api.llama_log_callback
def _no_log(_level: int, _text: bytes, _data: object) -> None:
    """Discard llama.cpp's log, which has a line for every tensor."""


if __name__ == "__main__":
    _api.llama_log_set(_no_log, None)
    try:
        convert(sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4]))
    except (ValueError, OSError) as error:
        sys.exit(str(error))
