"""The server of llama-cpp-python: what holds on it is found; a cut of its answer is noticed."""

import json
from contextlib import aclosing

import pytest

from pa_console.llm.backend import ServerError
from pa_console.llm.remote.address import ServerAddress, ServerKey
from pa_console.llm.remote.client import ServerClient
from pa_console.llm.remote.engine import WAYS, Way, probe, read_answer
from pa_console.llm.roles.grammar import Schema, plan_schema
from tests.llm.servers.fault_proxy import FaultProxy
from tests.llm.site import WORLD, picture

ONE: Schema = {
    "type": "object",
    "properties": {
        "actions": plan_schema(WORLD, picture())["properties"]["actions"],
        "verdict": {"type": "string", "enum": ["Success", "Failure"]},
    },
    "required": ["actions", "verdict"],
    "additionalProperties": False,
}
"""A schema of everything but text without end, which a model of two layers does not end."""


@pytest.fixture
def client(llama_server: int) -> ServerClient:
    address = ServerAddress.parse(f"openai:http://127.0.0.1:{llama_server}#shallow")
    return ServerClient(address, ServerKey(), retries=0)


async def test_what_holds_on_it_is_found(client: ServerClient) -> None:
    report = await probe(client, 60.0)
    await client.close()
    assert report.ways["json_object"] == report.ways["grammar"] == "works"
    assert report.ways["guided_json"] == report.ways["structured_outputs"] == "ignored"
    assert report.way == "json_object"
    assert report.chances


@pytest.mark.parametrize("way", ["json_object", "grammar"])
async def test_an_answer_is_held_to_its_form(client: ServerClient, way: Way) -> None:
    text = ""
    extra = WAYS[way](ONE)
    async with aclosing(client.ask("", "Plan.", 200, 60.0, extra)) as pieces:
        async for piece in pieces:
            text += piece.text
    await client.close()
    assert read_answer(text, ONE) == (text.strip(), "")
    if way == "grammar":
        assert text == json.dumps(json.loads(text)), "spaced as prompts show it"


async def test_behind_a_proxy_that_cuts_it_is_not_trusted(llama_server: int) -> None:
    proxy = FaultProxy(upstream=("127.0.0.1", llama_server))
    async with proxy.running():
        client = ServerClient(ServerAddress.parse(proxy.address), ServerKey(), retries=0)
        pieces = [piece async for piece in client.ask("", "Say hello.", 4, 60.0, {})]
        assert pieces[-1].finish
        proxy.faults = ["cut"]
        with pytest.raises(ServerError, match="broke off"):
            _ = [piece async for piece in client.ask("", "Say hello.", 4, 60.0, {})]
        await client.close()
