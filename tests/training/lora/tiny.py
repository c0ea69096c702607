"""A random decoder of a few thousand weights, written as a GGUF file that llama.cpp can load."""

from pathlib import Path

import gguf
import numpy as np

WIDTH, HIDDEN, HEADS, KV_HEADS, LAYERS = 32, 64, 4, 2, 2
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


def write_tiny(path: Path, architecture: str = "llama", seed: int = 0) -> Path:
    """Write a model of `architecture` (llama or qwen2, which has biases) to `path`."""
    random = np.random.default_rng(seed)
    words = [*CONTROL, *byte_words()]
    writer = gguf.GGUFWriter(path, architecture)
    writer.add_context_length(512)
    writer.add_embedding_length(WIDTH)
    writer.add_block_count(LAYERS)
    writer.add_feed_forward_length(HIDDEN)
    writer.add_head_count(HEADS)
    writer.add_head_count_kv(KV_HEADS)
    writer.add_layer_norm_rms_eps(1e-5)
    writer.add_rope_freq_base(10000.0)
    writer.add_rope_dimension_count(WIDTH // HEADS)
    writer.add_vocab_size(len(words))
    writer.add_tokenizer_model("gpt2")
    writer.add_tokenizer_pre("smollm")
    writer.add_token_list(words)
    writer.add_token_types([3] * len(CONTROL) + [1] * 256)
    writer.add_token_merges(["a b"])
    writer.add_bos_token_id(1)
    writer.add_eos_token_id(2)
    writer.add_add_bos_token(False)
    writer.add_chat_template(CHATML)

    def add(name: str, *shape: int, around: float = 0.0) -> None:
        values = random.normal(around, 1.0 if len(shape) == 1 else shape[-1] ** -0.5, shape)
        writer.add_tensor(name, values.astype(np.float32))

    kv_width = WIDTH // HEADS * KV_HEADS
    add("token_embd.weight", len(words), WIDTH)
    add("output_norm.weight", WIDTH, around=3.0)
    for layer in (f"blk.{number}" for number in range(LAYERS)):
        add(f"{layer}.attn_norm.weight", WIDTH, around=1.0)
        add(f"{layer}.ffn_norm.weight", WIDTH, around=1.0)
        for part, width in (("q", WIDTH), ("k", kv_width), ("v", kv_width)):
            add(f"{layer}.attn_{part}.weight", width, WIDTH)
            if architecture == "qwen2":
                add(f"{layer}.attn_{part}.bias", width)
        add(f"{layer}.attn_output.weight", WIDTH, WIDTH)
        add(f"{layer}.ffn_gate.weight", HIDDEN, WIDTH)
        add(f"{layer}.ffn_up.weight", HIDDEN, WIDTH)
        add(f"{layer}.ffn_down.weight", WIDTH, HIDDEN)
    writer.write_header_to_file()
    writer.write_kv_data_to_file()
    writer.write_tensors_to_file()
    writer.close()
    return path
