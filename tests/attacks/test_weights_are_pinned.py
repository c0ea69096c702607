"""No weights and no adapter are loaded that nobody pinned, whoever writes to the cache."""

import hashlib
import json
import os
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pa_console.cli.verbs.doctor.models import check_model
from pa_console.llm.backend import ModelError, ModelUnavailableError
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.cache import CACHE_VARIABLE, hash_file
from pa_console.llm.models.catalogue import Catalog, LocalAdapter, LocalModel
from pa_console.signing import KEY_VARIABLE, load_signer
from tests.llm.asking import answer, local_model
from tests.training.adapters.tiny import write_tiny

NAME = "tiny"
CHANGED = "not the file that was checked"


@pytest.fixture(autouse=True)
def source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a small model in an empty cache, on a machine with a key of its own."""
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setenv(KEY_VARIABLE, str(tmp_path / "keys" / "key.pem"))
    return write_tiny(tmp_path / "source.gguf")


def catalog(source: Path, **more: object) -> Catalog:
    """Return a catalogue with the model alone, prepared as Q8_0."""
    entry: dict[str, object] = {
        "name": NAME,
        "title": "Tiny",
        "licence": "none",
        "parameters": "1",
        "quantisation": "F32",
        "size_mb": 1,
        "sha256": hash_file(source),
        "prepare": "q8_0",
        "sources": ({"kind": "path", "path": str(source)},),
    }
    return Catalog.model_validate({"default": NAME, "models": (entry | more,)})


def flip(path: Path) -> None:
    """Change one weight of the last tensor, in place."""
    with path.open("r+b") as file:
        file.seek(-40, os.SEEK_END)
        byte = file.read(1)[0]
        file.seek(-40, os.SEEK_END)
        file.write(bytes([byte ^ 0x55]))


def record_of(path: Path) -> dict[str, Any]:
    return json.loads(path.with_suffix(".json").read_text())


def rewritten(path: Path, _tmp: Path) -> dict[str, Any]:
    """Return the record with the hash of the file as it is now, and nothing else changed."""
    return record_of(path) | {"sha256": hash_file(path)}


def unsigned(path: Path, tmp: Path) -> dict[str, Any]:
    """Return what was enough before there were signatures."""
    fields = ("source_sha256", "quantisation", "vocabulary", "llama_cpp", "sha256")
    return {name: rewritten(path, tmp)[name] for name in fields}


def signed_by_another(path: Path, tmp: Path) -> dict[str, Any]:
    """Return a record that is sound, but of somebody else's key."""
    from pa_console.llm.models.preparing import FileOrigin  # noqa: PLC0415 - has no signatures without them

    with pytest.MonkeyPatch.context() as other:
        other.setenv(KEY_VARIABLE, str(tmp / "other" / "key.pem"))
        forged = FileOrigin.model_validate_json(json.dumps(rewritten(path, tmp)))
        return forged.signed().model_dump(mode="json")


@pytest.mark.parametrize("pinned", [True, False])
@pytest.mark.parametrize("forge", [rewritten, unsigned, signed_by_another])
def test_a_flipped_weight_with_its_hash_rewritten_beside_it_is_never_loaded(
    source: Path,
    tmp_path: Path,
    pinned: bool,
    forge: Callable[[Path, Path], dict[str, Any]],
) -> None:
    plain = catalog(source)
    whole = plain.locate(NAME)
    known = catalog(source, prepared={"q8_0": whole.sha256}) if pinned else plain
    flip(whole.path)
    assert hash_file(whole.path) != whole.sha256
    whole.path.with_suffix(".json").write_text(json.dumps(forge(whole.path, tmp_path)))
    assert known.locate(NAME) == whole
    assert hash_file(whole.path) == whole.sha256, "it was made again of the pinned source"


