"""The hint for a missing extra fits how the program was installed."""

import sys
from pathlib import Path

import pytest

from pa_console import resources


@pytest.mark.parametrize(
    ("package", "prefix", "hint"),
    [
        ("src/pa_console", "src/.venv", ".venv/bin/pip install --editable '.[mcap]'"),
        ("lib/pa_console", "pipx/venvs/pa-console", "pipx runpip pa-console install "),
        ("lib/pa_console", "venv", "pip install 'pa-console[mcap]'"),
    ],
)
def test_the_command_fits_a_clone_pipx_and_pip(
    package: str, prefix: str, hint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "src").mkdir()
    (tmp_path / "src" / "pyproject.toml").touch()
    monkeypatch.setattr(resources, "_PACKAGE", tmp_path / package)
    monkeypatch.setattr(sys, "prefix", str(tmp_path / prefix))
    assert resources.install_hint("mcap").startswith(hint)
