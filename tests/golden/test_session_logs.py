"""The logs of three scripted sessions are the same, byte for byte, but for times and ids."""

import tempfile
from pathlib import Path

import pytest

from tests.golden.sessions import STORIES, played
from tests.golden.stored import compare, read, write


def record() -> None:
    """Write what is so now."""
    for name in STORIES:
        with tempfile.TemporaryDirectory() as folder:
            write(_file(name), played(name, Path(folder)))


@pytest.mark.parametrize("name", STORIES)
def test_a_session_tells_the_same(name: str, tmp_path: Path) -> None:
    now = played(name, tmp_path)
    path = tmp_path / "now.txt"
    path.write_text("".join(f"{line}\n" for line in now), encoding="utf-8")
    look = f"See all: diff <(zcat tests/golden/{_file(name)}) {path}"
    compare("session_logs", read(_file(name)), now, look)


def _file(name: str) -> str:
    return f"session_logs/{name}.jsonl.gz"
