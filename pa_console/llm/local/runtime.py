"""A loaded GGUF model with a context for every role, evaluated in batches that can be interrupted.

Only the worker process imports this. llama.cpp is used through its C API: the high-level class
keeps one sequence, cannot be interrupted, and hides the logits (measured: `logits_all` needs GBs).
"""

import ctypes
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import llama_cpp
import numpy as np
from numpy.typing import NDArray

from pa_console.llm.local.threads import FreeCores

_api: Any = llama_cpp


class AdapterSwitch:
    """The adapters of a loaded `model` by the sequence that is evaluated with each."""

    def __init__(self, model: Any, paths: Mapping[int, str]) -> None:
        """Load the files in `paths`; raises ValueError when one does not fit the model."""
        loaded = {path: _load_adapter(model, path) for path in dict.fromkeys(paths.values())}
        self._adapters = {sequence: loaded[path] for sequence, path in paths.items()}
        self._active: dict[int, Any] = {}

    def use(self, context: Any, sequence: int) -> None:
        """Let `context` evaluate with the adapter of `sequence`, or with none if it has none."""
        wanted = self._adapters.get(sequence)
        if self._active.get(context) == wanted:
            return
        count = 0 if wanted is None else 1
        adapters = (_api.llama_adapter_lora_p_ctypes * 1)(wanted)
        scales = (ctypes.c_float * 1)(1.0)
        if _api.llama_set_adapters_lora(context, adapters, count, scales) != 0:
            raise ValueError("llama.cpp could not switch to the adapter of another role")
        self._active[context] = wanted

    def forget(self, context: Any) -> None:
        """Forget a context that is freed: the next one may stand at the same address."""
        self._active.pop(context, None)


def _load_adapter(model: Any, path: str) -> Any:
    adapter = _api.llama_adapter_lora_init(model, path.encode())
    if not adapter:
        raise ValueError(
            f"{path}: not an adapter for this model that this version of llama.cpp can load"
        )
    return adapter


SHARED_CHUNK = 16
"""Tokens of all continuations together that are evaluated at once."""

WHOLE_ATTENTION = llama_cpp.LLAMA_FLASH_ATTN_TYPE_DISABLED
"""Flash attention splits long contexts among the threads, so that the logits of a single token
depend on how many there are, by 0.2 and more. Without it they do not, bit for bit, and it is no
slower here (135M weights, two cores: 23 ms a token, 0.32 s instead of 0.41 s for 64 in batches)."""

ABORTED = 2
"""The result of llama_decode after the abort callback stopped it."""


State = ctypes.Array[ctypes.c_uint8]
"""The state of a sequence in a context; it is megabytes, and never copied."""

Piece = tuple[int, int, Sequence[int]]
"""Number of the continuation, position of its first new token, the new tokens."""


class InterruptedEvaluationError(Exception):
    """The evaluation was stopped by the `stopped` callback."""


