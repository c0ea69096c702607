"""Our decoder and bare llama.cpp with the same weights, timed step by step.

Only its own process runs this. Bare llama.cpp reads a prompt in batches of RAW_BATCH and writes the
tokens that ours has written one at a time, looking for the most likely one each time: the same
adapter, no grammar, nothing that could interrupt it. Both begin with an empty cache.
"""

import math
from collections.abc import Sequence
from time import perf_counter
from typing import Any

import llama_cpp
import numpy as np
from numpy.typing import NDArray

from pa_console.llm.backend import Request
from pa_console.llm.local.decoding import ChatPrompt, Decoder
from pa_console.llm.local.runtime import CHUNK, AdapterSwitch, Runtime
from pa_console.llm.local.threads import FreeCores, decoding_threads, physical_cores
from pa_console.llm.local.worker import SEQUENCES
from pa_console.schema.base import StrictModel
from tests.benchmarks.speed.child import LoadWeights, serve
from tests.benchmarks.speed.messages import MeasureSpeed, Speed, Written

_api: Any = llama_cpp
RAW_BATCH = 512
PLANNER = SEQUENCES["planner"]


class _CountingRuntime(Runtime):
    """Notes how many tokens were read as a prompt, and how many evaluations the answer took."""

    def __init__(self, load: LoadWeights) -> None:
        super().__init__(
            load.path,
            n_ctx=load.n_ctx,
            cores=FreeCores(physical_cores()),
            stopped=lambda: False,
            adapters={PLANNER: load.adapter} if load.adapter else None,
        )
        self.read = self.evaluations = 0

    def begin(self, sequence: int, prompt: Sequence[int]) -> tuple[NDArray[np.float32], int]:
        self.read, self.evaluations = len(prompt), 0
        return super().begin(sequence, prompt)

    def extend(
        self, sequence: int, position: int, tokens: Sequence[int], rows: int = 1
    ) -> NDArray[np.float32]:
        self.evaluations += 1
        return super().extend(sequence, position, tokens, rows)


class _Bare:
    """The same file in a context of llama.cpp's own defaults, with the same threads."""

    def __init__(self, load: LoadWeights, n_ctx: int) -> None:
        self._model = _api.llama_model_load_from_file(
            load.path.encode(), _api.llama_model_default_params()
        )
        parameters = _api.llama_context_default_params()
        parameters.n_ctx = n_ctx
        parameters.n_batch = parameters.n_ubatch = RAW_BATCH
        parameters.n_threads = decoding_threads(physical_cores())
        parameters.n_threads_batch = physical_cores()
        self._context = _api.llama_init_from_model(self._model, parameters)
        if not self._context:
            raise ValueError(f"no memory for a second context of {n_ctx} tokens")
        adapters = {PLANNER: load.adapter} if load.adapter else {}
        self._adapters = AdapterSwitch(self._model, adapters)
        self._adapters.use(self._context, PLANNER)
        vocabulary = _api.llama_model_get_vocab(self._model)
        self._n_vocabulary: int = _api.llama_vocab_n_tokens(vocabulary)

    def write(self, prompt: Sequence[int], answer: Written) -> Speed:
        """Read `prompt`, then write the tokens of `answer`; the last one need not be evaluated."""
        _api.llama_memory_clear(_api.llama_get_memory(self._context), True)
        whole = [*prompt, *answer.read]
        began = perf_counter()
        for start in range(0, len(whole), RAW_BATCH):
            self._evaluate(whole[start : start + RAW_BATCH])
        read = perf_counter()
        for token in answer.tokens[:-1]:
            self._evaluate([token])
        return Speed(
            batch=RAW_BATCH,
            prompt_tokens=len(whole),
            prompt_s=read - began,
            answer=answer,
            answer_s=perf_counter() - read,
            evaluations=max(0, len(answer.tokens) - 1),
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
        self.runtime = _CountingRuntime(load)
        self._chat = ChatPrompt(self.runtime, load.chat)
        self._decoder = Decoder(self.runtime)
        self._bare = _Bare(load, self.runtime.n_ctx)

    def answer(self, line: bytes) -> StrictModel:
        """Return the speed of one MeasureSpeed."""
        asked = MeasureSpeed.model_validate_json(line)
        prompt = self._chat.tokens(asked.system, asked.user)
        if asked.bare is not None:
            return self._bare.write(prompt, asked.bare)
        self.runtime.begin(PLANNER, prompt[:1])
        request = Request(
            "planner", asked.system, asked.user, asked.grammar, asked.max_tokens, math.inf
        )
        _, usage = self._decoder.answer(PLANNER, prompt, request, lambda _text: None)
        written, read = self._decoder.written, self.runtime.read - len(prompt)
        return Speed(
            batch=CHUNK,
            prompt_tokens=self.runtime.read - usage.cached_tokens,
            prompt_s=usage.first_token_s,
            answer=Written(read=written[:read], tokens=written[read:]),
            answer_s=usage.seconds - usage.first_token_s,
            evaluations=self.runtime.evaluations,
            chosen=usage.sampled_tokens,
            guessed=usage.guessed_tokens,
        )


def _load(load: LoadWeights) -> tuple[int, Any]:
    both = _Both(load)
    return both.runtime.n_ctx, both.answer


if __name__ == "__main__":
    serve(_load)
