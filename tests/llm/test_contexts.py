"""Which adapter a context has: also where a freed context's address is used again."""

import ctypes
from typing import Any

import pytest

from pa_console.llm.local import runtime
from pa_console.llm.local.runtime import AdapterSwitch

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