class SharedContext:
    """One more context of a loaded `model`, with room for a prompt and `width` short answers."""

    def __init__(  # noqa: PLR0917
        self,
        model: Any,
        n_ctx: int,
        width: int,
        n_vocabulary: int,
        cores: FreeCores,
        stopped: Callable[[], bool],
        adapters: AdapterSwitch,
    ) -> None:
        """Raises ValueError when there is no memory for `n_ctx` tokens."""
        self.width = width
        self._stopped, self._n_vocabulary = stopped, n_vocabulary
        self._cores = cores
        self._adapters = adapters
        self._abort = _api.ggml_abort_callback(self._should_abort)
        parameters = _api.llama_context_default_params()
        parameters.n_ctx = n_ctx
        parameters.n_batch = parameters.n_ubatch = SHARED_CHUNK
        parameters.n_seq_max = width
        parameters.kv_unified = True
        parameters.swa_full = True
        parameters.flash_attn_type = WHOLE_ATTENTION
        parameters.abort_callback = self._abort
        self.context = _api.llama_init_from_model(model, parameters)
        if not self.context:
            raise ValueError(f"no memory for a context of {n_ctx} tokens")
        self._memory = _api.llama_get_memory(self.context)
        self._batch = _api.llama_batch_init(SHARED_CHUNK, 0, 1)

    def close(self) -> None:
        """Give the memory back; the context must not be used afterwards."""
        _api.llama_batch_free(self._batch)
        self._adapters.forget(self.context)
        _api.llama_free(self.context)

    def adopt(self, state: State, lengths: Sequence[int], sequence: int) -> None:
        """Begin continuations of what `sequence` evaluated, `state`: each of its first tokens.

        `lengths` says of how many, continuation by continuation.
        """
        self._adapters.use(self.context, sequence)
        _api.llama_memory_clear(self._memory, False)
        if not _api.llama_state_seq_set_data(self.context, state, len(state), 0):
            raise ValueError("the prompt does not fit into the context for several answers")
        for number in range(1, len(lengths)):
            _api.llama_memory_seq_cp(self._memory, 0, number, -1, -1)
        for number, length in enumerate(lengths):
            _api.llama_memory_seq_rm(self._memory, number, length, -1)

    def extend(self, pieces: Sequence[Piece]) -> list[NDArray[np.float32]]:
        """Evaluate the new tokens of every piece; return the logits after each one's last token.

        Raises InterruptedEvaluationError.
        """
        flat = [
            (number, position + offset, token, offset == len(tokens) - 1)
            for number, position, tokens in pieces
            for offset, token in enumerate(tokens)
        ]
        rows: dict[int, NDArray[np.float32]] = {}
        for start in range(0, len(flat), SHARED_CHUNK):
            chunk = flat[start : start + SHARED_CHUNK]
            self._decode(chunk)
            for index, (number, _, _, last) in enumerate(chunk):
                if last:
                    rows[number] = self._logits(index)
        return [rows[number] for number, _, _ in pieces]

    def _should_abort(self, _data: object) -> bool:
        return self._stopped()

    def _decode(self, chunk: Sequence[tuple[int, int, int, bool]]) -> None:
        batch = self._batch
        batch.n_tokens = len(chunk)
        for index, (number, position, token, last) in enumerate(chunk):
            batch.token[index] = token
            batch.pos[index] = position
            batch.n_seq_id[index] = 1
            batch.seq_id[index][0] = number
            batch.logits[index] = last
        if self._stopped():
            raise InterruptedEvaluationError
        with self._cores.evaluating(len(chunk)) as threads:
            _api.llama_set_n_threads(self.context, threads, threads)
            code = _api.llama_decode(self.context, batch)
        if code == ABORTED:
            raise InterruptedEvaluationError
        if code != 0:
            raise ValueError(f"llama.cpp could not evaluate {len(chunk)} tokens (code {code})")

    def _logits(self, index: int) -> NDArray[np.float32]:
        row = _api.llama_get_logits_ith(self.context, index)
        return np.ctypeslib.as_array(row, shape=(self._n_vocabulary,)).copy()


CHUNK = 64
"""Prompt tokens evaluated at once. The cache is reused in whole chunks, so that every batch has
the same shape as in a fresh context and an answer never depends on what was asked before."""


@_api.llama_log_callback
def _no_log(_level: int, _text: bytes, _data: object) -> None:
    """Swallow llama.cpp's own log."""


ROOM = 512
"""The context of a sequence is a multiple of this number of tokens, as it fills memory."""


