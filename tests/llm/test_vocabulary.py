"""A cut vocabulary: text in what is left is read as before, and all other text still is."""

from pathlib import Path

import gguf
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from llama_cpp import Llama

from pa_console.llm.models.gguf_conversion import cut_vocabulary

CONTROL = ["<pad>", "<eos>", "<bos>", "<unk>"]
BYTES = [f"<0x{byte:02X}>" for byte in range(256)]
MERGED = ["ga", "te", "gate", "\u2581gate", "\u043d\u0430", "we", "st", "west", "\u2581west"]
"""Pieces in the order in which they were found."""
SINGLE = [*"\u2581gatewsnorh.", "\u00e9", "\u2192", "\u043d", "\u0430"]
PLAIN, BYTE, SPARE = gguf.TokenType.NORMAL, gguf.TokenType.BYTE, gguf.TokenType.CONTROL
WORDS = [*CONTROL, *BYTES, *MERGED, *SINGLE, "<spare>"]
KINDS = [
    *[SPARE] * len(CONTROL),
    *[BYTE] * len(BYTES),
    *[PLAIN] * (len(MERGED) + len(SINGLE)),
    SPARE,
]
FIRST = len(CONTROL) + len(BYTES)
WIDTH = 32


def write_scored(path: Path) -> Path:
    """Write a vocabulary of scored pieces with an embedding that numbers its rows."""
    writer = gguf.GGUFWriter(path, "gemma3")
    writer.add_context_length(64)
    writer.add_embedding_length(WIDTH)
    writer.add_block_count(1)
    writer.add_tokenizer_model("llama")
    writer.add_tokenizer_pre("default")
    writer.add_token_list(WORDS)
    writer.add_token_scores([-float(number) for number in range(len(WORDS))])
    writer.add_token_types(KINDS)
    writer.add_bos_token_id(2)
    writer.add_eos_token_id(1)
    writer.add_add_space_prefix(False)
    rows = np.arange(len(WORDS), dtype=np.float32)[:, None].repeat(WIDTH, 1)
    writer.add_tensor("token_embd.weight", rows)
    writer.add_tensor("output_norm.weight", np.ones(WIDTH, np.float32))
    writer.write_header_to_file()
    writer.write_kv_data_to_file()
    writer.write_tensors_to_file()
    writer.close()
    return path


def words_of(path: Path) -> list[str]:
    field = gguf.GGUFReader(path).get_field("tokenizer.ggml.tokens")
    assert field is not None
    return field.contents()


def test_what_is_left_is_ascii_found_early_and_every_byte(tmp_path: Path) -> None:
    source, target = write_scored(tmp_path / "whole.gguf"), tmp_path / "cut.gguf"
    size = cut_vocabulary(source, target, FIRST + 7)
    left = words_of(target)
    assert len(left) == size
    found = [word for word in MERGED[:7] if word.replace("\u2581", " ").isascii()]
    assert left == [*CONTROL, *BYTES, *found, *SINGLE[:-2]]


def test_every_piece_keeps_its_row_and_the_special_ones_their_part(tmp_path: Path) -> None:
    source, target = write_scored(tmp_path / "whole.gguf"), tmp_path / "cut.gguf"
    cut_vocabulary(source, target, FIRST + 7)
    reader = gguf.GGUFReader(target)
    rows = next(t for t in reader.tensors if t.name == "token_embd.weight").data[:, 0]
    assert [WORDS[int(row)] for row in rows] == words_of(target)
    for name, word in (("bos", "<bos>"), ("eos", "<eos>")):
        field = reader.get_field(f"tokenizer.ggml.{name}_token_id")
        assert field is not None
        assert words_of(target)[field.contents()] == word


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> tuple[Llama, Llama]:
    """The vocabulary before and after."""
    folder = tmp_path_factory.mktemp("vocabulary")
    source, target = write_scored(folder / "whole.gguf"), folder / "cut.gguf"
    cut_vocabulary(source, target, FIRST + 7)
    whole, cut = (Llama(str(path), vocab_only=True, verbose=False) for path in (source, target))
    return whole, cut


def pieces(model: Llama, text: str) -> list[bytes]:
    tokens = model.tokenize(text.encode(), add_bos=False)
    return [model.detokenize([token]) for token in tokens]


