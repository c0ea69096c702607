"""Changing one setting leaves the rest of the user's file as it was, whatever happens."""

from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console import private_files
from pa_console.schema.document import DocumentError
from pa_console.schema.text import obeyed
from pa_console.settings.sources import changed_text, reset_settings, save_setting

MINE = """# my console
theme: nord   # dark rooms

keys:
  stop: f11
  # the help is elsewhere
speed: 2
"""
NAMES = st.sampled_from(("theme", "speed", "mouse", "keys", "logs"))
WORDS = st.text(st.characters().filter(lambda character: not obeyed(character)))
VALUES = st.one_of(
    st.none(), st.booleans(), st.floats(allow_nan=False), WORDS,
    st.integers(-(10**60), 10**60),
    st.dictionaries(WORDS.filter(bool), WORDS, min_size=1, max_size=3),
)  # fmt: skip


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    """A file that somebody wrote by hand."""
    path = tmp_path / "config" / "settings.yaml"
    path.parent.mkdir()
    path.write_text(MINE)
    return path


@pytest.mark.parametrize(
    ("name", "value", "before", "after"),
    [
        ("theme", "dracula", "theme: nord ", "theme: dracula "),
        ("speed", 4.0, "speed: 2\n", "speed: 4.0\n"),
        ("keys", {"stop": "f10"}, "stop: f11", "stop: f10"),
        ("mouse", False, "speed: 2\n", "speed: 2\nmouse: false\n"),
        ("speed", None, "speed: 2\n", ""),
    ],
)
def test_only_what_is_changed_is_changed(
    mine: Path, name: str, value: object, before: str, after: str
) -> None:
    save_setting(mine, name, value)
    assert mine.read_text() == MINE.replace(before, after)


def test_a_file_is_made_with_its_folder(tmp_path: Path) -> None:
    path = tmp_path / "new" / "settings.yaml"
    save_setting(path, "theme", "nord")
    assert path.read_text().startswith("#")
    assert yaml.safe_load(path.read_text()) == {"theme": "nord"}


@given(st.lists(st.tuples(NAMES, VALUES), max_size=4), st.sampled_from(("", MINE, "{theme: x}")))
@settings(max_examples=60, deadline=None)
def test_whatever_is_saved_is_read_again(changes: list[tuple[str, object]], start: str) -> None:
    text = start
    wanted: dict[str, object] = yaml.safe_load(start) or {}
    for name, value in changes:
        text = changed_text("settings.yaml", text, name, value)
        wanted = {**wanted, name: value}
    kept = {name: value for name, value in wanted.items() if value is not None}
    assert (yaml.safe_load(text) or {}) == kept


def test_a_file_that_is_no_yaml_is_not_touched(mine: Path) -> None:
    mine.write_text("theme: [")
    with pytest.raises(DocumentError):
        save_setting(mine, "theme", "nord")
    assert mine.read_text() == "theme: ["


@pytest.mark.parametrize("value", ["nord\x1b]52;c;eA==\x07", "\u202edron", 10**70])
def test_what_could_not_be_read_again_is_not_saved(mine: Path, value: object) -> None:
    with pytest.raises(DocumentError):
        save_setting(mine, "theme", value)
    assert mine.read_text() == MINE


def test_a_disk_that_refuses_leaves_the_old_file_and_nothing_else(
    mine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(private_files.os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        save_setting(mine, "theme", "dracula")
    assert mine.read_text() == MINE
    assert list(mine.parent.iterdir()) == [mine]


def test_a_linked_file_stays_linked(mine: Path, tmp_path: Path) -> None:
    link = tmp_path / "link.yaml"
    link.symlink_to(mine)
    save_setting(link, "theme", "dracula")
    assert link.is_symlink()
    assert "dracula" in mine.read_text()


def test_reset_keeps_every_old_file(mine: Path) -> None:
    first = reset_settings(mine)
    mine.write_text("speed: 3\n")
    second = reset_settings(mine)
    assert first is not None
    assert second is not None
    assert (first.read_text(), second.read_text()) == (MINE, "speed: 3\n")
    assert not mine.exists()
    assert reset_settings(mine) is None
