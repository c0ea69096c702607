"""Contexts for several continuations of one prompt, and the adapters that they use.

Only the worker process imports this. A switch costs about 3 ms at the next evaluation (135M
weights, two cores).
"""

import ctypes
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import llama_cpp
import numpy as np
from numpy.typing import NDArray

from pa_console.llm.worker.threads import FreeCores

_api: Any = llama_cpp


class AdapterSwitch:
    """The adapters of a loaded `model` by the sequence that is evaluated with each."""

    def __init__(self, model: Any, paths: Mapping[int, str]) -> None:
        """Load the files in `paths`; raises ValueError when one does not fit the model."""
        loaded = {path: _load(model, path) for path in dict.fromkeys(paths.values())}
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


def _load(model: Any, path: str) -> Any:
    adapter = _api.llama_adapter_lora_init(model, path.encode())
    if not adapter:
        raise ValueError(
            f"{path}: not an adapter for this model that this version of llama.cpp can load"
        )
    return adapter


CHUNK = 16
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
        parameters.n_batch = parameters.n_ubatch = CHUNK
        parameters.n_seq_max = width
        parameters.kv_unified = True
        parameters.swa_full = True
        parameters.flash_attn_type = WHOLE_ATTENTION
        parameters.abort_callback = self._abort
        self.context = _api.llama_init_from_model(model, parameters)
        if not self.context:
            raise ValueError(f"no memory for a context of {n_ctx} tokens")
        self._memory = _api.llama_get_memory(self.context)
        self._batch = _api.llama_batch_init(CHUNK, 0, 1)

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
        for start in range(0, len(flat), CHUNK):
            chunk = flat[start : start + CHUNK]
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
