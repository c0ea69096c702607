"""Makes of one GGUF file another: a smaller vocabulary, weights of another type.

`python -m pa_console.llm.convert SOURCE TARGET TYPE PIECES` ends with 0 when TARGET is complete; it
is a process of its own that can be stopped. A TYPE of `stored` leaves the weights as they are, 0
PIECES the vocabulary.
"""

import sys
from pathlib import Path
from typing import Any

import llama_cpp

from pa_console.llm.prepare import AS_STORED, Quantisation
from pa_console.llm.vocabulary import cut_vocabulary

_api: Any = llama_cpp
FILE_TYPES: dict[Quantisation, int] = {
    "f16": _api.LLAMA_FTYPE_MOSTLY_F16,
    "bf16": _api.LLAMA_FTYPE_MOSTLY_BF16,
    "q8_0": _api.LLAMA_FTYPE_MOSTLY_Q8_0,
    "q4_0": _api.LLAMA_FTYPE_MOSTLY_Q4_0,
}


def quantise(source: str, target: str, quantisation: Quantisation) -> None:
    """Write the weights of `source` to `target`; raises ValueError when llama.cpp cannot.

    Embeddings and output layer become Q8_0 whatever the type: they are read one row or one token
    at a time, so a wider type would only cost memory.
    """
    parameters = _api.llama_model_quantize_default_params()
    parameters.ftype = FILE_TYPES[quantisation]
    parameters.allow_requantize = True
    parameters.token_embedding_type = parameters.output_tensor_type = _api.GGML_TYPE_Q8_0
    if _api.llama_model_quantize(source.encode(), target.encode(), parameters) != 0:
        raise ValueError(f"llama.cpp could not write {target} from {source}")


def convert(source: str, target: str, kind: str, pieces: int) -> None:
    """Write to `target` what `kind` and `pieces` make of `source`; raises ValueError or OSError."""
    if pieces and kind == AS_STORED:
        cut_vocabulary(Path(source), Path(target), pieces)
    elif pieces:
        smaller = f"{target}.cut"
        cut_vocabulary(Path(source), Path(smaller), pieces)
        quantise(smaller, target, kind)  # type: ignore[arg-type]
        Path(smaller).unlink()
    else:
        quantise(source, target, kind)  # type: ignore[arg-type]


@_api.llama_log_callback
def _no_log(_level: int, _text: bytes, _data: object) -> None:
    """Swallow what llama.cpp has to say: a line for every tensor."""


if __name__ == "__main__":
    _api.llama_log_set(_no_log, None)
    try:
        convert(sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4]))
    except (ValueError, OSError) as error:
        sys.exit(str(error))
