"""The command line inside the test's own process."""

from pathlib import Path

import pytest

from pa_console.cli.sessions import mission as mission_session
from pa_console.cli.sessions import opening
from pa_console.llm.models.catalogue import LocalModel
from pa_console.signing import KEY_VARIABLE
from tests.cli.inside import Call, caller
from tests.scripted import ScriptedEngine, plan

FILL = plan(("Drone_T04", "move_to EastGate"))
"""A plan that every rule admits."""


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

    def find_model(_: str | None, *_progress: object, **_reader: str) -> LocalModel:
        return scripted.model

    def new_engine(_: LocalModel, **_options: bool) -> ScriptedEngine:
        return scripted

    for verb in (mission_session, opening):
        monkeypatch.setattr(verb, "find_model", find_model)
        monkeypatch.setattr(verb, "Engine", new_engine)
    return scripted