class Runtime:
    """One model and its sequences: each has a context of its own for at most `n_ctx` tokens.

    Contexts are made when they are first needed, and grow. What another sequence was asked never
    shows in an answer, and no adapter is switched: that would cost 3 ms at every change of role.
    `stopped` is asked between operations of the compute graph, about every millisecond.
    """

    def __init__(
        self,
        path: str,
        *,
        n_ctx: int,
        cores: FreeCores,
        stopped: Callable[[], bool],
        adapters: Mapping[int, str] | None = None,
    ) -> None:
        """Load the file at `path`; raises ValueError when llama.cpp cannot.

        `cores` says how many threads compute; `adapters` has the path of the adapter with which a
        sequence is evaluated, if any.
        """
        _api.llama_log_set(_no_log, None)
        _api.llama_backend_init()
        model_parameters = _api.llama_model_default_params()
        self._model = _api.llama_model_load_from_file(path.encode(), model_parameters)
        if not self._model:
            raise ValueError(f"{path}: not a GGUF model that this version of llama.cpp can load")
        self._adapters = AdapterSwitch(self._model, adapters or {})
        self.n_ctx = min(n_ctx, _api.llama_model_n_ctx_train(self._model))
        self._stopped, self.cores = stopped, cores
        self._abort = _api.ggml_abort_callback(self._should_abort)
        self._contexts: dict[int, Any] = {}
        self._room: dict[int, int] = {}
        self._context(0)
        self.vocabulary = _api.llama_model_get_vocab(self._model)
        self.n_vocabulary: int = _api.llama_vocab_n_tokens(self.vocabulary)
        self._batch = _api.llama_batch_init(CHUNK, 0, 1)
        self._cached: dict[int, list[int]] = {}

    @property
    def description(self) -> str:
        """llama.cpp's own words for the model."""
        buffer = ctypes.create_string_buffer(256)
        _api.llama_model_desc(self._model, buffer, len(buffer))
        return buffer.value.decode("utf-8", "replace")

    def metadata(self, key: str) -> str | None:
        """Return a GGUF metadata value as text, None when the file has no such key."""
        size = _api.llama_model_meta_val_str(self._model, key.encode(), None, 0)
        if size < 0:
            return None
        buffer = ctypes.create_string_buffer(size + 1)
        _api.llama_model_meta_val_str(self._model, key.encode(), buffer, len(buffer))
        return buffer.value.decode("utf-8", "replace")

    def token_text(self, token: int) -> str:
        """Return how the vocabulary writes `token`, empty when there is no such token."""
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
        """The token that a text begins with."""
        return _api.llama_vocab_bos(self.vocabulary)

    @property
    def end_token(self) -> int:
        """The token that a text ends with."""
        return _api.llama_vocab_eos(self.vocabulary)

    @property
    def wants_start_token(self) -> bool:
        """True if the model was trained with `start_token` before every text."""
        return bool(_api.llama_vocab_get_add_bos(self.vocabulary))

    def tokenise(self, text: str, *, special: bool) -> list[int]:
        """Return the tokens of `text`; control tokens are recognised only when `special`."""
        data = text.encode("utf-8")
        size = len(data) + 8
        tokens = (_api.llama_token * size)()
        count = _api.llama_tokenize(self.vocabulary, data, len(data), tokens, size, False, special)
        if count < 0:
            raise ValueError("the text could not be tokenised")
        return list(tokens[:count])

    def begin(self, sequence: int, prompt: Sequence[int]) -> tuple[NDArray[np.float32], int]:
        """Evaluate `prompt` from the start of `sequence`.

        Returns the logits after its last token, shape (n_vocabulary,), and how many tokens were
        found in the cache. Raises InterruptedEvaluationError.
        """
        self._make_room(sequence, len(prompt))
        cached = self._cached.get(sequence, [])
        common = 0
        for old, new in zip(cached, prompt[:-1], strict=False):
            if old != new:
                break
            common += 1
        kept = common // CHUNK * CHUNK
        memory = self._memory(sequence)
        if not _api.llama_memory_seq_rm(memory, 0, kept, -1):
            _api.llama_memory_clear(memory, False)
            kept = 0
        self._cached[sequence] = list(prompt[:kept])
        for start in range(kept, len(prompt), CHUNK):
            chunk = prompt[start : start + CHUNK]
            self._decode(sequence, start, chunk)
            self._cached[sequence].extend(chunk)
        return self._logits(sequence), kept

    def extend(
        self, sequence: int, position: int, tokens: Sequence[int], rows: int = 1
    ) -> NDArray[np.float32]:
        """Evaluate `tokens` of an answer at `position`.

        Returns the logits after the last `rows` of them, shape (rows, n_vocabulary).
        """
        self._make_room(sequence, position + len(tokens))
        early = max(0, len(tokens) - max(CHUNK, rows))
        for start in range(0, early, CHUNK):
            self._decode(sequence, position + start, tokens[start : min(start + CHUNK, early)], 0)
        self._decode(sequence, position + early, tokens[early:], rows)
        return np.stack([self._logits(sequence, row - rows) for row in range(rows)])

    def keep(self, sequence: int, tokens: int, trim: bool) -> None:
        """Forget the evaluated tokens of `sequence` after the first `tokens`."""
        if trim:
            _api.llama_memory_seq_rm(self._memory(sequence), 0, tokens, -1)

    def state(self, sequence: int) -> State:
        """Return the evaluated state of `sequence`, for another context."""
        context = self._context(sequence)
        size = _api.llama_state_seq_get_size(context, 0)
        buffer = (ctypes.c_uint8 * size)()
        _api.llama_state_seq_get_data(context, buffer, size, 0)
        return buffer

    def shared_context(self, width: int, n_ctx: int) -> SharedContext:
        """Return a context of the same model for `width` answers at once, `n_ctx` tokens in all."""
        return SharedContext(
            self._model,
            n_ctx,
            width,
            self.n_vocabulary,
            self.cores,
            self._stopped,
            self._adapters,
        )

    def _context(self, sequence: int) -> Any:
        """Return the context of `sequence`; raises ValueError when there is no memory for it."""
        if sequence not in self._contexts:
            self._make_room(sequence, ROOM)
        return self._contexts[sequence]

    def _make_room(self, sequence: int, tokens: int) -> None:
        """Let the context of `sequence` hold `tokens`; what was evaluated in it stays."""
        room = min(-(-tokens // ROOM) * ROOM, self.n_ctx)
        if room <= self._room.get(sequence, 0):
            return
        context = self._new_context(room)
        self._adapters.use(context, sequence)
        old = self._contexts.get(sequence)
        if old is not None:
            state = self.state(sequence)
            if not _api.llama_state_seq_set_data(context, state, len(state), 0):
                raise ValueError("what was evaluated does not fit into a larger context")
            self._adapters.forget(old)
            _api.llama_free(old)
        self._contexts[sequence], self._room[sequence] = context, room

    def _new_context(self, tokens: int) -> Any:
        parameters = _api.llama_context_default_params()
        parameters.n_ctx = tokens
        parameters.n_batch = parameters.n_ubatch = CHUNK
        parameters.n_seq_max = 1
        parameters.swa_full = True
        parameters.flash_attn_type = WHOLE_ATTENTION
        parameters.abort_callback = self._abort
        context = _api.llama_init_from_model(self._model, parameters)
        if not context:
            raise ValueError(f"no memory for a context of {tokens} tokens")
        return context

    def _memory(self, sequence: int) -> Any:
        return _api.llama_get_memory(self._context(sequence))

    def _should_abort(self, _data: object) -> bool:
        return self._stopped()

    def _decode(self, sequence: int, position: int, tokens: Sequence[int], rows: int = 1) -> None:
        batch = self._batch
        batch.n_tokens = len(tokens)
        for index, token in enumerate(tokens):
            batch.token[index] = token
            batch.pos[index] = position + index
            batch.n_seq_id[index] = 1
            batch.seq_id[index][0] = 0
            batch.logits[index] = index >= len(tokens) - rows
        if self._stopped():
            raise InterruptedEvaluationError
        context = self._context(sequence)
        with self.cores.evaluating(len(tokens)) as threads:
            _api.llama_set_n_threads(context, threads, threads)
            code = _api.llama_decode(context, batch)
        if code == ABORTED:
            raise InterruptedEvaluationError
        if code != 0:
            raise RuntimeError(f"llama.cpp could not evaluate {len(tokens)} tokens (code {code})")

    def _logits(self, sequence: int, index: int = -1) -> NDArray[np.float32]:
        row = _api.llama_get_logits_ith(self._context(sequence), index)
        return np.ctypeslib.as_array(row, shape=(self.n_vocabulary,))
