"""The command line inside the test's own process."""

from pathlib import Path

import pytest

from pa_console.signing import KEY_VARIABLE
from tests.cli.inside import Call, caller


@pytest.fixture(autouse=True)
def _a_key_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:  # pyright: ignore[reportUnusedFunction]
    """Keep a test from making or using the key of this machine's user."""
    monkeypatch.setenv(KEY_VARIABLE, str(tmp_path / "key" / "key.pem"))


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    """Return what runs a verb in this process."""
    return caller(monkeypatch, capsys)
