"""The real model that the tests run on, fetched into the user's cache once."""

import os
from pathlib import Path

import pytest

from pa_console.llm.models.cache import CACHE_VARIABLE
from pa_console.llm.models.catalogue import Catalog, LocalModel
from pa_console.llm.models.fetching import pull
from pa_console.signing import KEY_VARIABLE

SMALLEST = "smollm2-135m"


@pytest.fixture(scope="session")
def smallest_model() -> LocalModel:
    catalog = Catalog.load()
    pull(catalog.get(SMALLEST))
    return catalog.locate(SMALLEST)


@pytest.fixture
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make everything be cached in an empty folder, and signed with a new key."""
    folder = tmp_path / "cache"
    monkeypatch.setenv(KEY_VARIABLE, os.fspath(tmp_path / "keys" / "key.pem"))
    monkeypatch.setenv(CACHE_VARIABLE, os.fspath(folder))
    return folder
