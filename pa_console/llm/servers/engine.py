"""An engine whose model is on a server, as far as a server can be one.

It answers the same requests as the engine of a local model and checks every answer itself. What a
server cannot do it says: it tells no other answers than the likeliest one, keeps nothing that was
read ahead, and knows the chances of tokens only where the server tells them. Who asks it has a
model of this machine to turn to when it raises ServerError.
"""

import asyncio
import json
from collections.abc import AsyncGenerator, Callable
from contextlib import aclosing
from typing import Any, cast

from pa_console.llm.backend import BackendOptions, Chance, Completed, Request, ServerError
from pa_console.llm.roles.answer_schema import Schema
from pa_console.llm.servers.address import KEY_VARIABLES, ServerAddress, ServerKey
from pa_console.llm.servers.client import MOST_TOLD, ServerClient
from pa_console.llm.servers.constraints import WAYS, ProbeReport, probe
from pa_console.schema.events.event import ServerState
from pa_console.schema.finding import Usage

AGAIN_S = 15.0
"""A server that failed is looked at again after so long."""
TRIES = 2
"""The number of attempts when an answer cannot be read."""

MOST_BEGINNINGS = 16
"""The number of braces that are tried as the beginning of the answer."""
OF_THE_QUESTION = (400, 413, 422)
"""The status codes of a healthy server that does not accept the request."""

OnServer = Callable[[ServerState, str], None]


class ServerEngine:
    """Answers prompts with the model at `address`; `on_state` is told of every change of it."""

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
        """Open the server's engine.

        With `chances`, token probabilities are requested, which slows some servers.
        """
        self.address = address
        self.name = str(address)
        self.report = ProbeReport()
        self.state: ServerState = "probing"
        self.detail = "not asked yet"
        self.on_state: OnServer | None = None
        self._patience_s, self._again_s, self._chances = patience_s, again_s, chances
        self._client = client or ServerClient(address, key)
        self._looked, self._doubted = asyncio.Event(), asyncio.Event()
        self._probing: asyncio.Task[None] | None = None

    @property
    def usable(self) -> bool:
        """True if it answers, or if that is not known yet."""
        return self.state != "away"

    async def start(self) -> None:
        """Begin to probe the server, now and again whenever it has failed."""
        if self._probing is None:
            self._probing = asyncio.create_task(self._probe_again(), name="model server")

    async def _probe_again(self) -> None:
        while True:
            await self.look()
            if self.usable:
                await self._doubted.wait()
            await asyncio.sleep(self._again_s)

    async def look(self) -> None:
        """Probe the server once; `state`, `detail` and `report` say what came of it."""
        self._doubted.clear()
        if self.state != "away":
            self._change("probing", "its ways to constrain an answer are tried")
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

    async def generate(self, request: Request) -> AsyncGenerator[str | Completed]:
        """Give the answer to `request` in pieces, then one Completed.

        Of several answers none is given: a server does not tell them. An answer that does not meet
        the schema of the request is asked for once more; its pieces are not given. Raises
        ServerError when there is no answer that can be used, within the deadline or `patience_s`,
        whichever is shorter; the server is then looked at again before it is asked anything else.
        """
        if request.count > 1:
            yield Completed("", Usage(), "stop")
            return
        clock = asyncio.get_running_loop().time
        began = clock()
        limit = began + min(request.deadline_s, self._patience_s)
        try:
            await self._wait_for_probe(limit - began)
            wrong = ""
            for number in range(TRIES):
                written = _Written(began)
                async with aclosing(self._ask(request, limit - clock(), wrong)) as pieces:
                    async for text, chances, finish in pieces:
                        written.add(text, chances, finish, clock())
                        if text and not number:
                            yield text
                answer, wrong = read_answer(written.text, request.schema)
                if not wrong:
                    yield written.completed(answer, clock())
                    return
        except ServerError as error:
            if error.status not in OF_THE_QUESTION:
                self._doubt(str(error))
            raise
        wrong = f"gave no answer that can be read, {TRIES} times: {wrong}"
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

    async def _ask(
        self, request: Request, within_s: float, wrong: str
    ) -> AsyncGenerator[tuple[str, tuple[Chance, ...], str]]:
        way, schema, user = self.report.way, request.schema, request.user
        extra: Schema = {}
        if schema is not None and way is not None:
            extra = WAYS[way](schema)
        elif schema is not None:
            user += f"\n\nAnswer with one JSON object that meets this schema: {json.dumps(schema)}"
        if wrong:
            user += f"\n\nYour last answer could not be read: {wrong}"
        chances = self._chances and self.report.chances
        asked = self._client.ask(
            request.system, user, request.max_tokens, within_s, extra, chances=chances
        )
        async with aclosing(asked) as pieces:
            async for piece in pieces:
                yield piece.text, piece.chances, piece.finish

    def _doubt(self, why: str) -> None:
        """Ask nothing more before the server was looked at again."""
        if self.usable:
            self._change("away", why)
        self._doubted.set()

    def _change(self, state: ServerState, detail: str) -> None:
        if (state, detail) != (self.state, self.detail):
            self.state, self.detail = state, detail
            if self.on_state is not None:
                self.on_state(state, detail)


def open_server(name: str, options: BackendOptions) -> ServerEngine:
    """Return the engine of the model at the address `name`, `openai:BASE_URL#NAME`.

    Raises ModelError for a name that is no address, and for one to which words would go in clear
    text, unless `options` allow it.
    """
    address = ServerAddress.parse(name)
    address.allow(plain=options.plain)
    key = ServerKey.find(address, KEY_VARIABLES[options.use])
    return ServerEngine(
        address, key, patience_s=options.patience_s, chances=options.use == "second reader"
    )


class _Written:
    """An answer as it comes."""

    def __init__(self, began: float) -> None:
        self.text, self._chances, self._finish = "", list[Chance](), ""
        self._began, self._first, self._pieces = began, 0.0, 0

    def add(self, text: str, chances: tuple[Chance, ...], finish: str, now: float) -> None:
        if text and not self._pieces:
            self._first = now - self._began
        self.text += text
        self._chances += chances
        self._finish = finish
        self._pieces += bool(text)

    def completed(self, answer: str, now: float) -> Completed:
        """Return the end; chances count for the text as it was written only."""
        usage = Usage(
            completion_tokens=self._pieces,
            sampled_tokens=self._pieces,
            first_token_s=self._first,
            seconds=now - self._began,
        )
        chances = tuple(self._chances) if answer == self.text else ()
        return Completed(answer, usage, "stop", chances=chances)


def read_answer(text: str, schema: Schema | None) -> tuple[str, str]:
    """Return the JSON object in `text` that meets `schema`, or else the problem with it.

    Words around it, or a fence, do not matter. Without a schema the text is the answer.
    """
    if schema is None:
        return text, ""
    from jsonschema import Draft202012Validator  # noqa: PLC0415 - only where a server is named

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
