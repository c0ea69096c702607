"""The verbs of training inside the test's own process."""

import pytest

from pa_console.cli.main import run
from pa_training.__main__ import NAME, app
from tests.cli.inside import Call, caller


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    """Return what runs a verb of training in this process."""
    return caller(monkeypatch, capsys, lambda: run(app, NAME))
