"""What a context has evaluated: with which adapter, and what of it is used again."""

import ctypes
from pathlib import Path
from typing import Any

import pytest

from pa_console.llm.local import runtime
from pa_console.llm.local.runtime import AdapterSwitch, Runtime
from pa_console.llm.local.threads import FreeCores
from pa_console.llm.models.catalogue import LocalModel
from pa_console.llm.models.gguf_conversion import quantise
from pa_console.llm.models.preparing import Quantisation

ADDRESS = 4096


def test_a_context_at_the_address_of_a_freed_one_gets_its_adapter(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    switched: list[int] = []

    class Api:
        llama_adapter_lora_p_ctypes = ctypes.c_void_p

        @staticmethod
        def llama_adapter_lora_init(_model: Any, _path: bytes) -> int:
            return 7

        @staticmethod
        def llama_set_adapters_lora(context: int, *_: Any) -> int:
            switched.append(context)
            return 0

    monkeypatch.setattr(runtime, "_api", Api)
    switch = AdapterSwitch(object(), {0: "planner.gguf"})
    switch.use(ADDRESS, 0)
    switch.use(ADDRESS, 0)
    assert switched == [ADDRESS]
    switch.forget(ADDRESS)
    switch.use(ADDRESS, 0)
    assert switched == [ADDRESS, ADDRESS]


@pytest.mark.parametrize("kind", ["bf16", "f16", "q4_0"])
def test_a_prompt_is_read_as_in_a_fresh_context_whatever_was_read_before(
    shallow_model: LocalModel, tmp_path: Path, kind: Quantisation
) -> None:
    file = str(tmp_path / "weights.gguf")
    quantise(str(shallow_model.path), file, kind)
    cores = FreeCores(1, fixed=True)
    model = Runtime(file, n_ctx=512, cores=cores, stopped=lambda: False)
    text = "The drone flies to the gate in the east, and the guard waits there. " * 20
    tokens = model.tokenise(text, special=False)
    for length in (129, 113, 150):
        prompt = tokens[:length]
        model.begin(0, tokens[200:210])
        fresh, kept = model.begin(0, prompt)
        assert kept == 0
        whole = fresh.tobytes()
        for common in (17, 64, 70, 96, 112, 128):
            model.begin(0, [*prompt[:common], *tokens[200:210]])
            again, kept = model.begin(0, prompt)
            assert 0 < kept <= min(common, length - 2)
            assert again.tobytes() == whole
