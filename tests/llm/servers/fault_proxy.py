"""A server of the OpenAI interface that goes wrong as told, or passes on to a real one.

Without an `upstream` it plays a server that holds answers to a schema in the ways that it is told.
"""

import asyncio
import json
from collections.abc import AsyncGenerator, Callable, Collection, Sequence
from contextlib import asynccontextmanager, suppress
from typing import Any, Literal, cast

Fault = Literal[
    "hang", "cut", "truncated", "wrong form", "429", "500", "401", "400", "drip", "redirect"
]
DRIP_S = 0.005
"""Between two bytes of a slow drip."""
GREETING = "Hello! How can I help you today?"
SCHEMAS: dict[str, Callable[[dict[str, Any]], Any]] = {
    "json_schema": lambda body: _format(body, "json_schema").get("json_schema", {}).get("schema"),
    "json_object": lambda body: _format(body, "json_object").get("schema"),
    "structured_outputs": lambda body: body.get("structured_outputs", {}).get("json"),
    "guided_json": lambda body: body.get("guided_json"),
    "format": lambda body: body.get("format"),
}
"""Where each way has its schema in a request."""


def _format(body: dict[str, Any], kind: str) -> dict[str, Any]:
    given: dict[str, Any] = body.get("response_format", {})
    return given if given.get("type") == kind else {}


def instance(schema: Any, choice: int = 0) -> Any:
    """Return the smallest value that meets `schema`, its words those at `choice`."""
    match schema:
        case {"anyOf": ways}:
            return instance(ways[choice], choice)
        case {"enum": words}:
            return words[choice]
        case {"type": "array", "items": items, "minItems": least}:
            return [instance(items, choice)] * int(least)
        case {"properties": properties}:
            fields = cast(dict[str, Any], properties)
            return {name: instance(value, choice) for name, value in fields.items()}
        case _:
            return "as asked"


