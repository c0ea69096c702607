"""The shipped checkpoint, loaded once, and the benchmarks inside the test's own process."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from pa_console.cli.main import run
from pa_console.signing import KEY_VARIABLE
from pa_console.station.assembly import Site, load_site
from tests.benchmarks.__main__ import NAME, app
from tests.cli.inside import Done, caller


@dataclass(frozen=True)
class Measured(Done):
    """The exit status and output of a benchmark, and the file of its figures."""

    file: Path

    @property
    def figures(self) -> Any:
        """The figures that were kept."""
        return json.loads(self.file.read_text(encoding="utf-8"))


Measure = Callable[..., Measured]


@pytest.fixture(autouse=True)
def _a_key_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:  # pyright: ignore[reportUnusedFunction]
    """Keep a test from making or using the key of this machine's user."""
    monkeypatch.setenv(KEY_VARIABLE, str(tmp_path / "key" / "key.pem"))


@pytest.fixture(scope="session")
def site() -> Site:
    """Return the checkpoint with its rules."""
    return load_site("checkpoint", "checkpoint")


@pytest.fixture
def bench(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path_factory: pytest.TempPathFactory,
) -> Measure:
    """Return a function that runs a benchmark in this process, with its figures in a test file."""
    call = caller(monkeypatch, capsys, lambda: run(app, NAME))
    file = tmp_path_factory.mktemp("figures") / "figures.json"

    def measure(*words: str) -> Measured:
        file.unlink(missing_ok=True)
        done = call(*words, "--json", str(file))
        return Measured(done.code, done.out, done.err, file)

    return measure
