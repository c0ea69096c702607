"""Proof that llama.cpp with an exported adapter computes what was trained.

Quantised bases are not expected to agree to the last digit: llama.cpp rounds activations to 8 bits
before it multiplies with quantised weights, the training does not.
"""

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import llama_cpp
import numpy as np
import torch
from numpy.typing import NDArray

from pa_training.adapters.adapter_file import Matrices
from pa_training.adapters.config import TrainConfig
from pa_training.adapters.network import adapted, load_base, set_matrices

_api: Any = llama_cpp


@dataclass(frozen=True)
class Parity:
    """How near the logits of both sides are, over all positions of a text."""

    positions: int
    correlation: float
    """Mean over positions of the correlation between the two rows of logits."""
    largest: float
    """Largest difference of a probability."""
    same_choice: float
    """Share of positions with the same most likely token."""


def compare(
    base: Path,
    config: TrainConfig,
    adapter: Matrices | None,
    file: Path | None,
    tokens: Sequence[int],
) -> Parity:
    """Compare the float32 forward pass of `tokens` that is trained with llama.cpp's.

    `adapter` is that of `config` and `file` the same one exported; both None compare the bases.
    Raises ValueError when llama.cpp cannot load `file`.
    """
    ours = torch_logits(base, config, adapter, tokens)
    theirs = llama_logits(base, file, tokens)
    probabilities = [_softmax(rows) for rows in (ours, theirs)]
    centred = [rows - rows.mean(1, keepdims=True) for rows in (ours, theirs)]
    products = (centred[0] * centred[1]).sum(1)
    norms = np.linalg.norm(centred[0], axis=1) * np.linalg.norm(centred[1], axis=1)
    return Parity(
        positions=len(tokens),
        correlation=float((products / norms).mean()),
        largest=float(np.abs(probabilities[0] - probabilities[1]).max()),
        same_choice=float((ours.argmax(1) == theirs.argmax(1)).mean()),
    )


@torch.no_grad()
def torch_logits(
    base: Path, config: TrainConfig, adapter: Matrices | None, tokens: Sequence[int]
) -> NDArray[np.float32]:
    """Return the logits (tokens, vocabulary) of the network that is trained, in float32."""
    network: Any = load_base(base, config.model_copy(update={"precision": "float32"}))
    if adapter is not None:
        network = adapted(network, config)
        set_matrices(network, adapter)
    return network.eval()(torch.tensor([tokens])).logits[0].numpy()


def llama_logits(base: Path, file: Path | None, tokens: Sequence[int]) -> NDArray[np.float32]:
    """Return the logits (tokens, vocabulary) of llama.cpp with the adapter in `file`.

    Raises ValueError when llama.cpp cannot load one of the files.
    """
    _api.llama_log_set(_no_log, None)
    _api.llama_backend_init()
    model = _api.llama_model_load_from_file(bytes(base), _api.llama_model_default_params())
    if not model:
        raise ValueError(f"{base}: not a GGUF model that this version of llama.cpp can load")
    parameters = _api.llama_context_default_params()
    parameters.n_ctx = parameters.n_batch = parameters.n_ubatch = len(tokens)
    context = _api.llama_init_from_model(model, parameters)
    try:
        if file is not None:
            _set_adapter(model, context, file)
        return _evaluate(model, context, tokens)
    finally:
        _api.llama_free(context)
        _api.llama_model_free(model)


def _set_adapter(model: Any, context: Any, file: Path) -> None:
    """Use the adapter in `file`, which lives as long as its model."""
    adapter = _api.llama_adapter_lora_init(model, bytes(file))
    if not adapter:
        raise ValueError(f"{file}: not an adapter that llama.cpp can load for this base")
    adapters = (_api.llama_adapter_lora_p_ctypes * 1)(adapter)
    _api.llama_set_adapters_lora(context, adapters, 1, (ctypes.c_float * 1)(1.0))


def _evaluate(model: Any, context: Any, tokens: Sequence[int]) -> NDArray[np.float32]:
    batch = _api.llama_batch_init(len(tokens), 0, 1)
    batch.n_tokens = len(tokens)
    for position, token in enumerate(tokens):
        batch.token[position], batch.pos[position] = token, position
        batch.n_seq_id[position], batch.seq_id[position][0] = 1, 0
        batch.logits[position] = True
    code = _api.llama_decode(context, batch)
    _api.llama_batch_free(batch)
    if code != 0:
        raise ValueError(f"llama.cpp could not evaluate {len(tokens)} tokens (code {code})")
    size = _api.llama_vocab_n_tokens(_api.llama_model_get_vocab(model))
    rows = _api.llama_get_logits(context)
    return np.ctypeslib.as_array(rows, shape=(len(tokens), size)).copy()


@_api.llama_log_callback
def _no_log(_level: int, _text: bytes, _data: object) -> None:
    """Swallow what llama.cpp has to say."""


def _softmax(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    powers = np.exp(rows - rows.max(1, keepdims=True))
    return powers / powers.sum(1, keepdims=True)
