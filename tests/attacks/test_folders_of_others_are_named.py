"""Folders of logs and keys that others can use are named by `doctor`, with the remedy."""

from pathlib import Path

import pytest

from pa_console.cli.verbs.doctor.checks import check_folders
from pa_console.fleets.key_folder import KeyFolder
from pa_console.settings.sources import load_settings
from pa_console.signing import KEY_VARIABLE, load_signer, site_keys


def doctor_says(name: str) -> tuple[str, str, str]:
    """Return what `doctor` reports of the folder called `name`: state, finding and remedy."""
    (found,) = (check for check in check_folders(load_settings()) if check.name == name)
    return found.state, found.found, found.remedy


@pytest.fixture
def key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return this machine's key."""
    path = tmp_path / "config" / "key.pem"
    monkeypatch.setenv(KEY_VARIABLE, str(path))
    load_signer()
    return path


@pytest.fixture(autouse=True)
def logs(tmp_path: Path, key: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of logs of the settings, which is private."""
    folder = tmp_path / "home" / "logs"
    folder.mkdir(parents=True)
    folder.chmod(0o700)
    monkeypatch.setenv("PA_CONSOLE_LOGS", str(folder))
    return folder


def test_private_folders_are_no_remark() -> None:
    for name in ("log folder", "signing key"):
        state, _, remedy = doctor_says(name)
        assert (state, remedy) == ("ok", "")


@pytest.mark.parametrize("bits", [0o755, 0o770, 0o777])
def test_doctor_names_a_folder_of_logs_that_others_can_use(bits: int, logs: Path) -> None:
    logs.chmod(bits)
    state, found, remedy = doctor_says("log folder")
    assert (state, remedy) == ("warning", f"chmod 700 '{logs}'")
    assert f"{logs}: others may {'write there' if bits & 0o22 else 'look into it'}" in found
    assert f"mode {bits:04o}" in found


def test_doctor_names_where_the_folder_of_logs_leads(logs: Path) -> None:
    open_to_all = logs.parent / "shared"
    open_to_all.mkdir()
    open_to_all.chmod(0o777)
    logs.rmdir()
    logs.symlink_to(open_to_all)
    state, found, remedy = doctor_says("log folder")
    assert (state, remedy) == ("warning", f"chmod 700 '{open_to_all}'")
    assert f"{logs} is a link to {open_to_all}: others may write there (mode 0777)" in found
    inside = open_to_all / "logs"
    inside.mkdir(mode=0o700)
    logs.unlink()
    logs.symlink_to(inside)
    state, found, remedy = doctor_says("log folder")
    assert (state, remedy) == ("warning", f"chmod o-w '{open_to_all}'")
    assert f"others may put another folder in its place: they may write to {open_to_all}" in found
    open_to_all.chmod(0o1777)
    assert doctor_says("log folder")[0] == "ok"


@pytest.mark.parametrize("name", ["signing key", "site keys"])
def test_doctor_names_a_folder_of_keys_that_others_can_write(name: str, key: Path) -> None:
    KeyFolder().make_site("ann", "here", {})
    folder = key.parent if name == "signing key" else site_keys()
    assert doctor_says(name)[0] == "ok"
    for bits in (0o770, 0o707, 0o777):
        folder.chmod(bits)
        state, found, remedy = doctor_says(name)
        assert (state, remedy) == ("warning", f"chmod 700 '{folder}'")
        assert "others may write there" in found
    folder.chmod(0o755)
    assert doctor_says(name)[0] == "ok"
