"""A random decoder of a few thousand weights, written as a GGUF file that llama.cpp can load."""

from collections.abc import Iterator
from pathlib import Path

import gguf
import numpy as np

ARCHITECTURES = ("llama", "qwen2", "gemma3")
"""Those that are trained."""

GLOBAL_EVERY = 6
"""Of Gemma 3: one layer of so many looks back all the way."""

WIDTH, HIDDEN, HEADS, KV_HEADS, LAYERS = 32, 64, 4, 2, 2
HEAD_WIDTH, WINDOW = 16, 16
"""Of Gemma 3."""
CONTROL = ("<|endoftext|>", "<|im_start|>", "<|im_end|>")
CHATML = (
    "{% for message in messages %}<|im_start|>{{ message.role }}\n"
    "{{ message.content }}<|im_end|>\n{% endfor %}{{ '<|im_start|>assistant\n' }}"
)


def byte_words() -> list[str]:
    """Return how byte-level vocabularies write the 256 bytes."""
    printable = [*range(33, 127), *range(161, 173), *range(174, 256)]
    words, spare = list[str](), 256
    for byte in range(256):
        words.append(chr(byte) if byte in printable else chr(spare))
        spare += byte not in printable
    return words


WORDS = [*CONTROL, *byte_words()]


def write_tiny(path: Path, architecture: str = "llama", seed: int = 0) -> Path:
    """Write a model of `architecture` to `path`."""
    gemma = architecture == "gemma3"
    writer = gguf.GGUFWriter(path, architecture)
    writer.add_context_length(512)
    writer.add_embedding_length(WIDTH)
    writer.add_block_count(GLOBAL_EVERY if gemma else LAYERS)
    writer.add_feed_forward_length(HIDDEN)
    writer.add_head_count(HEADS)
    writer.add_head_count_kv(KV_HEADS)
    writer.add_layer_norm_rms_eps(1e-5)
    writer.add_rope_freq_base(1000000.0 if gemma else 10000.0)
    if gemma:
        writer.add_key_length(HEAD_WIDTH)
        writer.add_value_length(HEAD_WIDTH)
        writer.add_sliding_window(WINDOW)
    else:
        writer.add_rope_dimension_count(WIDTH // HEADS)
    _add_vocabulary(writer)
    random = np.random.default_rng(seed)
    for name, shape, around in tensors(architecture):
        values = random.normal(around, 1.0 if len(shape) == 1 else shape[-1] ** -0.5, shape)
        writer.add_tensor(name, values.astype(np.float32))
    writer.write_header_to_file()
    writer.write_kv_data_to_file()
    writer.write_tensors_to_file()
    writer.close()
    return path


def tensors(architecture: str) -> Iterator[tuple[str, tuple[int, ...], float]]:
    """Yield name, shape and mean of every tensor of a model of `architecture`.

    Qwen2 has biases; Gemma 3 has more norms, heads of a width of their own, and layers that look
    back no further than a window.
    """
    gemma = architecture == "gemma3"
    head_width = HEAD_WIDTH if gemma else WIDTH // HEADS
    q_width, kv_width = head_width * HEADS, head_width * KV_HEADS
    yield "token_embd.weight", (len(WORDS), WIDTH), 0.0
    yield "output_norm.weight", (WIDTH,), 3.0
    for layer in (f"blk.{number}" for number in range(GLOBAL_EVERY if gemma else LAYERS)):
        yield f"{layer}.attn_norm.weight", (WIDTH,), 1.0
        yield f"{layer}.ffn_norm.weight", (WIDTH,), 1.0
        for part, width in (("q", q_width), ("k", kv_width), ("v", kv_width)):
            yield f"{layer}.attn_{part}.weight", (width, WIDTH), 0.0
            if architecture == "qwen2":
                yield f"{layer}.attn_{part}.bias", (width,), 0.0
        if gemma:
            for part in ("attn_q", "attn_k"):
                yield f"{layer}.{part}_norm.weight", (head_width,), 1.0
            for part in ("attention", "ffw"):
                yield f"{layer}.post_{part}_norm.weight", (WIDTH,), 1.0
        yield f"{layer}.attn_output.weight", (WIDTH, q_width), 0.0
        yield f"{layer}.ffn_gate.weight", (HIDDEN, WIDTH), 0.0
        yield f"{layer}.ffn_up.weight", (HIDDEN, WIDTH), 0.0
        yield f"{layer}.ffn_down.weight", (WIDTH, HIDDEN), 0.0


def _add_vocabulary(writer: gguf.GGUFWriter) -> None:
    writer.add_vocab_size(len(WORDS))
    writer.add_tokenizer_model("gpt2")
    writer.add_tokenizer_pre("smollm")
    writer.add_token_list(WORDS)
    writer.add_token_types([3] * len(CONTROL) + [1] * 256)
    writer.add_token_merges(["a b"])
    writer.add_bos_token_id(1)
    writer.add_eos_token_id(2)
    writer.add_add_bos_token(False)
    writer.add_chat_template(CHATML)
