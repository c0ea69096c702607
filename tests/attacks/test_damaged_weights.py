"""Damaged models and adapters end no process, and each is refused with an error that names it."""

import struct
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import gguf
import pytest

from pa_console.llm.backend import EngineDiedError, EngineError, ModelUnavailableError
from pa_console.llm.local.engine import Engine
from pa_console.llm.models import gguf_bounds
from pa_console.llm.models.cache import hash_file
from pa_console.llm.models.catalogue import LocalAdapter
from pa_console.llm.models.gguf_bounds import check_gguf
from pa_console.resources import data_folder
from tests.attacks.mutated_weights import write_adapter
from tests.llm.asking import answer, local_model
from tests.training.adapters.tiny import ARCHITECTURES, write_tiny


def test_300_damaged_files_are_refused_or_harmless() -> None:
    command = (sys.executable, "-m", "tests.attacks", "weights", "--count", "300")
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "model loaded" in ended.stdout, "some damage does no harm: llama.cpp was reached"


@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_a_whole_model_is_sound(tmp_path: Path, architecture: str) -> None:
    check_gguf(str(write_tiny(tmp_path / "model.gguf", architecture)), "model")


def test_whole_adapters_are_sound(tmp_path: Path) -> None:
    shipped = sorted((data_folder() / "models").glob("*.lora.gguf"))
    assert shipped
    for path in (write_adapter(tmp_path / "adapter.gguf"), *shipped):
        check_gguf(str(path), "adapter")


def test_the_sizes_of_blocks_are_those_of_the_format() -> None:
    known = {int(kind): size for kind, size in gguf.GGML_QUANT_SIZES.items()}
    assert {kind: known[kind] for kind in gguf_bounds.BLOCKS} == gguf_bounds.BLOCKS
    assert {int(gguf.GGUFValueType[name]) for name in ("STRING", "ARRAY")} == {
        gguf_bounds.STRING,
        gguf_bounds.ARRAY,
    }


HEADER = b"GGUF" + struct.pack("<I", 3)
NAMED = struct.pack("<Q", 20) + b"general.architecture" + struct.pack("<IQ", 8, 5) + b"llama"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "the file is empty"),
        (b"no model", "does not begin with GGUF"),
        (b"GGUF" + struct.pack("<I", 1), "the version is 1"),
        (HEADER + struct.pack("<QQ", 1 << 63, 0), "the number of tensors is 9,223"),
        (HEADER + struct.pack("<QQ", 0, 1 << 32), "the number of fields is 4,294"),
        (HEADER + struct.pack("<QQQ", 0, 1, 1 << 60), "the length of a key is"),
        (HEADER + struct.pack("<QQQ", 0, 1, 200), "a key goes beyond the end"),
        (HEADER + struct.pack("<QQ", 0, 2) + 2 * NAMED, "'general.architecture' appears twice"),
        (HEADER + struct.pack("<QQ", 0, 0), "general.architecture is missing"),
        (HEADER + struct.pack("<QQ", 0, 1) + NAMED[:28] + struct.pack("<I", 5), "of type 5, not 8"),
    ],
)
def test_the_error_names_the_file_and_the_number_that_is_wrong(
    tmp_path: Path, content: bytes, said: str
) -> None:
    path = tmp_path / "damaged.gguf"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=said) as error:
        check_gguf(str(path), "model", name="models/mine.gguf")
    assert str(error.value).startswith("models/mine.gguf: not a sound GGUF file")
    assert str(error.value).endswith("fetch it again, or use another file")


async def error_of(engine: Engine) -> EngineError:
    """Return the error with which a request ends."""
    with pytest.raises(EngineError) as error:
        await answer(engine)
    await engine.close()
    return error.value


def cut(path: Path) -> Path:
    """Cut the end of the file off."""
    path.write_bytes(path.read_bytes()[:-1000])
    return path


@pytest.mark.parametrize("write", [write_tiny, write_adapter])
async def test_a_damaged_file_makes_the_model_unavailable_in_clear_words(
    tmp_path: Path, write: Callable[[Path], Path]
) -> None:
    whole = write_tiny(tmp_path / "whole.gguf")
    damaged = cut(write(tmp_path / "damaged.gguf"))
    model = local_model(whole)
    if write is write_tiny:
        model = replace(model, path=damaged, sha256=hash_file(damaged))
    else:
        model = replace(model, adapters=(LocalAdapter("judge", damaged, hash_file(damaged)),))
    error = await error_of(Engine(model))
    assert isinstance(error, ModelUnavailableError)
    assert f"{damaged}: not a sound GGUF file" in str(error)
    assert "goes beyond the end of the file" in str(error)


async def test_a_process_that_dies_while_it_loads_names_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "pa_console.llm.local.worker_process.COMMAND", ("-c", "import os; os.abort()")
    )
    whole = write_tiny(tmp_path / "whole.gguf")
    error = await error_of(Engine(local_model(whole)))
    assert isinstance(error, EngineDiedError)
    assert str(whole) in str(error)
