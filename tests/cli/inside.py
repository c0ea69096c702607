"""Runs a verb inside the test's own process: as quick as a call, with all that a user sees."""

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from pa_console.cli.main import main
from pa_console.cli.sessions import mission, opening
from pa_console.llm.models.catalogue import LocalModel
from tests.scripted import ScriptedEngine, plan

FILL = plan(("Drone_T04", "move_to EastGate"))
"""A plan that every rule admits."""


@dataclass(frozen=True)
class Done:
    """What a verb left behind."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """The document on stdout; raises ValueError when it is not exactly one."""
        return json.loads(self.out)

    @property
    def said(self) -> str:
        """Both streams, with line breaks as blanks: the terminal's width breaks lines."""
        return " ".join((self.out + self.err).split())


Call = Callable[..., Done]


def answer_with(engine: ScriptedEngine, monkeypatch: pytest.MonkeyPatch) -> None:
    """Put `engine` in the place of the model of a mission and of a console."""

    def find_model(_: str | None, *_progress: object, **_reader: str) -> LocalModel:
        return engine.model

    def new_engine(_: LocalModel, **_options: bool) -> ScriptedEngine:
        return engine

    for session in (mission, opening):
        monkeypatch.setattr(session, "find_model", find_model)
        monkeypatch.setattr(session, "Engine", new_engine)


def caller(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    program: Callable[[], None] = main,
) -> Call:
    """Return what runs `program` with the words given and reports how it ended."""

    def call(*words: str) -> Done:
        monkeypatch.setattr(sys, "argv", ["pa-console", *words])
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            program()
        printed = capsys.readouterr()
        assert "internal error" not in printed.err
        assert "Traceback" not in printed.out + printed.err
        assert isinstance(ended.value.code, int)
        return Done(ended.value.code, printed.out, printed.err)

    return call
