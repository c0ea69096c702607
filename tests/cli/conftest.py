"""The command line inside the test's own process."""

import pytest

from tests.cli.inside import Call, caller


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    """Return what runs a verb in this process."""
    return caller(monkeypatch, capsys)