class FaultProxy:
    """Answers requests for chats; the first of `faults` happens to each, then none any more."""

    def __init__(
        self,
        *,
        holds: Collection[str] = ("json_schema",),
        refuses: Collection[str] = (),
        chances: bool = True,
        choice: int = 0,
        upstream: tuple[str, int] | None = None,
    ) -> None:
        """It holds answers to a schema in the ways of `holds`, and answers 400 to those it refuses.

        All other ways it ignores. Of the words that it may write it takes those at `choice`.
        """
        self._choice = choice
        self.holds, self.refuses, self.chances, self.upstream = holds, refuses, chances, upstream
        self.faults: list[Fault] = []
        self.answers: list[str] = []
        """What it says to questions with a schema, one after the other; then what meets it."""
        self.bodies: list[dict[str, Any]] = []
        self.heads: list[str] = []
        """The headers of all requests."""
        self.left = asyncio.Event()
        """Set when somebody did not wait for the end of an answer."""
        self.hung = asyncio.Event()
        """Set when somebody waits for an answer that never comes."""
        self.port = 0

    @property
    def address(self) -> str:
        """The address of its model."""
        return f"openai:http://127.0.0.1:{self.port}/v1#a/model"

    @asynccontextmanager
    async def running(self, port: int = 0) -> AsyncGenerator["FaultProxy"]:
        """Listen on loopback until this is left; connections are cut then."""
        connections = set[asyncio.Task[None]]()

        async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            task = asyncio.current_task()
            assert task is not None
            connections.add(task)
            try:
                with suppress(ConnectionError, asyncio.IncompleteReadError):
                    await self._serve(reader, writer)
            finally:
                connections.discard(task)
                writer.close()

        server = await asyncio.start_server(serve, "127.0.0.1", port)
        self.port = int(server.sockets[0].getsockname()[1])
        try:
            yield self
        finally:
            server.close()
            for task in list(connections):
                task.cancel()
            await asyncio.gather(*connections, return_exceptions=True)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = await reader.readuntil(b"\r\n\r\n")
        lines = head.decode().splitlines()
        self.heads.append(head.decode())
        length = next(int(line[15:]) for line in lines if line.lower().startswith("content-length"))
        raw = await reader.readexactly(length)
        body: dict[str, Any] = json.loads(raw)
        self.bodies.append(body)
        fault = self.faults.pop(0) if self.faults else None
        if self.upstream is not None and fault is None:
            await self._pass_on(head, raw, writer)
            return
        match fault:
            case "hang":
                await self._wait_until_left(reader)
            case "429" | "500" | "401" | "400":
                key = next((line for line in lines if line.lower().startswith("authorization")), "")
                said = {"error": {"message": f"this is a fault; you said {key}"}}
                again = "retry-after-ms: 1\r\n"
                await _write(writer, f"{fault} Fault\r\n{again}", json.dumps(said).encode())
            case "redirect":
                await _write(writer, "307 Elsewhere\r\nLocation: http://127.0.0.1:1/v1\r\n", b"")
            case _:
                await self._chat(reader, writer, body, fault)

    async def _chat(
        self,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
        body: dict[str, Any],
        fault: Fault | None,
    ) -> None:
        if any(self._schema(body, way) for way in self.refuses):
            await _write(writer, "400 Fault\r\n", b'{"error": {"message": "unknown field"}}')
            return
        text = self._text(body)
        if fault == "truncated":
            text = text[: len(text) // 2]
        elif fault == "wrong form":
            text = '{"reason": 5, "verdict": "Perhaps"}'
        events = list(_events(text, chances=self.chances and bool(body.get("logprobs"))))
        writer.write(b"HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\n")
        writer.write(b"Connection: close\r\n\r\n")
        if fault == "cut":
            writer.write(b"".join(events[: len(events) // 2]))
            await writer.drain()
            return
        if fault == "drip":
            for byte in b"".join(events):
                writer.write(bytes([byte]))
                await writer.drain()
                await asyncio.sleep(DRIP_S)
            return
        for event in events:
            writer.write(event)
            await writer.drain()

    def _text(self, body: dict[str, Any]) -> str:
        asked = str(body["messages"][-1]["content"])
        schemas = [schema for way in self.holds if (schema := self._schema(body, way))]
        if "Say hello" in asked:
            return json.dumps(instance(schemas[0], self._choice)) if schemas else GREETING
        if self.answers:
            return self.answers.pop(0)
        return json.dumps(instance(schemas[0], self._choice)) if schemas else GREETING

    def _schema(self, body: dict[str, Any], way: str) -> Any:
        return SCHEMAS[way](body)

    async def _wait_until_left(self, reader: asyncio.StreamReader) -> None:
        self.hung.set()
        await reader.read()
        self.left.set()

    async def _pass_on(self, head: bytes, raw: bytes, writer: asyncio.StreamWriter) -> None:
        assert self.upstream is not None
        source, sink = await asyncio.open_connection(*self.upstream)
        sink.write(head.replace(b"keep-alive", b"close") + raw)
        while data := await source.read(65536):
            writer.write(data)
            await writer.drain()
        sink.close()


def _events(text: str, *, chances: bool) -> Sequence[bytes]:
    """Return the answer `text` as server-sent events, a few characters each."""
    found: list[bytes] = []
    for begin in range(0, len(text), 6):
        piece = text[begin : begin + 6]
        token: dict[str, object] = {"token": piece, "logprob": -0.1, "top_logprobs": []}
        found.append(_event({"content": piece}, None, {"content": [token]} if chances else None))
    return [*found, _event({}, "stop", None), b"data: [DONE]\n\n"]


def _event(delta: dict[str, str], finish: str | None, logprobs: object) -> bytes:
    choice = {"index": 0, "delta": delta, "finish_reason": finish, "logprobs": logprobs}
    chunk = {
        "id": "c",
        "object": "chat.completion.chunk",
        "created": 0,
        "model": "m",
        "choices": [choice],
    }
    return f"data: {json.dumps(chunk)}\n\n".encode()


async def _write(writer: asyncio.StreamWriter, status: str, body: bytes) -> None:
    head = f"HTTP/1.1 {status}Content-Type: application/json\r\nContent-Length: {len(body)}\r\n"
    writer.write(head.encode() + b"Connection: close\r\n\r\n" + body)
    await writer.drain()
