"""Prepared weights: made once, never half, made again when they do not fit what they are of."""

from pathlib import Path

import pytest

from pa_console.llm.backend import ModelError, PullError
from pa_console.llm.models import cache
from pa_console.llm.models import preparing as module
from pa_console.llm.models.cache import hash_file
from pa_console.llm.models.catalogue import Catalog, ModelEntry, PathSource, fastest_type
from pa_console.llm.models.preparing import (
    Preparation,
    PreparedFile,
    find_recorded,
    prepare,
    prepared_path,
)
from tests.training.adapters.tiny import write_tiny

Q8 = Preparation("q8_0")
NEVER = ("-c", "raise SystemExit('must not be made again')")


@pytest.fixture
def source(tmp_path: Path, empty_cache: Path) -> Path:
    return write_tiny(tmp_path / "source.gguf")


def made(source: Path) -> PreparedFile:
    return prepare("tiny", Q8, source, hash_file(source))


def left_over(cache: Path) -> list[str]:
    """Return every file in `cache` but the locks."""
    return sorted(p.name for p in cache.rglob("*") if p.is_file() and p.suffix != ".lock")


def test_weights_are_prepared_once_and_used_from_then_on(
    source: Path, empty_cache: Path, monkeypatch: pytest.MonkeyPatch
):
    told: list[tuple[int, int, str]] = []
    first = prepare(
        "tiny",
        Q8,
        source,
        hash_file(source),
        lambda done, total, text: told.append((done, total, text)),
    )
    assert left_over(empty_cache) == ["tiny-q8_0.gguf", "tiny-q8_0.json"]
    assert first.sha256 == hash_file(first.path) != hash_file(source)
    assert told[-1][2] == "q8_0 weights are ready"
    assert all(0 <= done <= total for done, total, _ in told)
    monkeypatch.setattr(module, "COMMAND", NEVER)
    assert made(source) == first


def test_a_broken_or_missing_prepared_file_is_made_again(source: Path, empty_cache: Path):
    first = made(source)
    first.path.write_bytes(first.path.read_bytes()[:-1] + b"?")
    assert find_recorded("tiny", Q8, hash_file(source)) is None
    assert made(source) == first
    first.path.unlink()
    assert made(source) == first
    first.path.with_suffix(".json").write_text("{")
    assert made(source) == first


def test_another_source_or_another_llama_cpp_makes_it_again(
    source: Path, tmp_path: Path, empty_cache: Path, monkeypatch: pytest.MonkeyPatch
):
    first = made(source)
    other = write_tiny(tmp_path / "other.gguf", seed=1)
    assert made(other).sha256 != first.sha256
    monkeypatch.setattr(module, "LLAMA_CPP", "numpy")
    assert find_recorded("tiny", Q8, hash_file(other)) is None


def test_ctrl_c_leaves_neither_file_nor_process(
    source: Path, empty_cache: Path, monkeypatch: pytest.MonkeyPatch
):
    script = (
        "import pathlib, sys, time; pathlib.Path(sys.argv[2]).write_bytes(b'half'); time.sleep(60)"
    )
    monkeypatch.setattr(module, "COMMAND", ("-c", script))

    def interrupt(done: int, _total: int, _text: str) -> None:
        if done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        prepare("tiny", Q8, source, hash_file(source), interrupt)
    assert left_over(empty_cache) == []


def test_a_full_disk_is_named_before_anything_is_written(
    source: Path, empty_cache: Path, monkeypatch: pytest.MonkeyPatch
):
    def full(_path: Path) -> object:
        return type("Usage", (), {"free": 7})

    monkeypatch.setattr(cache.shutil, "disk_usage", full)
    with pytest.raises(PullError, match="free some space"):
        made(source)
    assert left_over(empty_cache) == []


def test_a_file_that_is_no_model_is_named_and_leaves_nothing(tmp_path: Path, empty_cache: Path):
    path = tmp_path / "odd.gguf"
    path.write_bytes(b"GGUF but not really")
    with pytest.raises(PullError, match=r"odd\.gguf: not a sound GGUF file"):
        made(path)
    assert left_over(empty_cache) == []


def catalog_of(source: Path) -> Catalog:
    entry = ModelEntry(
        name="tiny",
        title="Tiny",
        licence="none",
        parameters="1",
        quantisation="F32",
        size_mb=1,
        sha256=hash_file(source),
        prepare="q8_0",
        sources=(PathSource(path=str(source)),),
    )
    return Catalog(default="tiny", models=(entry,))


def test_a_model_that_is_here_is_prepared_when_it_is_first_located(source: Path):
    catalog = catalog_of(source)
    assert catalog.get("tiny").prepared_file is None
    model = catalog.locate("tiny")
    assert model.path == prepared_path("tiny", Q8) == catalog.get("tiny").prepared_file
    assert model.sha256 == hash_file(model.path)


def test_a_source_that_is_not_the_pinned_one_is_not_prepared(source: Path, empty_cache: Path):
    catalog = catalog_of(source)
    source.write_bytes(b"something else")
    with pytest.raises(ModelError, match="not the pinned file"):
        catalog.locate("tiny")
    assert left_over(empty_cache) == []


def test_the_fastest_type_is_that_of_the_machine(source: Path, monkeypatch: pytest.MonkeyPatch):
    chosen = {"prepare": "fastest"}
    catalog = catalog_of(source)
    entry = catalog.get("tiny").model_copy(update=chosen)
    for kind in ("f16", "bf16"):
        monkeypatch.setattr("pa_console.llm.models.catalogue.fastest_type", lambda kind=kind: kind)
        path, digest = entry.ready_file(source)
        assert path == prepared_path("tiny", Preparation(kind)) == entry.prepared_file
        assert digest == hash_file(path)


@pytest.mark.parametrize(
    ("flags", "kind"),
    [
        ("fpu avx avx2 f16c", "f16"),
        ("fpu avx2 avx512f avx512_vnni", "bf16"),
        ("fpu avx2 avx512fake", "f16"),
    ],
)
def test_wide_vectors_decide_which_type_is_fastest(flags: str, kind: str, tmp_path: Path):
    info = tmp_path / "cpuinfo"
    info.write_text(f"processor : 0\nflags\t\t: {flags}\n")
    assert fastest_type(info) == kind
    assert fastest_type(tmp_path / "none") == "f16"