@pytest.mark.parametrize("pinned", [True, False])
def test_doctor_says_what_was_compared_with_what(
    source: Path, tmp_path: Path, pinned: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = catalog(source)

    def installed(_path: Path | None = None) -> Catalog:
        return known

    monkeypatch.setattr("pa_console.cli.verbs.doctor.models.Catalog.load", installed)
    assert "prepared at the first start" in next(check_model(NAME)).found
    whole = known.locate(NAME)
    if pinned:
        known = catalog(source, prepared={"q8_0": whole.sha256})
    good = next(check_model(NAME))
    assert good.state == "ok"
    assert str(whole.path) in good.found
    with_what = "the catalogue for q8_0" if pinned else "signed with this machine's key"
    assert with_what in good.found
    flip(whole.path)
    whole.path.with_suffix(".json").write_text(json.dumps(rewritten(whole.path, tmp_path)))
    bad = next(check_model(NAME))
    assert bad.state == "missing"
    assert "never loaded" in bad.found
    assert "models pull" in bad.remedy


def test_what_is_made_here_and_is_not_what_is_pinned_is_refused_and_deleted(source: Path) -> None:
    with pytest.raises(ModelError, match=r"q8_0 weights .* the catalogue pins 0000"):
        catalog(source, prepared={"q8_0": "0" * 64}).locate(NAME)
    assert not list((Path(os.environ[CACHE_VARIABLE]) / "models").glob("*.gguf"))


def test_the_shipped_catalogue_pins_all_that_it_prepares() -> None:
    prepared = [entry for entry in Catalog.load().models if entry.prepare == "fastest"]
    assert prepared
    assert all({"f16", "bf16"} <= entry.prepared.keys() for entry in prepared)


@asynccontextmanager
async def running(model: LocalModel) -> AsyncGenerator[Callable[[], Awaitable[str]]]:
    """Give what asks the model, whose process ends with the block."""
    engine = Engine(model)

    async def ask() -> str:
        return (await answer(engine)).text

    try:
        yield ask
    finally:
        await engine.close()


async def test_a_file_that_is_swapped_between_the_check_and_the_load_is_not_loaded(
    source: Path, tmp_path: Path
) -> None:
    checked = local_model(source)
    os.replace(write_tiny(tmp_path / "other.gguf", seed=1), source)
    async with running(checked) as ask:
        with pytest.raises(ModelUnavailableError, match=CHANGED):
            await ask()


async def test_an_adapter_that_is_swapped_is_not_loaded(source: Path, tmp_path: Path) -> None:
    path = tmp_path / "judge.lora.gguf"
    path.write_bytes(b"as it was when it was checked")
    adapter = LocalAdapter("judge", path, hash_file(path))
    path.write_bytes(b"as it is when it is loaded")
    async with running(replace(local_model(source), adapters=(adapter,))) as ask:
        with pytest.raises(ModelUnavailableError, match=CHANGED):
            await ask()


async def test_weights_that_are_written_to_while_they_are_in_use_answer_no_more(
    source: Path,
) -> None:
    async with running(local_model(source)) as ask:
        assert len(await ask()) == 6
        flip(source)
        for _ in range(2):
            with pytest.raises(ModelUnavailableError, match=CHANGED):
                await ask()


async def test_a_new_file_under_the_name_of_one_in_use_changes_nothing(
    source: Path, tmp_path: Path
) -> None:
    async with running(local_model(source)) as ask:
        before = await ask()
        os.replace(write_tiny(tmp_path / "other.gguf", seed=1), source)
        assert await ask() == before


def test_what_was_hashed_is_what_is_opened_whatever_its_name_leads_to(tmp_path: Path) -> None:
    from pa_console.llm.models.cache import DESCRIPTORS, CheckedFile  # noqa: PLC0415

    path, other = tmp_path / "weights", tmp_path / "other"
    path.write_bytes(b"checked")
    other.write_bytes(b"swapped")
    file = CheckedFile(str(path), hashlib.sha256(b"checked").hexdigest())
    os.replace(other, path)
    file.check()
    if not DESCRIPTORS.exists():
        pytest.skip("a descriptor has no path of its own on this system")
    assert Path(file.route).read_bytes() == b"checked"


def test_the_key_that_signs_records_is_not_beside_them(source: Path) -> None:
    whole = catalog(source).locate(NAME)
    assert record_of(whole.path)["signer"] == load_signer().public
    cache = Path(os.environ[CACHE_VARIABLE])
    assert not list(cache.rglob("*.pem"))
