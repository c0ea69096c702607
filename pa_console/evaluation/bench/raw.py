"""Our decoder and bare llama.cpp with the same weights, timed step by step.

Only its own process runs this. Bare llama.cpp reads a prompt in batches of RAW_BATCH and writes one
token at a time, the most likely one, with no grammar and nothing that could interrupt it: that is
the limit. Both begin with an empty cache.
"""

from collections.abc import Sequence
from time import perf_counter
from typing import Any

import llama_cpp
import numpy as np
from numpy.typing import NDArray

from pa_console.evaluation.bench.child import LoadWeights, serve
from pa_console.evaluation.bench.raw_messages import MeasureSpeed, Speed
from pa_console.llm.chat import ChatPrompt
from pa_console.llm.decoding import Decoder
from pa_console.llm.runtime import CHUNK, Runtime
from pa_console.llm.threads import decoding_threads
from pa_console.llm.worker import SEQUENCES
from pa_console.schema.base import StrictModel

_api: Any = llama_cpp
RAW_BATCH = 512


class _TimedRuntime(Runtime):
    """Notes when each evaluation ended; a step is from one end to the next."""

    def __init__(self, load: LoadWeights) -> None:
        super().__init__(
            load.path,
            n_ctx=load.n_ctx,
            threads=load.threads,
            stopped=lambda: False,
        )
        self.ended = 0.0
        self.steps: list[tuple[int, float]] = []

    def begin(self, sequence: int, prompt: Sequence[int]) -> tuple[NDArray[np.float32], int]:
        found = super().begin(sequence, prompt)
        self.steps, self.ended = [], perf_counter()
        return found

    def extend(
        self, sequence: int, position: int, tokens: Sequence[int], rows: int = 1
    ) -> NDArray[np.float32]:
        found = super().extend(sequence, position, tokens, rows)
        now = perf_counter()
        self.steps.append((len(tokens), now - self.ended))
        self.ended = now
        return found


class _Bare:
    """The same file in a context of llama.cpp's own defaults, with the same threads."""

    def __init__(self, load: LoadWeights, n_ctx: int) -> None:
        self._model = _api.llama_model_load_from_file(
            load.path.encode(), _api.llama_model_default_params()
        )
        parameters = _api.llama_context_default_params()
        parameters.n_ctx = n_ctx
        parameters.n_batch = parameters.n_ubatch = RAW_BATCH
        parameters.n_threads = decoding_threads(load.threads)
        parameters.n_threads_batch = load.threads
        self._context = _api.llama_init_from_model(self._model, parameters)
        if not self._context:
            raise ValueError(f"no memory for a second context of {n_ctx} tokens")
        vocabulary = _api.llama_model_get_vocab(self._model)
        self._n_vocabulary: int = _api.llama_vocab_n_tokens(vocabulary)

    def write(self, prompt: Sequence[int], count: int) -> Speed:
        """Read `prompt`, then write `count` tokens."""
        _api.llama_memory_clear(_api.llama_get_memory(self._context), True)
        began, token = perf_counter(), 0
        for start in range(0, len(prompt), RAW_BATCH):
            token = self._evaluate(prompt[start : start + RAW_BATCH])
        ended = perf_counter()
        prompt_s, steps = ended - began, list[tuple[int, float]]()
        for _ in range(count):
            token = self._evaluate([token])
            now = perf_counter()
            steps.append((1, now - ended))
            ended = now
        return Speed(
            batch=RAW_BATCH, prompt_tokens=len(prompt), prompt_s=prompt_s, steps=tuple(steps)
        )

    def _evaluate(self, tokens: Sequence[int]) -> int:
        """Evaluate `tokens` after those before them; return the most likely next one."""
        array = (_api.llama_token * len(tokens))(*tokens)
        if _api.llama_decode(self._context, _api.llama_batch_get_one(array, len(tokens))) != 0:
            raise RuntimeError(f"llama.cpp could not evaluate {len(tokens)} tokens")
        row = _api.llama_get_logits_ith(self._context, -1)
        return int(np.argmax(np.ctypeslib.as_array(row, shape=(self._n_vocabulary,))))


class _Both:
    """The two ways, each with a context of its own."""

    def __init__(self, load: LoadWeights) -> None:
        self.runtime = _TimedRuntime(load)
        self._chat = ChatPrompt(self.runtime, load.chat)
        self._decoder = Decoder(self.runtime)
        self._bare = _Bare(load, self.runtime.n_ctx)

    def answer(self, line: bytes) -> StrictModel:
        """Return the speed of one MeasureSpeed."""
        asked = MeasureSpeed.model_validate_json(line)
        prompt = self._chat.tokens(asked.system, asked.user)
        if asked.bare_tokens is not None:
            return self._bare.write(prompt, asked.bare_tokens)
        sequence = SEQUENCES["planner"]
        self.runtime.begin(sequence, prompt[:1])
        _, usage = self._decoder.answer(
            sequence, prompt, asked.grammar, asked.max_tokens, lambda _text: None
        )
        return Speed(
            batch=CHUNK,
            prompt_tokens=usage.prompt_tokens - usage.cached_tokens,
            prompt_s=usage.first_token_s,
            steps=tuple(self.runtime.steps),
            written=usage.completion_tokens,
            chosen=usage.sampled_tokens,
        )


def _load(load: LoadWeights) -> tuple[int, Any]:
    both = _Both(load)
    return both.runtime.n_ctx, both.answer


if __name__ == "__main__":
    serve(_load)
