"""The command line inside the test's own process."""

from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

from pa_console.signing import KEY_VARIABLE
from tests.cli.inside import FILL, Call, answer_with, caller
from tests.cli.outside import Outside, Start
from tests.scripted import ScriptedEngine


@pytest.fixture(autouse=True)
def _a_key_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:  # pyright: ignore[reportUnusedFunction]
    """Keep a test from making or using the key of this machine's user."""
    monkeypatch.setenv(KEY_VARIABLE, str(tmp_path / "key" / "key.pem"))


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    """Return what runs a verb in this process."""
    return caller(monkeypatch, capsys)


@pytest.fixture
def engine(monkeypatch: pytest.MonkeyPatch) -> ScriptedEngine:
    """Put a scripted LLM in the place of the real one."""
    scripted = ScriptedEngine([FILL])
    answer_with(scripted, monkeypatch)
    return scripted


@pytest.fixture
def start(tmp_path: Path) -> Generator[Start]:
    """Return what starts a `pa-console` as a process, which is ended after the test."""
    started: list[Outside] = []

    def begin(*words: str, **options: Any) -> Outside:
        started.append(Outside(tmp_path, *words, **options))
        return started[-1]

    yield begin
    for program in started:
        program.close()
