"""The verbs, their options, how calls end, and the shapes of what `--json` prints are the same."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.golden.command_line_calls import CALLS, Caller, declared
from tests.golden.stored import compare, read, write

pytestmark = [pytest.mark.long, pytest.mark.timeout(1200)]

FILE = "command_line.json"
TO_RECORD = "PA_GOLDEN_RECORD"


def record() -> None:
    """Write what is so now; the calls are made where the tests make them."""
    names = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", __file__]
    subprocess.run(names, check=True, env={**os.environ, TO_RECORD: "1"})


def test_verbs_options_ends_and_shapes_are_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PA_CONSOLE_SIGNING_KEY", str(tmp_path / "key" / "key.pem"))
    monkeypatch.setenv("COLUMNS", "100")
    caller = Caller(tmp_path, monkeypatch, capsys)
    calls = {" ".join(words): caller.told(words) for words in CALLS}
    now: dict[str, Any] = json.loads(json.dumps({"verbs": declared(), "calls": calls}))
    if TO_RECORD in os.environ:
        write(FILE, now)
    compare("command_line", read(FILE), now, f"The stored ones are in tests/golden/{FILE}.")
