"""The verbs of training inside the test's own process.

Tests of the trainer itself need the extra `train`; without it they are not collected.
"""

from importlib.util import find_spec

import pytest

from pa_console.cli.main import run
from pa_training.__main__ import NAME, app
from pa_training.verbs.run import NEEDED
from tests.cli.inside import Call, caller

collect_ignore = [] if all(map(find_spec, NEEDED)) else ["adapters"]


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    """Return what runs a verb of training in this process."""
    return caller(monkeypatch, capsys, lambda: run(app, NAME))
