"""A model on a server: its ways are probed, its answers checked, its faults told in words."""

import asyncio
import json
import traceback
from collections.abc import AsyncGenerator
from contextlib import aclosing, asynccontextmanager

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.llm.backend import GenerationEnd, Request, ServerError
from pa_console.llm.remote.address import KEY_VARIABLE, ServerAddress, ServerKey
from pa_console.llm.remote.client import ServerClient
from pa_console.llm.remote.engine import WAYS, ServerEngine, Way, read_answer
from pa_console.llm.roles.grammar import plan_schema, verdict_schema
from pa_console.llm.roles.planner import Planner, read_plan
from pa_console.llm.roles.prompts import Prompt
from pa_console.schema.events.event import ServerState
from tests.llm.servers.fault_proxy import FaultProxy
from tests.llm.site import WORLD, picture

SCHEMA = plan_schema(WORLD, picture())
CANARY = "sk-canary-4711"


def request(deadline_s: float = 20.0, count: int = 1) -> Request:
    words = "Send somebody to HillGate."
    return Request("planner", "system", words, "start: x", 300, deadline_s, count, schema=SCHEMA)


@asynccontextmanager
async def serving(
    proxy: FaultProxy, *, patience_s: float = 20.0, again_s: float = 0.001, secret: str = ""
) -> AsyncGenerator[tuple[ServerEngine, asyncio.Queue[tuple[ServerState, str]]]]:
    """An engine on `proxy` that was probed, and the changes of its state from then on."""
    async with proxy.running():
        address = ServerAddress.parse(proxy.address)
        key = ServerKey("here", secret)
        engine = ServerEngine(
            address, key, patience_s=patience_s, again_s=again_s, chances=proxy.chances
        )
        changes: asyncio.Queue[tuple[ServerState, str]] = asyncio.Queue()
        engine.on_state = lambda state, detail: changes.put_nowait((state, detail))
        await engine.start()
        try:
            while (await changes.get())[0] == "probing":
                pass
            yield engine, changes
        finally:
            await engine.close()


async def answered(engine: ServerEngine, asked: Request) -> tuple[str, GenerationEnd]:
    """Return the pieces joined, and the end."""
    pieces, end = "", None
    async with aclosing(engine.generate(asked)) as items:
        async for item in items:
            if isinstance(item, GenerationEnd):
                end = item
            else:
                pieces += item
    assert end is not None
    return pieces, end


@pytest.mark.parametrize("way", [way for way in WAYS if way != "grammar"])
async def test_the_way_that_holds_is_found_and_used(way: Way) -> None:
    async with serving(FaultProxy(holds=(way,))) as (engine, _):
        assert engine.state == "ready"
        assert engine.report.way == way
        assert {found for other, found in engine.report.ways.items() if other != way} == {"ignored"}
        streamed, end = await answered(engine, request())
        plan, _ = read_plan(end.text)
        assert plan is not None
        assert plan.reason == "as asked"
        assert streamed == end.text


async def test_a_way_that_is_refused_is_not_used_and_the_next_one_is() -> None:
    proxy = FaultProxy(holds=("guided_json",), refuses=("json_schema", "json_object"))
    async with serving(proxy) as (engine, _):
        assert engine.report.ways["json_schema"] == "refused (400)"
        assert engine.report.way == "guided_json"
        await answered(engine, request())
        assert "guided_json" in proxy.bodies[-1]


async def test_a_server_that_holds_nothing_is_told_and_its_answers_are_read_all_the_same() -> None:
    proxy = FaultProxy(holds=())
    async with serving(proxy) as (engine, _):
        assert engine.state == "unconstrained"
        assert "requested again" in engine.detail
        proxy.answers = ["I think so.", 'Sure! ```{"reason": "go", "actions": []}```']
        _, end = await answered(engine, request())
        assert read_plan(end.text)[0] is not None
        assert "could not be read" in proxy.bodies[-1]["messages"][-1]["content"]


async def test_chances_are_those_that_the_server_tells() -> None:
    async with serving(FaultProxy()) as (engine, _):
        _, end = await answered(engine, request())
        assert end.chances[1] == (6, -0.1)
    async with serving(FaultProxy(chances=False)) as (engine, _):
        _, end = await answered(engine, request())
        assert end.chances == ()


async def test_chances_of_a_text_that_was_cut_out_are_not_known() -> None:
    proxy = FaultProxy()
    async with serving(proxy) as (engine, _):
        proxy.answers = ['Here: {"reason": "go", "actions": []}']
        _, end = await answered(engine, request())
        assert end.text.startswith("{")
        assert end.chances == ()


async def test_no_other_answers_are_told() -> None:
    async with serving(FaultProxy()) as (engine, _):
        _, end = await answered(engine, request(count=4))
        assert end.texts == ()


