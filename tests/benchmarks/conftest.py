"""The shipped checkpoint, loaded once, and the benchmarks inside the test's own process."""

from pathlib import Path

import pytest

from pa_console.signing import KEY_VARIABLE
from pa_console.station.assembly import Site, load_site
from tests.benchmarks.inside import Measure, measurer


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
    """Return what runs a benchmark in this process."""
    return measurer(monkeypatch, capsys, tmp_path_factory.mktemp("figures"))
