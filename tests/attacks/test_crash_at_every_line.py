"""A console that is killed between any two lines has sent nothing that its log lacks."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from pa_console.fleets import key_folder
from pa_console.fleets.key_folder import KeyFolder

KILLS = 24


def test_sessions_and_keys_that_are_killed_at_random_lines_go_on_whole() -> None:
    command = (sys.executable, "-m", "tests.attacks", "crash", "--count", str(KILLS))
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "sessions: 18 trials" in ended.stdout
    assert "keys: 6 trials" in ended.stdout


class KilledError(Exception):
    """The process ends here."""


def killed_at(write: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the write of that number to a file of keys, from 1, be the last that is done."""
    replace, left = key_folder.replace_private, [write]

    def replace_or_die(path: Path, content: bytes) -> None:
        replace(path, content)
        left[0] -= 1
        if left[0] == 0:
            raise KilledError

    monkeypatch.setattr(key_folder, "replace_private", replace_or_die)


@pytest.mark.parametrize("write", range(1, 6))
@pytest.mark.parametrize("change", [KeyFolder.revoke, KeyFolder.rotate])
def test_a_key_whose_change_was_interrupted_can_still_be_given_up(
    change: Callable[[KeyFolder, str], None],
    write: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    folder = KeyFolder(tmp_path)
    folder.make_site("ann", "north", {})
    folder.make_person("bob", "commander")
    before = folder.trust()
    given_up = before.roster.people["ann"].key
    with monkeypatch.context() as patch:
        killed_at(write, patch)
        try:
            change(folder, "ann")
        except KilledError:
            pass
        else:
            assert write > 3, "fewer files were written than there are steps"
    if "ann" in folder.trust().roster.people:
        change(folder, "ann")
    after = folder.trust()
    assert given_up in after.revoked
    assert given_up not in {person.key for person in after.roster.people.values()}
    assert after.roster.epoch >= before.takeover.epoch
    assert folder.take_over("north").epoch > before.takeover.epoch