@pytest.mark.parametrize(
    ("faults", "why"),
    [
        (["hang"], "gave no complete answer within"),
        (["drip"], "gave no complete answer within"),
        (["cut"], "broke off"),
        (["truncated", "truncated"], "no readable answer"),
        (["wrong form", "wrong form"], "no readable answer"),
        (["429"] * 3, "answered 429"),
        (["500"] * 3, "answered 500"),
        (["401"], "answered 401"),
        (["redirect"], "answered 307"),
    ],
)
async def test_a_fault_is_told_and_the_server_looked_at_again(faults: list[str], why: str) -> None:
    proxy = FaultProxy()
    patience_s = 0.3 if faults[0] in ("hang", "drip") else 20.0
    async with serving(proxy, patience_s=patience_s) as (engine, changes):
        proxy.faults = list(faults)  # type: ignore[assignment]
        with pytest.raises(ServerError, match=why):
            await answered(engine, request())
        state, detail = await changes.get()
        assert state == "away"
        assert why in detail
        assert (await changes.get())[0] == "ready"
        _, end = await answered(engine, request())
        assert read_plan(end.text)[0] is not None


@pytest.mark.parametrize("fault", ["429", "500"])
async def test_what_is_safe_to_repeat_is_repeated(fault: str) -> None:
    proxy = FaultProxy()
    async with serving(proxy) as (engine, changes):
        proxy.faults = [fault]  # type: ignore[list-item]
        _, end = await answered(engine, request())
        assert end.finish == "stop"
        assert changes.empty()


async def test_a_question_that_is_not_taken_says_nothing_about_the_server() -> None:
    proxy = FaultProxy()
    async with serving(proxy) as (engine, changes):
        proxy.faults = ["400"]
        with pytest.raises(ServerError, match="answered 400"):
            await answered(engine, request())
        assert engine.usable
        assert changes.empty()


async def test_who_leaves_an_answer_stops_it() -> None:
    proxy = FaultProxy()
    async with serving(proxy) as (engine, _):
        proxy.faults = ["hang"]
        asked = asyncio.create_task(answered(engine, request()))
        await proxy.hung.wait()
        asked.cancel()
        await asyncio.wait_for(proxy.left.wait(), 300.0)
        assert engine.usable


async def test_a_server_that_is_not_there_is_away_and_comes_back() -> None:
    proxy = FaultProxy()
    async with proxy.running():
        address = ServerAddress.parse(proxy.address)
    client = ServerClient(address, ServerKey(), retries=0)
    engine = ServerEngine(address, ServerKey(), client=client)
    await engine.look()
    assert (engine.state, engine.detail) == ("away", "cannot be reached")
    with pytest.raises(ServerError, match="cannot be reached"):
        await answered(engine, request())
    async with proxy.running(proxy.port):
        await engine.look()
        assert engine.state == "ready"
        await engine.close()


async def test_the_key_is_sent_to_the_server_and_told_to_nobody(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", "sk-of-another-service")
    monkeypatch.setenv("OPENAI_ORG_ID", "org-of-another-service")
    caplog.set_level(0)
    proxy = FaultProxy()
    async with serving(proxy, secret=CANARY) as (engine, changes):
        proxy.faults = ["401"]
        with pytest.raises(ServerError) as failed:
            await answered(engine, request())
        whole = traceback.TracebackException.from_exception(failed.value, capture_locals=True)
        told = [str(failed.value), *whole.format(), repr(engine), repr(await changes.get())]
        told += [repr(vars(engine)), caplog.text]
    assert any(CANARY in head for head in proxy.heads)
    assert not any(CANARY in text for text in told)
    assert not any("another-service" in head for head in proxy.heads)
    assert "[key]" in str(failed.value)


async def test_without_a_key_none_is_sent() -> None:
    proxy = FaultProxy()
    async with serving(proxy):
        pass
    assert proxy.heads
    assert not any("authorization" in head.lower() for head in proxy.heads)


def test_a_key_is_found_in_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    address = ServerAddress.parse("openai:https://models.example/v1#m")
    monkeypatch.setenv(KEY_VARIABLE, CANARY)
    found = ServerKey.find(address)
    assert (found.source, found.secret) == (KEY_VARIABLE, CANARY)
    assert CANARY not in repr(found)


async def test_a_planner_on_a_server_names_the_fault_in_its_proposal() -> None:
    proxy = FaultProxy()
    async with serving(proxy, patience_s=0.2) as (engine, _):
        proxy.faults = ["hang"]
        proposal = await Planner(engine).plan(Prompt("s", "u"), "", schema=SCHEMA)
        assert proposal.plan is None
        assert proposal.fatal
        assert "no complete answer" in proposal.error


@given(st.text(alphabet='{}[]":, aR5') | st.text())
def test_whatever_a_server_writes_is_read_or_refused(text: str) -> None:
    schema = plan_schema(WORLD, picture())
    answer, wrong = read_answer(text, schema)
    assert bool(answer) != bool(wrong)
    assert answer in text
    for around in ("", "Sure: ", "```json\n"):
        plan = '{"reason": "go", "actions": []}'
        assert read_answer(around + plan + text, schema) == (plan, "")


def test_an_answer_is_what_meets_the_schema_and_nothing_else() -> None:
    schema = verdict_schema(["WF-01"])
    good = {
        "rules": [{"id": "WF-01", "verdict": "complies"}],
        "feedback": "fits",
        "verdict": "Success",
    }
    assert read_answer(json.dumps(good), schema) == (json.dumps(good), "")
    for name in good:
        text, wrong = read_answer(json.dumps({k: v for k, v in good.items() if k != name}), schema)
        assert text == ""
        assert name in wrong
    assert read_answer("{" * 5000, schema)[0] == ""
    assert read_answer('{"a": ' * 5000, schema)[0] == ""
