"""Logs, keys and state are for their owner alone, and no link leads a write or a key elsewhere."""

import os
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest

from pa_console.private_files import NotPrivateError, make_private_folder, open_private
from pa_console.session.log.chain import LogError
from pa_console.session.log.signed_head import head_path
from pa_console.session.log.writer import LogWriter, new_log_path
from pa_console.signing import (
    KEY_VARIABLE,
    KNOWN_FILE,
    SigningError,
    known_keys,
    load_signer,
    named_keys,
)
from pa_console.tui.kept_input import History, write_copy
from tests.session.story import story
from tests.session.tamper import MINE, write_signed


@pytest.fixture(autouse=True, params=[0o000, 0o022, 0o077], ids="umask {:03o}".format)
def _umask(request: pytest.FixtureRequest) -> Iterator[None]:  # pyright: ignore[reportUnusedFunction]
    before = os.umask(request.param)
    yield
    os.umask(before)


@pytest.fixture
def key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return where this machine's key will be."""
    path = tmp_path / "config" / "key.pem"
    monkeypatch.setenv(KEY_VARIABLE, str(path))
    return path


def mode(path: Path) -> int:
    return stat.S_IMODE(path.lstat().st_mode)


def loose(folder: Path) -> dict[str, str]:
    """Everything below `folder` that others have a right to, with its mode."""
    found = {path: mode(path) for path in folder.rglob("*")}
    return {
        str(path.relative_to(folder)): f"{bits:o}" for path, bits in found.items() if bits & 0o077
    }


def test_everything_is_made_for_its_owner_alone(tmp_path: Path, key: Path) -> None:
    signer = load_signer()
    log = new_log_path(tmp_path / "state" / "sessions", "S1")
    write_signed(log, signer=signer)
    torn = new_log_path(tmp_path / "state" / "sessions", "S2")
    torn.write_bytes(b'{"seq":1,')
    write_signed(torn, "S2", signer)
    History(tmp_path / "state" / "missions.txt").add("watch the gate")
    write_copy(tmp_path / "state" / "copies", "trace.txt", "text")
    assert log.with_name(torn.name + ".torn").is_file()
    assert key.is_file()
    assert loose(tmp_path) == {}


def test_a_log_that_others_could_read_is_taken_back(tmp_path: Path) -> None:
    log = tmp_path / "s.jsonl"
    log.touch()
    log.chmod(0o666)
    write_signed(log)
    assert loose(tmp_path) == {}


@pytest.mark.parametrize("name", ["s.jsonl", "s.jsonl.torn"])
def test_a_log_that_is_a_link_is_refused(tmp_path: Path, name: str) -> None:
    precious = tmp_path / "precious"
    precious.write_text("precious")
    log = tmp_path / "s.jsonl"
    if name.endswith(".torn"):
        log.write_bytes(b'{"seq":1,')
    log.with_name(name).symlink_to(precious)
    with pytest.raises(LogError, match="symbolic link"):
        write_signed(log)
    assert precious.read_text() == "precious"


@pytest.mark.parametrize("name", ["s.jsonl.head", "s.jsonl.head.new"])
def test_a_link_leads_no_head_elsewhere(tmp_path: Path, name: str) -> None:
    precious = tmp_path / "precious"
    (tmp_path / name).symlink_to(precious)
    write_signed(tmp_path / "s.jsonl")
    assert not precious.exists()
    assert not head_path(tmp_path / "s.jsonl").is_symlink()


def test_a_pipe_in_the_place_of_a_log_keeps_nobody_waiting(tmp_path: Path) -> None:
    log = tmp_path / "s.jsonl"
    os.mkfifo(log)
    with pytest.raises(LogError, match=r"plain file|No such device"):
        LogWriter(log, "S1", signer=MINE)


@pytest.mark.parametrize("bits", [0o644, 0o640, 0o604, 0o620, 0o660, 0o666])
def test_a_key_that_others_may_use_signs_nothing(key: Path, bits: int) -> None:
    load_signer()
    key.chmod(bits)
    for use in (load_signer, known_keys):
        with pytest.raises(SigningError, match=r"others may (read|change) it .*chmod 600") as told:
            use()
        assert str(key) in str(told.value)
    key.chmod(0o600)
    assert load_signer()


def test_a_key_behind_a_link_signs_nothing(key: Path) -> None:
    load_signer()
    elsewhere = key.with_name("elsewhere.pem")
    key.rename(elsewhere)
    key.symlink_to(elsewhere)
    for use in (load_signer, known_keys):
        with pytest.raises(SigningError, match="symbolic link"):
            use()


def test_a_key_of_another_owner_signs_nothing(key: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    load_signer()
    monkeypatch.setattr(os, "geteuid", lambda: 12345)
    with pytest.raises(SigningError, match="another user"):
        load_signer()


def test_names_of_keys_that_others_may_change_are_not_believed(key: Path) -> None:
    load_signer()
    names = key.with_name(KNOWN_FILE)
    names.write_text(f"{MINE.fingerprint} the other console\n")
    names.chmod(0o666)
    with pytest.raises(SigningError, match="others may change it"):
        named_keys()
    names.chmod(0o644)
    assert named_keys() == {MINE.fingerprint: "the other console"}


def test_folders_that_are_there_stay_as_they_are(tmp_path: Path) -> None:
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o775)
    make_private_folder(shared / "a" / "b")
    assert (mode(shared), mode(shared / "a"), mode(shared / "a" / "b")) == (0o775, 0o700, 0o700)
    with LogWriter(shared / "a" / "s.jsonl", "S1", signer=MINE) as log:
        log.append(story()[0])
    assert loose(shared) == {}


def test_a_device_is_no_private_file() -> None:
    with pytest.raises(NotPrivateError, match="plain file"):
        open_private(Path("/dev/null"), os.O_RDONLY)
