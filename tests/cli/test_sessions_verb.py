"""`pa-console sessions`, and what plays a session back by its name."""

from pathlib import Path

import pytest

from tests.cli.inside import Call

SEND = ("Move the drone to the east gate.", "--approve", "auto", "--json")


@pytest.mark.usefixtures("engine")
def test_a_session_is_listed_shown_and_verified_by_its_name(call: Call, tmp_path: Path) -> None:
    logs = ("--set", f"logs={tmp_path / 'logs'}", "--set", "standing_confidence=0")
    assert "no recorded sessions" in call(*logs, "sessions").said
    done = call(*logs, "mission", *SEND).json
    (listed,) = call(*logs, "sessions", "--json").json
    assert listed["title"] == done["mission"]["mission"]["text"]
    assert listed["outcomes"] == {done["mission"]["status"]: 1}
    assert (listed["standing"], listed["ending"]) == ("verified", "closed")
    assert listed["log"] == done["log"]
    assert listed["session"] in call(*logs, "sessions").said
    shown = call(*logs, "sessions", "last")
    assert f"pa-console replay {listed['session']}" in shown.said
    copy = tmp_path / "a copy.jsonl"
    copy.write_bytes(Path(listed["log"]).read_bytes())
    assert f"pa-console replay '{copy}'" in call(*logs, "sessions", str(copy)).said
    assert call(*logs, "sessions", listed["session"], "--json").json == listed
    for named in (["--last"], [listed["session"]], [listed["log"]]):
        again = call(*logs, "replay", *named, "--verify", "--chain-only", "--json")
        assert (again.code, again.json["intact"]) == (0, True)


def test_a_session_that_is_not_there_is_an_error(call: Call, tmp_path: Path) -> None:
    logs = ("--set", f"logs={tmp_path / 'logs'}")
    for words in (("sessions", "gone"), ("replay", "gone"), ("replay", "--last")):
        done = call(*logs, *words)
        assert done.code == 2
        assert "there is no session" in done.said
    done = call(*logs, "replay", "gone", "--last")
    assert (done.code, "or --last" in done.said) == (2, True)
