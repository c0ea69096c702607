"""A loaded GGUF model with a context for every role; evaluation can be interrupted.

Only the worker process imports this module. It uses llama.cpp's C API, because the high-level
Python class has a single sequence, cannot be interrupted, and does not give access to the logits
(the option `logits_all` was measured to need gigabytes).
"""

import ctypes
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import llama_cpp
import numpy as np
from numpy.typing import NDArray

from pa_console.llm.local.threads import FreeCores

_api: Any = llama_cpp

CHUNK, SHARED_CHUNK = 64, 16
"""The number of tokens evaluated at once, of a prompt or of several continuations of a prompt."""
GROUP = 16
"""The number of tokens in a group. The cache is reused in whole groups; a chunk has several groups.

llama.cpp computes a single token in a different order than several tokens, and may compute groups
of 16 tokens in a different order than the remaining tokens. Every batch begins at the start of a
group, and no batch has a single token. Therefore, each token is evaluated exactly as in a new
context, and an answer never depends on earlier prompts.
"""

ROOM = 256
"""The number of tokens of which every context size is a multiple. llama.cpp attends to this many
tokens at once, so the size of a context does not affect its answers."""

LEAST_ROOM = 2 * ROOM
"""The context size that suffices for the prompt and answer of most missions."""

WHOLE_ATTENTION = llama_cpp.LLAMA_FLASH_ATTN_TYPE_DISABLED
"""The setting that disables flash attention.

Flash attention splits long contexts among threads. Therefore, the logits of a single token depend
on the number of threads, with differences of 0.2 and more. Without flash attention, the logits are
identical, and evaluation is not slower (with 135M weights on two cores: 23 ms per single token in
both cases, and 0.32 s instead of 0.41 s for 64 tokens in batches).
"""

ABORTED = 2
"""The result of llama_decode if the abort callback stopped it."""

_give_back: Any = (
    getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
)
"""The function that returns unused memory of the heap to the system; only glibc has it."""

State = ctypes.Array[ctypes.c_uint8]
"""The state of a sequence in a context. It is never copied, because it has megabytes."""

Piece = tuple[int, int, Sequence[int]]
"""A continuation's number, the position of its first new token, and the new tokens."""

Placed = tuple[int, int, int, bool]
"""A token to evaluate: its sequence, its position, the token, and whether its logits are needed."""


class AdapterSwitch:
    """The adapters of a loaded `model`, by the sequences that use them."""

    def __init__(self, model: Any, paths: Mapping[int, str]) -> None:
        """Load the files in `paths`; raises ValueError if one does not fit the model."""
        loaded = {path: _load_adapter(model, path) for path in dict.fromkeys(paths.values())}
        self._adapters = {sequence: loaded[path] for sequence, path in paths.items()}
        self._active: dict[int, Any] = {}

    def use(self, context: Any, sequence: int) -> None:
        """Select the adapter of `sequence` for `context`; without one, no adapter is used."""
        adapter = self._adapters.get(sequence)
        if self._active.get(context) == adapter:
            return
        count = 0 if adapter is None else 1
        adapters = (_api.llama_adapter_lora_p_ctypes * 1)(adapter)
        scales = (ctypes.c_float * 1)(1.0)
        if _api.llama_set_adapters_lora(context, adapters, count, scales) != 0:
            raise ValueError("llama.cpp could not switch to the adapter of another role")
        self._active[context] = adapter

    def forget(self, context: Any) -> None:
        """Forget a context that is freed, because a later context may have the same address."""
        self._active.pop(context, None)


def _load_adapter(model: Any, path: str) -> Any:
    adapter = _api.llama_adapter_lora_init(model, path.encode())
    if not adapter:
        raise ValueError(
            f"{path}: not an adapter for this model that this version of llama.cpp can load"
        )
    return adapter


@_api.llama_log_callback
def _no_log(_level: int, _text: bytes, _data: object) -> None:
    """Discard llama.cpp's log."""


class InterruptedEvaluationError(Exception):
    """The error of an evaluation that the `stopped` callback has stopped."""


