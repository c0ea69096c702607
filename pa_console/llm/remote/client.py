"""A client that sends a prompt to a model's server; every failure becomes a ServerError.

Before an answer has begun, the `openai` client retries by itself, with growing, jittered pauses, if
it cannot connect, and after the status codes 408, 409, 429 and 5xx. Its environment variables are
ignored, no proxy is used and no redirect is followed. Therefore, requests go only to the named
server, and only with the key for this server.
"""

import asyncio
import ssl
from collections.abc import AsyncGenerator, Mapping
from contextlib import aclosing
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

from pa_console.llm.backend import Chance, ServerError
from pa_console.llm.remote.address import ServerAddress, ServerKey
from pa_console.schema.text import visible_line

if TYPE_CHECKING:
    from httpx2 import Request as HttpRequest
    from openai import AsyncOpenAI, AsyncStream
    from openai.types.chat import ChatCompletionChunk

RETRIES = 2
MOST_TOLD = 160
"""The largest number of characters shown of a server's error message."""
MOST_CHARS = 64 * 1024
"""The limit on an answer's length in characters; a longer answer is an error."""
TIMED_OUT = "gave no complete answer within {:.1f} s"
BROKE_OFF = "broke off in the middle of its answer"
OTHERS = ("openai-organization", "openai-project", "x-stainless-")
"""The prefixes of headers that the client adds by itself; these headers are removed."""


@dataclass(frozen=True)
class AnswerChunk:
    """A piece of an answer, with the token probabilities that the server reports.

    `finish` is the reason why the answer ended, in the last piece; in earlier pieces, it is ''.
    """

    text: str
    chances: tuple[Chance, ...] = ()
    finish: str = ""


class ServerClient:
    """A client of the model at `address`; `ask` is the first to load the library and connect."""

    def __init__(self, address: ServerAddress, key: ServerKey, *, retries: int = RETRIES) -> None:
        self.address = address
        self.key = key
        self._retries = retries
        self._client: AsyncOpenAI | None = None

    async def close(self) -> None:
        """Close the connections."""
        client, self._client = self._client, None
        if client is not None:
            await client.close()

    async def ask(
        self,
        system: str,
        user: str,
        max_tokens: int,
        within_s: float,
        extra: Mapping[str, Any],
        *,
        chances: bool = False,
    ) -> AsyncGenerator[AnswerChunk]:
        """Yield the answer to a prompt in pieces; the last piece has `finish`.

        `extra` has further fields of the request, such as a constraint on the answer. If the
        generator is closed early, the connection is closed, which makes the server stop. Raises
        ServerError if there is no complete answer within `within_s` seconds.
        """
        limit = asyncio.get_running_loop().time() + within_s
        late = ServerError(TIMED_OUT.format(within_s))
        logprobs = {"logprobs": True, "top_logprobs": 1} if chances else {}
        body: dict[str, Any] = {
            "model": self.address.name,
            "messages": [
                {"role": role, "content": content}
                for role, content in (("system", system), ("user", user))
                if content
            ],
            "max_tokens": max_tokens,
            "temperature": 0.0,
            "seed": 0,
            "stream": True,
            **logprobs,
        }
        try:
            async with asyncio.timeout_at(limit):
                stream = await self._started(body, extra)
        except TimeoutError:
            raise late from None
        length = 0
        async with aclosing(stream):
            while True:
                try:
                    async with asyncio.timeout_at(limit):
                        piece = await self._next(stream, length)
                except TimeoutError:
                    raise late from None
                length += len(piece.text)
                if length > MOST_CHARS:
                    raise ServerError(f"wrote more than {MOST_CHARS} characters")
                yield piece
                if piece.finish:
                    return

    async def _started(
        self, body: Mapping[str, Any], extra: Mapping[str, Any]
    ) -> "AsyncStream[ChatCompletionChunk]":
        try:
            client = self._client or await asyncio.to_thread(self._opened)
            self._client = client
            return cast(
                "AsyncStream[ChatCompletionChunk]",
                await client.chat.completions.create(**body, extra_body=extra),
            )
        except Exception as error:
            raise self._failed(error) from None

    async def _next(self, stream: "AsyncStream[ChatCompletionChunk]", length: int) -> AnswerChunk:
        """Return the next piece, which begins after `length` characters of the answer."""
        try:
            chunk = await anext(stream)
            choice = chunk.choices[0] if chunk.choices else None
            if choice is None:
                return AnswerChunk("")
            text = choice.delta.content or ""
            chances: list[Chance] = []
            at = length
            for token in (choice.logprobs.content or ()) if choice.logprobs else ():
                chances.append((at, float(token.logprob)))
                at += len(token.token)
            return AnswerChunk(text, tuple(chances), choice.finish_reason or "")
        except StopAsyncIteration:
            raise ServerError(BROKE_OFF) from None
        except Exception as error:
            raise self._failed(error, begun=True) from None

    def _failed(self, error: Exception, *, begun: bool = False) -> ServerError:
        """Return an error with the reason, but without the key and any part of the request."""
        from openai import APIConnectionError, APIStatusError, APITimeoutError  # noqa: PLC0415

        match error:
            case ServerError():
                return error
            case APIStatusError():
                message = visible_line(self.key.hidden_in(error.message))[:MOST_TOLD]
                return ServerError(f"answered {error.status_code}: {message}", error.status_code)
            case APITimeoutError():
                return ServerError("did not answer in time")
            case APIConnectionError() if not begun:
                return ServerError("cannot be reached")
            case _ if begun:
                return ServerError(BROKE_OFF)
            case _:
                return ServerError(f"cannot be asked: {type(error).__name__}")

    def _opened(self) -> "AsyncOpenAI":
        """Load the library, which takes a second, and return a new client."""
        import httpx2  # noqa: PLC0415 - only if a server is used
        import openai  # noqa: PLC0415

        secret = self.key.secret

        async def only_what_is_needed(request: "HttpRequest") -> None:
            for name in [name for name in request.headers if name.lower().startswith(OTHERS)]:
                del request.headers[name]
            if secret:
                request.headers["Authorization"] = f"Bearer {secret}"
            else:
                request.headers.pop("Authorization", None)

        http = httpx2.AsyncClient(
            trust_env=False,
            follow_redirects=False,
            verify=ssl.create_default_context(),
            timeout=None,
            event_hooks={"request": [only_what_is_needed]},
        )
        client = openai.AsyncOpenAI(
            api_key=secret or "none",
            base_url=self.address.base_url,
            http_client=http,
            max_retries=self._retries,
            timeout=None,
        )
        _ = client.chat.completions  # loaded here, so that the first prompt is not delayed
        return client
