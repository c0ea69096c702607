"""The plain way with the same weights: llama-cpp-python's chat completion with a JSON schema.

Only its own process runs this. One model, one context, one prompt after the other; what it reuses
of the last prompt, and how many threads it takes, is what the library does by itself.
"""

import json
from time import perf_counter
from typing import Any

import llama_cpp
from llama_cpp.llama_chat_format import Jinja2ChatFormatter

from pa_console.llm.local.decoding import FORMATS
from pa_console.schema.base import StrictModel
from tests.benchmarks.speed.child import LoadWeights, serve
from tests.benchmarks.speed.messages import PlainAnswer, PlainAsk

_api: Any = llama_cpp


class Plain:
    """A loaded model behind `create_chat_completion`, greedy like ours."""

    def __init__(self, load: LoadWeights) -> None:
        """Load the weights; raises ValueError when llama.cpp cannot."""
        self._llama = _api.Llama(
            model_path=load.path,
            lora_path=load.adapter or None,
            n_ctx=load.n_ctx,
            verbose=False,
        )
        if load.chat != "template":
            self._llama.chat_handler = Jinja2ChatFormatter(
                FORMATS[load.chat], eos_token="", bos_token=""
            ).to_chat_handler()
        self._has_system_role = self._takes_system_role()

    def answer(self, line: bytes) -> StrictModel:
        """Return the answer to one PlainAsk."""
        ask = PlainAsk.model_validate_json(line)
        started = perf_counter()
        found = self._llama.create_chat_completion(
            self._messages(ask.system, ask.user),
            response_format={"type": "json_object", "schema": json.loads(ask.answer_schema)},
            max_tokens=ask.max_tokens,
            temperature=0.0,
        )
        seconds = perf_counter() - started
        return PlainAnswer(
            text=found["choices"][0]["message"]["content"] or "",
            prompt_tokens=found["usage"]["prompt_tokens"],
            completion_tokens=found["usage"]["completion_tokens"],
            complete=found["choices"][0]["finish_reason"] == "stop",
            seconds=seconds,
        )

    def _messages(self, system: str, user: str) -> list[dict[str, str]]:
        if self._has_system_role:
            return [{"role": "system", "content": system}, {"role": "user", "content": user}]
        return [{"role": "user", "content": f"{system}\n\n{user}"}]

    def _takes_system_role(self) -> bool:
        """Return whether the model's chat template knows a system message; some refuse one."""
        self._has_system_role = True
        try:
            self._llama.create_chat_completion(self._messages("-", "-"), max_tokens=1)
        except Exception:  # a template raises what it likes
            return False
        return True


def _load(load: LoadWeights) -> tuple[int, Any]:
    plain = Plain(load)
    return load.n_ctx, plain.answer


if __name__ == "__main__":
    serve(_load)