class _LlamaContext:
    """A context of `model` with `n_ctx` tokens; raises ValueError if memory is short."""

    def __init__(self, runtime: "Runtime", n_ctx: int, chunk: int, sequences: int = 1) -> None:
        self.n_ctx = n_ctx
        self._stopped, self._cores = runtime.stopped, runtime.cores
        self._n_vocabulary = runtime.n_vocabulary

        def should_abort(_data: object) -> bool:
            return self._stopped()

        self._abort = _api.ggml_abort_callback(should_abort)
        parameters = _api.llama_context_default_params()
        parameters.n_ctx = n_ctx
        parameters.n_batch = parameters.n_ubatch = chunk
        parameters.n_seq_max = sequences
        parameters.kv_unified = sequences > 1
        parameters.swa_full = True
        parameters.flash_attn_type = WHOLE_ATTENTION
        parameters.abort_callback = self._abort
        self.handle = _api.llama_init_from_model(runtime.model, parameters)
        if not self.handle:
            raise ValueError(f"no memory for a context of {n_ctx} tokens")
        self.memory = _api.llama_get_memory(self.handle)
        self._batch = _api.llama_batch_init(chunk, 0, 1)

    def free(self) -> None:
        """Free the memory; the context must not be used afterwards."""
        _api.llama_batch_free(self._batch)
        _api.llama_free(self.handle)
        if _give_back is not None:
            _give_back(0)

    def evaluate(self, tokens: Sequence[Placed]) -> None:
        """Evaluate one batch; raises InterruptedEvaluationError, or RuntimeError on failure."""
        batch = self._batch
        batch.n_tokens = len(tokens)
        for index, (sequence, position, token, with_logits) in enumerate(tokens):
            batch.token[index] = token
            batch.pos[index] = position
            batch.n_seq_id[index] = 1
            batch.seq_id[index][0] = sequence
            batch.logits[index] = with_logits
        if self._stopped():
            raise InterruptedEvaluationError
        with self._cores.evaluating(len(tokens)) as threads:
            _api.llama_set_n_threads(self.handle, threads, threads)
            code = _api.llama_decode(self.handle, batch)
        if code == ABORTED:
            raise InterruptedEvaluationError
        if code != 0:
            raise RuntimeError(f"llama.cpp could not evaluate {len(tokens)} tokens (code {code})")

    def logits(self, index: int = -1) -> NDArray[np.float32]:
        """Return the logits after a token of the last batch; the next batch overwrites them."""
        row = _api.llama_get_logits_ith(self.handle, index)
        return np.ctypeslib.as_array(row, shape=(self._n_vocabulary,))

    def state(self) -> State:
        """Return the evaluated state of the first sequence."""
        size = _api.llama_state_seq_get_size(self.handle, 0)
        buffer = (ctypes.c_uint8 * size)()
        _api.llama_state_seq_get_data(self.handle, buffer, size, 0)
        return buffer

    def restore(self, state: State, problem: str) -> None:
        """Restore `state` in the first sequence; raises ValueError with `problem` on failure."""
        if not _api.llama_state_seq_set_data(self.handle, state, len(state), 0):
            raise ValueError(problem)