@given(st.lists(st.sampled_from(["gate", " gate", "we", " ", ".", "\u00e9", "\u2192"])))
def test_text_in_pieces_that_are_left_is_read_as_before(
    both: tuple[Llama, Llama], words: list[str]
) -> None:
    whole, cut = (pieces(model, "".join(words)) for model in both)
    assert whole == cut


@given(st.text())
@example("\u2581")
def test_any_text_is_still_read_to_the_last_byte(both: tuple[Llama, Llama], text: str) -> None:
    """The sign that such a vocabulary writes a space with is read as a space, before and after."""
    assert b"".join(pieces(both[1], text)) == text.replace("\u2581", " ").encode()


def test_another_kind_of_vocabulary_is_refused(tmp_path: Path) -> None:
    source = tmp_path / "words.gguf"
    writer = gguf.GGUFWriter(source, "bert")
    writer.add_tokenizer_model("bert")
    writer.add_token_list(["gate"])
    writer.add_token_types([PLAIN])
    writer.write_header_to_file()
    writer.write_kv_data_to_file()
    writer.close()
    with pytest.raises(ValueError, match=r"words\.gguf: only a vocabulary of scored or merged"):
        cut_vocabulary(source, tmp_path / "cut.gguf", 300)


MERGE_WORDS = [
    *"gatew\u0120\u010a\u00e9",
    "ga",
    "te",
    "gate",
    "\u0120gate",
    "w\u00e9",
    "we",
    "<|end|>",
]
MERGE_RULES = ["g a", "t e", "ga te", "\u0120 gate", "w \u00e9", "w e"]
LATE = len(MERGE_WORDS) - 2
"""Number of the last plain piece, *we*."""


def write_merging(path: Path, *, repeated: bool) -> Path:
    """Write a vocabulary of merged pieces; with an output layer that repeats the embeddings."""
    writer = gguf.GGUFWriter(path, "qwen2")
    writer.add_tokenizer_model("gpt2")
    writer.add_token_list(MERGE_WORDS)
    plain = [gguf.TokenType.NORMAL] * (len(MERGE_WORDS) - 1)
    writer.add_token_types([*plain, gguf.TokenType.CONTROL])
    writer.add_token_merges(MERGE_RULES)
    writer.add_eos_token_id(len(MERGE_WORDS) - 1)
    rows = np.random.default_rng(0).normal(size=(len(MERGE_WORDS), WIDTH)).astype(np.float32)
    writer.add_tensor("token_embd.weight", rows)
    output = rows if repeated else rows[::-1].copy()
    packed = gguf.quantize(output, gguf.GGMLQuantizationType.Q8_0)
    writer.add_tensor("output.weight", packed, raw_dtype=gguf.GGMLQuantizationType.Q8_0)
    writer.write_header_to_file()
    writer.write_kv_data_to_file()
    writer.write_tensors_to_file()
    writer.close()
    return path


def test_merged_pieces_go_with_the_rules_that_make_them(tmp_path: Path) -> None:
    source = write_merging(tmp_path / "whole.gguf", repeated=False)
    cut_vocabulary(source, tmp_path / "cut.gguf", LATE)
    reader = gguf.GGUFReader(tmp_path / "cut.gguf")
    assert words_of(tmp_path / "cut.gguf") == [
        word for word in MERGE_WORDS if word not in {"w\u00e9", "we"}
    ]
    fields = reader.fields
    assert fields["tokenizer.ggml.merges"].contents() == MERGE_RULES[:4]
    assert fields["tokenizer.ggml.eos_token_id"].contents() == len(MERGE_WORDS) - 3


@pytest.mark.parametrize(("repeated", "left"), [(True, ["token_embd.weight"]), (False, None)])
def test_an_output_layer_that_only_repeats_the_embeddings_goes(
    tmp_path: Path, repeated: bool, left: list[str] | None
) -> None:
    source = write_merging(tmp_path / "whole.gguf", repeated=repeated)
    cut_vocabulary(source, tmp_path / "cut.gguf", len(MERGE_WORDS))
    found = {tensor.name: tensor for tensor in gguf.GGUFReader(tmp_path / "cut.gguf").tensors}
    assert sorted(found) == (left or ["output.weight", "token_embd.weight"])
    kind = found["token_embd.weight"].tensor_type
    assert (kind == gguf.GGMLQuantizationType.Q8_0) is repeated
