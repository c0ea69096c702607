"""The backend of a model: prompts, answers, errors, and the protocol between caller and model.

A remote model is named `SCHEME:...`. The scheme `openai` is a server with the OpenAI interface. A
package can add a scheme with an entry point in the group `pa_console.backends`. The entry point is
a function that takes the whole name and BackendOptions. It returns a Backend or raises ModelError.
"""

import math
from collections.abc import AsyncGenerator, Callable, Sequence
from contextlib import aclosing
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Literal, Protocol

from pa_console.schema.base import Role, ServerUse
from pa_console.schema.finding import Usage

CANCELLED = "cancelled"
"""The error of an answer that was interrupted."""

ChatFormat = Literal["template", "chatml", "plain"]
"""The format of a prompt: the template in the model's file, or a built-in one."""

Finish = Literal["stop", "length", "cancelled", "deadline"]
Chance = tuple[int, float]
"""A chosen token: the number of characters before it, and the logarithm of its probability."""

GROUP = "pa_console.backends"
OWN = EntryPoint("openai", "pa_console.llm.remote.engine:open_server", GROUP)

OnText = Callable[[str], object]
"""A callback for an answer, piece by piece as it is generated."""


class ModelError(Exception):
    """A model that is unknown, missing, or not the file that the catalogue pins."""


class PullError(ModelError):
    """A model that could not be fetched; the message has each source's failure and a remedy."""


class EngineError(Exception):
    """A failed generation; the same prompt may fail again."""


class EngineDiedError(EngineError):
    """The end of the worker process during a request; the next generation starts a new one."""


class ModelUnavailableError(EngineError):
    """A model that cannot be loaded or used."""


class PromptRefusedError(EngineError):
    """A prompt that does not fit in the model's context, or whose grammar is not valid."""


class ServerError(EngineError):
    """A server's failure to return a usable answer; `status` is the HTTP status, 0 without one."""

    def __init__(self, why: str, status: int = 0) -> None:
        super().__init__(why)
        self.status = status


@dataclass(frozen=True)
class Request:
    """One prompt; `deadline_s` counts from the start of its evaluation by the loaded model."""

    role: Role
    system: str
    user: str
    grammar: str
    max_tokens: int
    deadline_s: float
    count: int = 1
    """The number of answers. If it is more than one, the model writes this number of alternatives
    to the most likely answer, which are returned as `texts`."""
    hint: str = ""
    """Text that the answer may repeat; a hint changes only the time that the answer takes."""
    begun: str = ""
    """The beginning of the answer, if `grammar` continues the last answer to this prompt. In this
    case, the evaluated tokens of the last answer are reused. If several answers are requested, all
    of them begin with this text."""
    within: str = ""
    """The beginning of the most likely answer within which its alternatives must diverge from it;
    '' lets them diverge anywhere."""
    stop: str = ""
    """A regular expression. If several answers are requested, each ends at its first match."""
    schema: dict[str, Any] | None = None
    """The JSON schema of the answer for a model on a server, instead of `grammar`."""
    yields: bool = False
    """True if no caller waits for the answer. Any prompt that a caller waits for interrupts this
    one, which then ends as `cancelled`. The evaluated part of the prompt is kept for the next
    request."""


@dataclass(frozen=True)
class GenerationEnd:
    """The end of a generation: the whole text, its cost, and the reason why it ended."""

    text: str
    usage: Usage
    finish: Finish
    texts: tuple[str, ...] = ()
    chances: tuple[Chance, ...] = ()
    """The probability of each token that the model chose; empty if several answers were requested.
    """


def confidence(chances: Sequence[Chance], text: str, words: str) -> float | None:
    """Return the probability, 0 to 1, of the first occurrence of `words` in the answer `text`.

    Tokens that the grammar forced count as certain. The result is None if there are no
    probabilities, or if the words do not occur. Models misread orders far more often if this value
    is low (page Results of the manual), so the operator is warned. If it is high, the words may
    still be wrong.
    """
    begin = text.find(words)
    if not chances or not words or begin < 0:
        return None
    end = begin + len(words)
    return round(math.exp(sum(chance for at, chance in chances if begin <= at < end)), 4)


