"""The model catalogue: names, errors and files on this machine."""

import hashlib
from pathlib import Path

import pytest

from pa_console.llm.backend import ModelError
from pa_console.llm.models.catalogue import Catalog, ModelEntry, PathSource
from pa_console.llm.models.preparing import prepared_path
from pa_console.schema.document import DocumentError

INSTALLABLE = {
    "pa-135m",
    "pa-500m",
    "smollm2-135m",
    "qwen2.5-coder-0.5b",
    "qwen2.5-coder-1.5b",
    "gemma-3-270m",
}
OF_THE_PAPER = {"gemma-2b", "llama-3.1-8b", "mistral-7b", "qwen2.5-7b"}


def test_the_installed_catalogue_has_the_models_and_pins_those_that_packages_carry():
    catalog = Catalog.load()
    assert {entry.name for entry in catalog.models} == INSTALLABLE | OF_THE_PAPER
    pinned = {entry.name for entry in catalog.models if entry.sha256}
    assert pinned == INSTALLABLE
    assert catalog.get(catalog.default).sha256


def test_an_unknown_name_is_refused_with_the_nearest_and_all_known_names():
    with pytest.raises(ModelError, match=r"Did you mean smollm2-135m\?.*llama-3\.1-8b"):
        Catalog.load().get("smollm-135")


def test_a_model_that_was_not_pulled_says_how_to_pull_it(empty_cache: Path):
    with pytest.raises(ModelError, match="pa-console models pull gemma-3-270m"):
        Catalog.load().locate("gemma-3-270m")


def test_a_path_is_a_model_of_its_own_with_the_hash_of_the_file(tmp_path: Path):
    path = tmp_path / "mine.gguf"
    path.write_bytes(b"GGUF weights")
    model = Catalog.load().locate(str(path))
    assert (model.name, model.path) == ("mine", path)
    assert model.sha256 == hashlib.sha256(b"GGUF weights").hexdigest()


def test_a_path_that_does_not_exist_is_named(tmp_path: Path):
    with pytest.raises(ModelError, match=r"gone\.gguf: no such model file"):
        Catalog.load().get(str(tmp_path / "gone.gguf"))


def test_a_file_in_the_cache_that_was_changed_is_not_used(empty_cache: Path):
    (empty_cache / "models").mkdir(parents=True)
    (empty_cache / "models" / "gemma-3-270m.gguf").write_bytes(b"something else")
    with pytest.raises(ModelError, match="not the pinned file of gemma-3-270m"):
        Catalog.load().locate("gemma-3-270m")


def test_a_local_path_source_is_used_where_it_exists(tmp_path: Path, empty_cache: Path):
    path = tmp_path / "weights.gguf"
    path.write_bytes(b"weights")
    entry = ModelEntry(
        name="m",
        title="M",
        licence="none",
        parameters="1",
        quantisation="Q8_0",
        size_mb=1,
        sha256=None,
        sources=(PathSource(path=str(path)),),
    )
    assert entry.local_file == path


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("default: small", "default: huge"), "default: 'huge' is not one of the models"),
        (("sha256: null", "sha256: abc"), r":9: models\.0\.sha256"),
        (("size_mb: 1", "size: 1"), r"models\.0\.size"),
        (("package: p,", "package: 'p{n}',"), "needs {n} exactly when"),
        (("sha256:", "second_reader: huge\n    sha256:"), "second_reader: no model 'huge'"),
        (("sha256: null", "second_reader: small\n    sha256: null"), "has to be another model"),
    ],
)
def test_a_broken_catalogue_names_file_line_and_field(
    tmp_path: Path, change: tuple[str, str], said: str
):
    text = """\
default: small
models:
  - name: small
    title: Small
    licence: none
    parameters: 1B
    quantisation: Q8_0
    size_mb: 1
    sha256: null
    sources: [{kind: packages, package: p, version: "1", member: "*.gguf"}]
"""
    path = tmp_path / "catalog.yaml"
    path.write_text(text)
    assert Catalog.load(path).get("small").title == "Small"
    path.write_text(text.replace(*change))
    with pytest.raises(DocumentError, match=said):
        Catalog.load(path)


def test_a_prepared_model_is_taken_as_pinned_and_its_loader_is_left_to_hash_it(
    tmp_path: Path, empty_cache: Path
):
    entry = ModelEntry(
        name="m",
        title="M",
        licence="none",
        parameters="1",
        quantisation="Q8_0",
        size_mb=1,
        sha256="0" * 64,
        prepare="q4_0",
        prepared={"q4_0": "1" * 64},
        sources=(PathSource(path=str(tmp_path / "weights.gguf")),),
    )
    assert entry.as_pinned() is None
    how = entry.how
    assert how is not None
    path = prepared_path("m", how)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"weights")
    found = entry.as_pinned()
    assert found is not None
    assert (found.path, found.sha256) == (path, "1" * 64)


@pytest.mark.parametrize("content", [b"", b"just text\n"])
def test_a_file_that_is_no_model_is_refused_before_anything_starts(tmp_path: Path, content: bytes):
    path = tmp_path / "notes.txt"
    path.write_bytes(content)
    with pytest.raises(ModelError, match=r"notes\.txt: no model in GGUF; fetch it again"):
        Catalog.load().get(str(path))
    with pytest.raises(ModelError, match="give the path of one"):
        Catalog.load().get(str(tmp_path))
