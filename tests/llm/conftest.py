"""The real model that the tests run on, fetched into the user's cache once."""

import os
from dataclasses import replace
from pathlib import Path

import pytest

from pa_console.llm.models.cache import CACHE_VARIABLE, hash_file
from pa_console.llm.models.catalogue import Catalog, LocalModel
from pa_console.llm.models.fetching import pull
from pa_console.signing import KEY_VARIABLE
from tests.llm.shallow import write_shallow

SMALLEST = "smollm2-135m"


@pytest.fixture(scope="session")
def smallest_model() -> LocalModel:
    catalog = Catalog.load()
    pull(catalog.get(SMALLEST))
    return catalog.locate(SMALLEST)


@pytest.fixture(scope="session")
def shallow_model(
    smallest_model: LocalModel, tmp_path_factory: pytest.TempPathFactory
) -> LocalModel:
    """Two layers of the smallest model, for where it does not matter what a model says."""
    path = tmp_path_factory.mktemp("shallow") / "shallow.gguf"
    write_shallow(smallest_model.path, path)
    return replace(smallest_model, path=path, sha256=hash_file(path))


@pytest.fixture
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make everything be cached in an empty folder, and signed with a new key."""
    folder = tmp_path / "cache"
    monkeypatch.setenv(KEY_VARIABLE, os.fspath(tmp_path / "keys" / "key.pem"))
    monkeypatch.setenv(CACHE_VARIABLE, os.fspath(folder))
    return folder
