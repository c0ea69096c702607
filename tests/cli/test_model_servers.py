"""`doctor` probes the servers that are named, `mission` says who answers; nobody tells the key."""

import asyncio
from datetime import UTC, datetime

import pytest

from pa_console.cli.verbs.doctor import check_server, check_servers, named_models
from pa_console.cli.verbs.doctor_checks import Check
from pa_console.llm.remote.address import KEY_VARIABLE
from pa_console.schema.events import event as ev
from pa_console.settings.schema import Settings
from pa_console.terminal.mission import step_line
from tests.llm.servers.fault_proxy import FaultProxy

CANARY = "sk-canary-4711"


async def looked(proxy: FaultProxy) -> Check:
    async with proxy.running():
        return await asyncio.to_thread(check_server, "planner", proxy.address)


async def test_what_holds_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(KEY_VARIABLE, CANARY)
    check = await looked(FaultProxy(holds=("guided_json",)))
    assert check.state == "ok"
    assert "guided_json holds" in check.found
    assert f"key from {KEY_VARIABLE}" in check.found
    assert CANARY not in repr(check)


async def test_that_nothing_holds_is_a_warning() -> None:
    check = await looked(FaultProxy(holds=()))
    assert check.state == "warning"
    assert "nothing holds answers" in check.found


async def test_a_server_that_is_away_is_a_warning() -> None:
    proxy = FaultProxy()
    proxy.faults = ["401"]
    check = await looked(proxy)
    assert (check.state, "answered 401" in check.found) == ("warning", True)
    assert KEY_VARIABLE in check.remedy


def test_a_server_elsewhere_without_https_is_not_asked() -> None:
    check = check_server("planner", "openai:http://10.0.0.5/v1#m")
    assert check.state == "missing"
    assert "plain_servers" in check.found


def test_nobody_is_asked_where_no_server_is_named() -> None:
    assert list(check_servers(named_models(Settings()), Settings())) == []


def test_a_judge_that_is_no_server_is_told() -> None:
    settings = Settings(judge_server="pa-500m")
    (check,) = check_servers(named_models(settings), settings)
    assert check.state == "missing"


def test_whoever_follows_a_mission_is_told_who_answers() -> None:
    changed = ev.ServerChanged(
        server="openai:http://127.0.0.1/v1#m", serves=("planner",), state="away", detail="is gone"
    )
    took_over = ev.Noticed(level="warning", subject="model server", text="the own model answers")
    lines = [
        step_line(ev.Event(t=datetime.now(UTC), tick=0, data=data)) for data in (changed, took_over)
    ]
    assert lines[0] == "model server: openai:http://127.0.0.1/v1#m away: is gone"
    assert lines[1] == "model server: the own model answers"
