"""`pa-console replay A --compare B`: 0 for the same, 1 for different, 2 for unreadable."""

from pathlib import Path

import pytest

from pa_console.schema.events import event as ev
from pa_console.session.log.writer import LogWriter
from tests.cli.inside import Call
from tests.session.story import PLAN, story


@pytest.fixture(autouse=True)
def _cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:  # pyright: ignore[reportUnusedFunction]
    monkeypatch.setenv("PA_CONSOLE_CACHE", str(tmp_path / "cache"))


def written(path: Path, session: str, events: list[ev.Event]) -> str:
    with LogWriter(path, session) as writer:
        for event in events:
            writer.append(event)
    return str(path)


def changed() -> list[ev.Event]:
    """The story with another plan."""
    told = story()
    place = next(n for n, event in enumerate(told) if event.data.kind == "plan_proposed")
    data = told[place].data.model_copy(update={"plan": PLAN.model_copy(update={"reason": "why"})})
    told[place] = told[place].model_copy(update={"data": data})
    return told


def test_two_sessions_that_tell_the_same_are_the_same(call: Call, tmp_path: Path) -> None:
    a = written(tmp_path / "a.jsonl", "S1", story())
    b = written(tmp_path / "b.jsonl", "S2", story())
    done = call("replay", a, "--compare", b)
    assert done.code == 0, done.err
    assert "the same: 16 events" in done.said
    assert call("replay", a, "--compare", b, "--json").json["same"] is True


def test_the_first_difference_is_printed_with_both_values(call: Call, tmp_path: Path) -> None:
    a = written(tmp_path / "a.jsonl", "S1", story())
    b = written(tmp_path / "b.jsonl", "S2", changed())
    done = call("replay", a, "--compare", b)
    assert done.code == 1
    assert "first difference A event 7" in done.said
    assert "plan.reason: look at the gate | why" in done.said
    shown = call("replay", a, "--compare", b, "--json")
    assert shown.code == 1
    assert shown.json["first"]["changes"][0]["path"] == "plan.reason"


def test_a_log_that_cannot_be_read_is_neither(call: Call, tmp_path: Path) -> None:
    a = written(tmp_path / "a.jsonl", "S1", story())
    rubbish, short = tmp_path / "rubbish.jsonl", tmp_path / "short.jsonl"
    rubbish.write_text("rubbish\n")
    short.write_bytes(Path(a).read_bytes() + b"rubbish\n")
    missing = tmp_path / "missing.jsonl"
    for other, named in ((rubbish, ":1:"), (short, ":17:"), (missing, "no such log")):
        done = call("replay", a, "--compare", str(other))
        assert done.code == 2
        assert named in done.err