class Answerer(Protocol):
    """A model that planner and judge can ask."""

    @property
    def name(self) -> str:
        """The model's name in logs and on the screen."""
        ...

    def generate(self, request: Request) -> AsyncGenerator[str | GenerationEnd]:
        """Yield the answer to `request` in pieces, then one GenerationEnd; raises EngineError."""
        ...


class Backend(Answerer, Protocol):
    """A model that answers prompts, in a process of this machine or elsewhere."""

    on_state: Callable[[Any, str], None] | None
    """A callback for each new state (a WorkerState or a ServerState) and its reason."""

    @property
    def usable(self) -> bool:
        """False while another model must answer instead of this one."""
        ...

    async def start(self) -> None:
        """Begin to prepare the model, and return at once."""
        ...

    async def close(self) -> None:
        """Release all resources of the backend."""
        ...


@dataclass(frozen=True)
class BackendOptions:
    """The use of a backend in a session, with the operator's permission and the time limit."""

    use: ServerUse
    plain: bool = False
    """True if prompts and answers may cross the network in clear text."""
    patience_s: float = 20.0
    """The time to wait for an answer before the local model takes over, in seconds."""


@cache
def backend_schemes() -> dict[str, EntryPoint]:
    """Return the entry points by scheme; a package cannot replace a built-in scheme."""
    return {point.name: point for point in (*entry_points(group=GROUP), OWN)}


def names_backend(name: str | None) -> bool:
    """Return True if `name` names a model on a server."""
    scheme, colon, _ = (name or "").partition(":")
    return bool(colon) and scheme in backend_schemes()


def open_backend(name: str, options: BackendOptions) -> Backend:
    """Return the backend of the model `name`; nothing is sent yet.

    Raises ModelError if the scheme does not accept the name, or if its package cannot be loaded.
    """
    point = backend_schemes()[name.partition(":")[0]]
    try:
        opener = point.load()
    except (ImportError, AttributeError) as error:
        raise ModelError(f"{name}: the backend {point.value} cannot be loaded: {error}") from error
    return opener(name, options)


@dataclass(frozen=True)
class ModelAnswer:
    """The whole text of an answer; `error` is the reason if it is incomplete."""

    text: str
    usage: Usage
    error: str = ""
    fatal: bool = False
    texts: tuple[str, ...] = ()
    chances: tuple[Chance, ...] = ()


async def ask_model(
    model: Answerer, request: Request, on_text: OnText | None = None
) -> ModelAnswer:
    """Return the whole answer, and pass its pieces to `on_text`.

    An EngineError is returned as the answer's `error`. The text in the request's `begun` is not
    passed on. If the model's process dies, it is restarted and the prompt is repeated once. Greedy
    decoding repeats the pieces that were already passed on, so they are skipped.
    """
    passed_on, again = len(request.begun), False
    while True:
        text = ""
        whole = ModelAnswer(text, Usage(), "the model ended without an answer", fatal=True)
        try:
            async with aclosing(model.generate(request)) as pieces:
                async for item in pieces:
                    if isinstance(item, GenerationEnd):
                        whole = _answer(item, request)
                        continue
                    text += item
                    if on_text is not None and len(text) > passed_on:
                        on_text(text[passed_on:])
                    passed_on = max(passed_on, len(text))
        except EngineDiedError as error:
            if again:
                return ModelAnswer(text, Usage(), str(error), fatal=True)
            again = True
        except EngineError as error:
            return ModelAnswer(text, Usage(), str(error), fatal=True)
        else:
            return whole


def _answer(item: GenerationEnd, request: Request) -> ModelAnswer:
    match item.finish:
        case "stop":
            return ModelAnswer(item.text, item.usage, texts=item.texts, chances=item.chances)
        case "length":
            error = f"the answer was cut off after {request.max_tokens} tokens"
            return ModelAnswer(item.text, item.usage, error)
        case "cancelled":
            return ModelAnswer(item.text, item.usage, CANCELLED, fatal=True)
        case "deadline":
            error = f"no complete answer within {request.deadline_s:.0f} s"
            return ModelAnswer(item.text, item.usage, error, fatal=True)
