"""The engine of a model on a server, which has fewer abilities than the engine of a local model.

It answers the same requests as the engine of a local model, and checks every answer itself. A
server returns no alternatives to the most likely answer, cannot read prompts ahead, and may not
report token probabilities. If this engine raises ServerError, the caller uses a model on this
machine.

Servers constrain an answer to a JSON schema in different ways, each with a different field in the
request. A server that does not support a field may ignore it and answer anyway. Therefore, every
way is tested with a schema of random words that the prompt does not mention. An answer can have
these words only if it is constrained.
"""

import asyncio
import json
import secrets
import string
from collections.abc import AsyncGenerator, Callable
from contextlib import aclosing
from dataclasses import dataclass, field
from typing import Any, Literal, cast

from pa_console.llm.backend import (
    BackendOptions,
    Chance,
    GenerationEnd,
    ModelError,
    Request,
    ServerError,
)
from pa_console.llm.remote.address import KEY_VARIABLES, ServerAddress, ServerKey
from pa_console.llm.remote.client import MOST_TOLD, AnswerChunk, ServerClient
from pa_console.llm.roles.grammar import Schema
from pa_console.resources import missing_library
from pa_console.schema.events.event import ServerState
from pa_console.schema.finding import Usage

Way = Literal[
    "json_schema", "json_object", "structured_outputs", "guided_json", "format", "grammar"
]
"""A way to constrain a server's answer (see WAYS)."""


WAYS: dict[Way, Callable[[Schema], Schema]] = {
    "json_schema": lambda schema: {
        "response_format": {
            "type": "json_schema",
            "json_schema": {"name": "answer", "strict": True, "schema": schema},
        }
    },
    "json_object": lambda schema: {"response_format": {"type": "json_object", "schema": schema}},
    "structured_outputs": lambda schema: {"structured_outputs": {"json": schema}},
    "guided_json": lambda schema: {"guided_json": schema},
    "format": lambda schema: {"format": schema},
    "grammar": lambda schema: {"grammar": gbnf(schema)},
}
"""The request fields for a schema by way, the preferred way first.

`json_schema` is the way of the OpenAI interface, which llama.cpp, Ollama and vLLM support too.
`json_object` is for llama-cpp-python, `structured_outputs` for newer vLLM, `guided_json` for older
vLLM, `format` for Ollama, and `grammar`, in GBNF, for llama.cpp.
"""

_STRING = r'[^"\\\x7F\x00-\x1F]'
"""A character of a JSON string that needs no escape, in GBNF."""

PROMPT = "Say hello."
PROBE_TOKENS = 48
PROBE_S = 20.0
"""The time limit of one test, in seconds."""
REFUSES = (400, 404, 415, 422, 500, 501)
"""The status codes with which servers refuse a field or its value."""
WORD = 8
HOLDS, IGNORED = "works", "ignored"
UNCONSTRAINED = "answers cannot be constrained, so an unreadable answer is requested again"
AGAIN_S = 15.0
"""The time after which a server that failed is probed again, in seconds."""
TRIES = 2
"""The number of times that an answer is requested if it cannot be parsed."""

MOST_BEGINNINGS = 16
"""The largest number of braces that are tried as the beginning of the answer."""
OF_THE_QUESTION = (400, 413, 422)
"""The status codes with which a working server refuses a particular request."""

OnServer = Callable[[ServerState, str], None]


def gbnf(schema: Schema) -> str:
    """Return the grammar of `schema` for llama.cpp: JSON with the spacing of the prompts."""
    rules: dict[str, str] = {}
    rules["root"] = _rule(schema, "root", rules)
    return "".join(f"{name} ::= {rule}\n" for name, rule in rules.items())


def _rule(schema: Schema, name: str, rules: dict[str, str]) -> str:
    """Return the expression for `schema`; add the rules that it needs to `rules`.

    The names of these rules begin with `name`.
    """
    match schema:
        case {"anyOf": ways}:
            kinds = [
                _rule(way, f"{name}-{n}", rules) for n, way in enumerate(cast(list[Schema], ways))
            ]
            return f"({' | '.join(kinds)})"
        case {"enum": words}:
            return f"({' | '.join(_literal(json.dumps(word)) for word in cast(list[str], words))})"
        case {"type": "string"}:
            return f'"\\"" {_STRING}* "\\""'
        case {"type": "array", "items": items}:
            rules[f"{name}-item"] = _rule(items, f"{name}-item", rules)
            return _items(f"{name}-item", int(schema["minItems"]), int(schema["maxItems"]))
        case {"type": "object", "properties": properties}:
            parts = [
                f"{_literal(json.dumps(key) + ': ')} {_rule(value, f'{name}-{key}', rules)}"
                for key, value in cast(Schema, properties).items()
            ]
            return f'"{{" {_literal(", ").join(f" {part} " for part in parts)} "}}"'
        case _:
            raise ValueError(f"no grammar is known for the schema {schema}")


def _items(item: str, least: int, most: int) -> str:
    """Return the rule of an array that has from `least` to `most` times `item`."""
    if most == 0:
        return '"[]"'
    more = f'{item} (", " {item}){{{max(least - 1, 0)},{most - 1}}}'
    return f'"[" {more} "]"' if least else f'"[" ({more})? "]"'


