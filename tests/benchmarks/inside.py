"""Runs a benchmark inside the test's own process, with its figures in a file of the test's own."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from pa_console.cli.main import run
from tests.benchmarks.__main__ import NAME, app
from tests.cli.inside import Done, caller


@dataclass(frozen=True)
class Measured(Done):
    """A benchmark's end and output, and the file of its figures."""

    file: Path

    @property
    def figures(self) -> Any:
        """The figures that were kept."""
        return json.loads(self.file.read_text(encoding="utf-8"))


Measure = Callable[..., Measured]


def measurer(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], folder: Path
) -> Measure:
    """Return what runs a benchmark with the words given and keeps its figures in `folder`."""
    call = caller(monkeypatch, capsys, lambda: run(app, NAME))
    file = folder / "figures.json"

    def measure(*words: str) -> Measured:
        file.unlink(missing_ok=True)
        done = call(*words, "--json", str(file))
        return Measured(done.code, done.out, done.err, file)

    return measure
