"""Applies adapters to contexts: each is loaded once, and switched only when another is needed.

Only the worker process imports this. A switch costs about 3 ms at the next evaluation (135M
weights, two cores).
"""

import ctypes
from collections.abc import Mapping
from typing import Any

import llama_cpp

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


def _load(model: Any, path: str) -> Any:
    adapter = _api.llama_adapter_lora_init(model, path.encode())
    if not adapter:
        raise ValueError(
            f"{path}: not an adapter for this model that this version of llama.cpp can load"
        )
    return adapter