def _literal(text: str) -> str:
    """Return `text` as a GBNF literal."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


@dataclass(frozen=True)
class ProbeReport:
    """The result of the test of each way in words, and whether token probabilities are reported."""

    ways: dict[Way, str] = field(default_factory=dict[Way, str])
    chances: bool = False

    @property
    def way(self) -> Way | None:
        """The preferred way among those that work; None if no way works."""
        return next((way for way, result in self.ways.items() if result == HOLDS), None)

    @property
    def summary(self) -> str:
        """The conclusion of the tests, in a sentence."""
        return f"answers are constrained by {self.way}" if self.way else UNCONSTRAINED

    @property
    def words(self) -> str:
        """All results in one line."""
        ways = ", ".join(f"{way} {result}" for way, result in self.ways.items())
        reported = "reported" if self.chances else "not reported"
        return f"{self.summary} ({ways}); token probabilities {reported}"


async def probe(client: ServerClient, within_s: float = PROBE_S) -> ProbeReport:
    """Test every way to constrain an answer, and whether token probabilities are reported.

    Each test may take `within_s` seconds. Raises ServerError if the server cannot be reached, is
    too slow or refuses every prompt.
    """
    chances = await _reports_chances(client, within_s, asked_for=True)
    if not chances:
        await _reports_chances(client, within_s, asked_for=False)
    return ProbeReport({way: await _tried(client, way, within_s) for way in WAYS}, chances)


async def _tried(client: ServerClient, way: Way, within_s: float) -> str:
    random = secrets.SystemRandom()
    key, word = ("".join(random.choices(string.ascii_lowercase, k=WORD)) for _ in range(2))
    schema: Schema = {
        "type": "object",
        "properties": {key: {"type": "string", "enum": [word]}},
        "required": [key],
        "additionalProperties": False,
    }
    held, text = f'{{"{key}":"{word}"}}', ""
    try:
        async with aclosing(
            client.ask("", PROMPT, PROBE_TOKENS, within_s, WAYS[way](schema))
        ) as pieces:
            async for piece in pieces:
                text += "".join(piece.text.split())
                if not held.startswith(text):
                    return IGNORED
    except ServerError as error:
        if error.status not in REFUSES:
            raise
        return f"refused ({error.status})"
    return HOLDS if text == held else IGNORED


async def _reports_chances(client: ServerClient, within_s: float, *, asked_for: bool) -> bool:
    """Request a few words; return whether the answer has token probabilities."""
    reported = False
    try:
        async for piece in client.ask("", PROMPT, 4, within_s, {}, chances=asked_for):
            reported = reported or bool(piece.chances)
    except ServerError as error:
        if not asked_for or error.status not in REFUSES:
            raise
    return reported


class ServerEngine:
    """An engine that answers prompts with the model at `address`.

    `on_state` is called at every change of state.
    """

    def __init__(
        self,
        address: ServerAddress,
        key: ServerKey,
        *,
        patience_s: float = BackendOptions.patience_s,
        again_s: float = AGAIN_S,
        chances: bool = False,
        client: ServerClient | None = None,
    ) -> None:
        """Prepare the engine; nothing is sent before it is started.

        If `chances`, token probabilities are requested, which slows some servers.
        """
        self.address = address
        self.name = str(address)
        self.report = ProbeReport()
        self.state: ServerState = "probing"
        self.detail = "not probed yet"
        self.on_state: OnServer | None = None
        self._patience_s, self._again_s, self._chances = patience_s, again_s, chances
        self._client = client or ServerClient(address, key)
        self._looked, self._doubted = asyncio.Event(), asyncio.Event()
        self._probing: asyncio.Task[None] | None = None

    @property
    def usable(self) -> bool:
        """True if the server answers, or has not been probed yet."""
        return self.state != "away"

    async def start(self) -> None:
        """Begin to probe the server; it is probed again after each failure."""
        if self._probing is None:
            self._probing = asyncio.create_task(self._probe_again(), name="model server")

    async def _probe_again(self) -> None:
        while True:
            await self.look()
            if self.usable:
                await self._doubted.wait()
            await asyncio.sleep(self._again_s)

    async def look(self) -> None:
        """Probe the server once; the result is in `state`, `detail` and `report`."""
        self._doubted.clear()
        if self.state != "away":
            self._change("probing", "the ways to constrain its answers are being tested")
        try:
            self.report = await probe(self._client)
        except ServerError as error:
            self._change("away", str(error))
        else:
            self._change("ready" if self.report.way else "unconstrained", self.report.summary)
        self._looked.set()

    async def close(self) -> None:
        """Stop probing and close the connections."""
        if self._probing is not None:
            self._probing.cancel()
            await asyncio.gather(self._probing, return_exceptions=True)
        await self._client.close()

    async def generate(self, request: Request) -> AsyncGenerator[str | GenerationEnd]:
        """Yield the answer to `request` in pieces, then one GenerationEnd.

        If several answers are requested, none is returned, because servers do not support this. If
        an answer does not match the schema of the request, another one is requested once, and its
        pieces are not yielded. Raises ServerError if there is no usable answer within the deadline
        or `patience_s`, whichever is shorter. The server is then probed again before its next
        prompt.
        """
        if request.count > 1:
            yield GenerationEnd("", Usage(), "stop")
            return
        clock = asyncio.get_running_loop().time
        began = clock()
        limit = began + min(request.deadline_s, self._patience_s)
        try:
            await self._wait_for_probe(limit - began)
            wrong = ""
            for number in range(TRIES):
                written = _GrowingAnswer(began)
                async with aclosing(self._ask(request, limit - clock(), wrong)) as pieces:
                    async for piece in pieces:
                        written.add(piece, clock())
                        if piece.text and not number:
                            yield piece.text
                answer, wrong = read_answer(written.text, request.schema)
                if not wrong:
                    yield written.completed(answer, clock())
                    return
        except ServerError as error:
            if error.status not in OF_THE_QUESTION:
                self._doubt(str(error))
            raise
        wrong = f"gave no readable answer in {TRIES} attempts: {wrong}"
        self._doubt(wrong)
        raise ServerError(wrong)

    async def _wait_for_probe(self, seconds: float) -> None:
        if not self._looked.is_set():
            try:
                async with asyncio.timeout(seconds):
                    await self._looked.wait()
            except TimeoutError:
                raise ServerError(f"was not ready within {seconds:.1f} s") from None
        if not self.usable:
            raise ServerError(self.detail)

    def _ask(self, request: Request, within_s: float, wrong: str) -> AsyncGenerator[AnswerChunk]:
        way, schema, user = self.report.way, request.schema, request.user
        extra: Schema = {}
        if schema is not None and way is not None:
            extra = WAYS[way](schema)
        elif schema is not None:
            user += f"\n\nAnswer with one JSON object that meets this schema: {json.dumps(schema)}"
        if wrong:
            user += f"\n\nYour last answer could not be read: {wrong}"
        chances = self._chances and self.report.chances
        return self._client.ask(
            request.system, user, request.max_tokens, within_s, extra, chances=chances
        )

    def _doubt(self, why: str) -> None:
        """Send no more prompts until the server has been probed again."""
        if self.usable:
            self._change("away", why)
        self._doubted.set()

    def _change(self, state: ServerState, detail: str) -> None:
        if (state, detail) != (self.state, self.detail):
            self.state, self.detail = state, detail
            if self.on_state is not None:
                self.on_state(state, detail)


def open_server(name: str, options: BackendOptions) -> ServerEngine:
    """Return the engine of the model at the address `name`, which is `openai:BASE_URL#NAME`.

    Raises ModelError if the address is invalid, if the client is not installed, or if prompts would
    be sent in clear text and `options` do not allow it.
    """
    if missing := missing_library("openai", "openai", f"{name} needs"):
        raise ModelError(missing)
    address = ServerAddress.parse(name)
    address.allow(plain=options.plain)
    key = ServerKey.find(address, KEY_VARIABLES[options.use])
    return ServerEngine(
        address, key, patience_s=options.patience_s, chances=options.use == "second reader"
    )


class _GrowingAnswer:
    """The part of an answer that has been received."""

    def __init__(self, began: float) -> None:
        self.text, self._chances = "", list[Chance]()
        self._began, self._first, self._pieces = began, 0.0, 0

    def add(self, piece: AnswerChunk, now: float) -> None:
        if piece.text and not self._pieces:
            self._first = now - self._began
        self.text += piece.text
        self._chances += piece.chances
        self._pieces += bool(piece.text)

    def completed(self, answer: str, now: float) -> GenerationEnd:
        """Return the end of the generation, with the text `answer`.

        If `answer` is only part of the received text, the probabilities are left out.
        """
        usage = Usage(
            completion_tokens=self._pieces,
            sampled_tokens=self._pieces,
            first_token_s=self._first,
            seconds=now - self._began,
        )
        chances = tuple(self._chances) if answer == self.text else ()
        return GenerationEnd(answer, usage, "stop", chances=chances)


def read_answer(text: str, schema: Schema | None) -> tuple[str, str]:
    """Return the JSON object in `text` that matches `schema`, and '' or else the problem.

    Words around the object, or a fence, are ignored. Without a schema, the answer is the whole
    text.
    """
    if schema is None:
        return text, ""
    from jsonschema import Draft202012Validator  # noqa: PLC0415 - only if a server is used

    validator, wrong = Draft202012Validator(schema), ""
    begin = -1
    for _ in range(MOST_BEGINNINGS):
        begin = text.find("{", begin + 1)
        if begin < 0:
            break
        try:
            value, end = json.JSONDecoder().raw_decode(text, begin)
        except (ValueError, RecursionError) as error:
            wrong = wrong or f"it is not JSON: {error}"
        else:
            error = next(iter(cast(Any, validator).iter_errors(value)), None)
            if error is None:
                return text[begin:end], ""
            wrong = wrong or str(error.message)[:MOST_TOLD]
    return "", wrong or "it holds no JSON object"
