"""`pa-console serve` as a process: its tokens, its address, and an end in order."""

import json
import re
import socket
import stat
import sys
from pathlib import Path

import httpx
import pytest

from tests.cli.inside import Call
from tests.cli.outside import WITHIN_S, Start

ORDER = "Fill the gap at EastGate."


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    """Return the folder of this user's keys, which is not there yet."""
    return tmp_path / "key"


def test_a_session_is_served_to_whoever_has_the_token_and_ends_in_order(
    start: Start, keys: Path, call: Call
) -> None:
    served = start("serve", "--port", "0", "--no-alarms", terminal=True)
    served.until_shown("Ctrl-C ends the session")
    (address,) = re.findall(r"(http://\S+)/docs", served.shown)
    (token,) = re.findall(r"^(pa_\S+)", served.shown, re.MULTILINE)
    with httpx.Client(
        base_url=address, headers={"Authorization": f"Bearer {token}"}, timeout=WITHIN_S
    ) as client:
        assert client.post("/v1/missions", json={"text": ORDER}).status_code == 201
        served.until("approval_requested")
        while not (plans := client.get("/v1/plans").json()):
            pass
        (plan,) = plans
        body = {
            "kind": "approve",
            "request_id": plan["request"]["request_id"],
            "shown_sha256": plan["shown_sha256"],
        }
        assert client.post("/v1/decisions", json=body).json()["accepted"]
        served.until("command_sent")
        served.type("\x03")
        assert served.process.wait(WITHIN_S) == 0
    assert "Traceback" not in served.shown
    assert served.kinds.count("session_started") == 1
    assert "session_ended" in served.kinds[-2:]
    assert not list(keys.glob("serve-tokens*"))
    assert call("replay", str(served.log), "--verify").code == 0


@pytest.mark.parametrize("verb", [("serve", "--port", "0"), ("mcp",)])
def test_a_wrong_name_for_a_judge_on_a_server_is_refused(verb: tuple[str, ...], call: Call) -> None:
    refused = call("--set", "judge_server=nonsense", *verb)
    assert refused.code == 2
    assert "judge_server: 'nonsense' is not a model on a server" in refused.said


def test_a_token_is_made_listed_and_revoked(keys: Path, call: Call) -> None:
    made = call("serve", "--make-token", "observer", "--person", "olaf", "--json").json
    assert made["token"].startswith("pa_")
    file = keys / "serve-tokens.json"
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert made["token"] not in file.read_text()
    (row,) = call("serve", "--tokens", "--json").json["tokens"]
    assert (row["person"], row["role"]) == ("olaf", "observer")
    assert "sha256" not in row
    assert "olaf" in call("serve", "--tokens").said
    assert call("serve", "--revoke-token", row["id"]).code == 0
    assert call("serve", "--tokens", "--json").json["tokens"] == []
    gone = call("serve", "--revoke-token", row["id"])
    assert gone.code == 2
    assert "there is no token" in gone.said


def test_a_roster_says_who_may_have_a_token(keys: Path, call: Call) -> None:
    assert call("keys", "make", "ann", "--station", "here").code == 0
    assert call("keys", "make", "olaf", "--role", "observer").code == 0
    assert call("serve", "--make-token", "operator", "--person", "ann").code == 0
    refused = call("serve", "--make-token", "operator", "--person", "olaf")
    assert refused.code == 2
    assert "another role in the roster" in refused.said
    nobody = call("serve", "--make-token", "observer", "--person", "eve")
    assert nobody.code == 2
    assert "not in the roster" in nobody.said
    assert len(json.loads((keys / "serve-tokens.json").read_text())) == 1


def test_a_port_that_is_taken_is_named_with_a_remedy(keys: Path, call: Call) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        refused = call("serve", "--port", str(taken.getsockname()[1]))
    assert refused.code == 2
    assert "choose another port" in refused.said


@pytest.mark.parametrize("verb", ["serve", "mcp"])
def test_without_its_extra_an_agent_is_told_what_to_install(
    call: Call, monkeypatch: pytest.MonkeyPatch, verb: str
) -> None:
    for name in [name for name in sys.modules if name.startswith("pa_console.mcp.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(sys.modules, "pa_console.cli.sessions.agents", raising=False)
    monkeypatch.setitem(sys.modules, "mcp.server", None)
    done = call(verb, *(["--agents", "8766"] if verb == "serve" else []))
    assert (done.code, done.out) == (2, "")
    assert "[mcp]'" in done.err
