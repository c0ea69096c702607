"""Nothing of the user's is read or written, and screens look the same everywhere."""

from pathlib import Path

import pytest
from textual.notifications import Notification

from tests.tui.scripted import Show


@pytest.fixture(autouse=True)
def _plain_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TEXTUAL_ANIMATIONS", "none")
    monkeypatch.setenv("COLORTERM", "truecolor")


@pytest.fixture(autouse=True)
def _lasting_notices(monkeypatch: pytest.MonkeyPatch) -> None:
    """A notice stays for as long as a test takes, however slow the machine is."""
    monkeypatch.setattr(Notification, "time_left", 3600.0)


@pytest.fixture
def show(tmp_path: Path) -> Show:
    """Return what opens consoles; `async with` yields an `Opened`, at the first settled picture."""
    return Show(tmp_path)
