"""Runs a verb inside the test's own process: as quick as a call, with all that a user sees."""

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from pa_console.cli.main import main


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