def _rounded(tokens: int) -> int:
    """Return the context size for `tokens`."""
    return -(-tokens // ROOM) * ROOM


class SharedContext:
    """A context for a prompt and `width` answers, with `tokens` in total."""

    def __init__(self, runtime: "Runtime", width: int, tokens: int) -> None:
        """Create the context; raises ValueError if memory is short."""
        self._adapters = runtime.adapters
        self._context = _LlamaContext(runtime, _rounded(tokens), SHARED_CHUNK, width)

    def close(self) -> None:
        """Free the memory; the context must not be used afterwards."""
        self._adapters.forget(self._context.handle)
        self._context.free()

    def adopt(self, state: State, lengths: Sequence[int], sequence: int) -> None:
        """Copy the first tokens of `state`, which `sequence` has evaluated, to each continuation.

        `lengths` has the number of tokens that each continuation keeps.
        """
        memory = self._context.memory
        self._adapters.use(self._context.handle, sequence)
        _api.llama_memory_clear(memory, False)
        self._context.restore(state, "the prompt does not fit into the context for several answers")
        for number in range(1, len(lengths)):
            _api.llama_memory_seq_cp(memory, 0, number, -1, -1)
        for number, length in enumerate(lengths):
            _api.llama_memory_seq_rm(memory, number, length, -1)

    def extend(self, pieces: Sequence[Piece]) -> list[NDArray[np.float32]]:
        """Evaluate the new tokens of every piece; return the logits after each piece's last token.

        Raises InterruptedEvaluationError if the evaluation is stopped.
        """
        flat = [
            (number, position + offset, token, offset == len(tokens) - 1)
            for number, position, tokens in pieces
            for offset, token in enumerate(tokens)
        ]
        rows: dict[int, NDArray[np.float32]] = {}
        for start in range(0, len(flat), SHARED_CHUNK):
            chunk = flat[start : start + SHARED_CHUNK]
            self._context.evaluate(chunk)
            for index, (number, _, _, last) in enumerate(chunk):
                if last:
                    rows[number] = self._context.logits(index).copy()
        return [rows[number] for number, _, _ in pieces]


def prompt_chunks(tokens: Sequence[int]) -> Iterator[Sequence[int]]:
    """Yield `tokens` in chunks of more than one token, unless there is only one token."""
    start = 0
    while start < len(tokens):
        left = len(tokens) - start
        size = CHUNK - GROUP if left == CHUNK + 1 else CHUNK
        yield tokens[start : start + size]
        start += size


class Runtime:
    """One model and its sequences; each has its own context of at most `n_ctx` tokens.

    Contexts are created when they are first needed, and grow. Because each sequence has its own
    context, prompts of other sequences never affect an answer, and a change of role does not switch
    adapters, which would take 3 ms. `stopped` is called between operations of the compute graph,
    about every millisecond.
    """

    def __init__(
        self,
        path: str,
        *,
        n_ctx: int,
        cores: FreeCores,
        stopped: Callable[[], bool],
        adapters: Mapping[int, str] | None = None,
        mapped: bool = True,
    ) -> None:
        """Load the file at `path`; raises ValueError if llama.cpp cannot load it.

        `cores` supplies the number of threads; `adapters` has the path of each sequence's adapter,
        if any. If `mapped`, the file is shared with other processes that load it.
        """
        _api.llama_log_set(_no_log, None)
        _api.llama_backend_init()
        model_parameters = _api.llama_model_default_params()
        model_parameters.load_mode = (
            _api.LLAMA_LOAD_MODE_MMAP if mapped else _api.LLAMA_LOAD_MODE_NONE
        )
        self.model = _api.llama_model_load_from_file(path.encode(), model_parameters)
        if not self.model:
            raise ValueError(f"{path}: not a GGUF model that this version of llama.cpp can load")
        self.adapters = AdapterSwitch(self.model, adapters or {})
        self.n_ctx = min(n_ctx, _api.llama_model_n_ctx_train(self.model))
        self.stopped, self.cores = stopped, cores
        self.vocabulary = _api.llama_model_get_vocab(self.model)
        self.n_vocabulary: int = _api.llama_vocab_n_tokens(self.vocabulary)
        self._contexts: dict[int, _LlamaContext] = {}
        self._cached: dict[int, list[int]] = {}
        self._make_room(0, LEAST_ROOM)

    @property
    def description(self) -> str:
        """llama.cpp's description of the model."""
        buffer = ctypes.create_string_buffer(256)
        _api.llama_model_desc(self.model, buffer, len(buffer))
        return buffer.value.decode("utf-8", "replace")

    def metadata(self, key: str) -> str | None:
        """Return a GGUF metadata value as text, or None if the file has no such key."""
        size = _api.llama_model_meta_val_str(self.model, key.encode(), None, 0)
        if size < 0:
            return None
        buffer = ctypes.create_string_buffer(size + 1)
        _api.llama_model_meta_val_str(self.model, key.encode(), buffer, len(buffer))
        return buffer.value.decode("utf-8", "replace")

    def token_text(self, token: int) -> str:
        """Return the text of `token` in the vocabulary, or '' if there is no such token."""
        if token < 0:
            return ""
        return _api.llama_vocab_get_text(self.vocabulary, token).decode("utf-8", "replace")

    @property
    def end_tokens(self) -> list[int]:
        """Every token that ends a generation."""
        tokens = range(self.n_vocabulary)
        return [token for token in tokens if _api.llama_vocab_is_eog(self.vocabulary, token)]

    @property
    def start_token(self) -> int:
        """The token at the beginning of a text."""
        return _api.llama_vocab_bos(self.vocabulary)

    @property
    def end_token(self) -> int:
        """The token at the end of a text."""
        return _api.llama_vocab_eos(self.vocabulary)

    @property
    def wants_start_token(self) -> bool:
        """True if the model was trained with `start_token` before every text."""
        return bool(_api.llama_vocab_get_add_bos(self.vocabulary))

    def tokenise(self, text: str, *, special: bool) -> list[int]:
        """Return the tokens of `text`; control tokens are recognized only if `special` is True."""
        data = text.encode("utf-8")
        size = len(data) + 8
        tokens = (_api.llama_token * size)()
        count = _api.llama_tokenize(self.vocabulary, data, len(data), tokens, size, False, special)
        if count < 0:
            raise ValueError("the text could not be tokenised")
        return list(tokens[:count])

    def begin(self, sequence: int, prompt: Sequence[int]) -> tuple[NDArray[np.float32], int]:
        """Evaluate `prompt` from the start of `sequence`.

        Returns the logits after its last token, shape (n_vocabulary,), and the number of tokens
        that were already in the cache. Raises InterruptedEvaluationError if it is stopped.
        """
        self._make_room(sequence, len(prompt))
        cached = self._cached.get(sequence, [])
        common = 0
        for old, new in zip(cached, prompt[:-1], strict=False):
            if old != new:
                break
            common += 1
        kept = common // GROUP * GROUP
        if kept == len(prompt) - 1:
            kept -= min(kept, GROUP)
        memory = self._contexts[sequence].memory
        if not _api.llama_memory_seq_rm(memory, 0, kept, -1):
            _api.llama_memory_clear(memory, False)
            kept = 0
        self._cached[sequence] = list(prompt[:kept])
        for chunk in prompt_chunks(prompt[kept:]):
            self._decode(sequence, len(self._cached[sequence]), chunk)
            self._cached[sequence].extend(chunk)
        return self._contexts[sequence].logits(), kept

    def extend(
        self, sequence: int, position: int, tokens: Sequence[int], rows: int = 1
    ) -> NDArray[np.float32]:
        """Evaluate `tokens` of an answer at `position`.

        Returns the logits after the last `rows` tokens, shape (rows, n_vocabulary).
        """
        self._make_room(sequence, position + len(tokens))
        early = max(0, len(tokens) - max(CHUNK, rows))
        for start in range(0, early, CHUNK):
            self._decode(sequence, position + start, tokens[start : min(start + CHUNK, early)], 0)
        self._decode(sequence, position + early, tokens[early:], rows)
        return np.stack([self._contexts[sequence].logits(row - rows) for row in range(rows)])

    def keep(self, sequence: int, tokens: int, trim: bool) -> None:
        """If `trim`, drop all evaluated tokens of `sequence` after the first `tokens`."""
        if trim:
            _api.llama_memory_seq_rm(self._contexts[sequence].memory, 0, tokens, -1)

    def state(self, sequence: int) -> State:
        """Return the evaluated state of `sequence`, for another context."""
        return self._contexts[sequence].state()

    def _make_room(self, sequence: int, tokens: int) -> None:
        """Make the context of `sequence` large enough for `tokens`; evaluated tokens are kept."""
        room = min(max(_rounded(tokens), LEAST_ROOM), self.n_ctx)
        old = self._contexts.get(sequence)
        if old is not None and room <= old.n_ctx:
            return
        context = _LlamaContext(self, room, CHUNK)
        self.adapters.use(context.handle, sequence)
        if old is not None:
            context.restore(old.state(), "the evaluated tokens do not fit into a larger context")
            self.adapters.forget(old.handle)
            old.free()
        self._contexts[sequence] = context

    def _decode(self, sequence: int, position: int, tokens: Sequence[int], rows: int = 1) -> None:
        first = len(tokens) - rows
        self._contexts[sequence].evaluate(
            [(0, position + index, token, index >= first) for index, token in enumerate(tokens)]
        )
