"""The messages between the engine and its worker process, and how sure a model was.

What it wrote of an order with little confidence is what it misread far more often than the rest
(README, Measured): the operator is told so. A confident reading may be wrong as well.
"""

import math
from collections.abc import AsyncGenerator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Protocol

from pydantic import Field, TypeAdapter

from pa_console.llm.models.catalogue import ChatFormat
from pa_console.llm.models.preparing import Sha256
from pa_console.schema.base import StrictModel
from pa_console.schema.events.event import Role
from pa_console.schema.finding import Usage

Chance = tuple[int, float]
"""A token that the model chose: how many characters stood before it, the logarithm of its chance.
"""


def confidence(chances: Sequence[Chance], text: str, words: str) -> float | None:
    """Return the chance, 0 to 1, of `words` where they first stand in the answer `text`.

    What the grammar left no choice about is certain. None: the chances, or the words, are not told.
    """
    begin = text.find(words)
    if not chances or not words or begin < 0:
        return None
    end = begin + len(words)
    return round(math.exp(sum(chance for at, chance in chances if begin <= at < end)), 4)


Finish = Literal["stop", "length", "cancelled", "deadline"]


class PinnedFile(StrictModel):
    """A file to load, and the SHA-256 without which it is not loaded."""

    path: str
    sha256: Sha256


class Load(StrictModel):
    """First message to a worker: the model, its adapters, and the context `n_ctx` of each role.

    It computes on `threads` threads at most, and on fewer where the machine is busy, unless they
    are `fixed`.
    """

    op: Literal["load"] = "load"
    weights: PinnedFile
    chat: ChatFormat
    n_ctx: int
    threads: int
    fixed: bool = False
    adapters: dict[Role, PinnedFile] = {}


class Generate(StrictModel):
    """Answer a prompt; ids grow."""

    op: Literal["generate"] = "generate"
    id: int
    role: Role
    system: str
    user: str
    grammar: str
    max_tokens: int
    count: int = 1
    hint: str = ""
    begun: str = ""
    within: str = ""
    stop: str = ""


class Cancel(StrictModel):
    """Stop generation `id` and every earlier one."""

    op: Literal["cancel"] = "cancel"
    id: int


class Ready(StrictModel):
    """The model is loaded; `n_ctx` is what each role really has."""

    op: Literal["ready"] = "ready"
    n_ctx: int
    description: str


class LoadFailed(StrictModel):
    """The model cannot be loaded; the worker ends after this."""

    op: Literal["load_failed"] = "load_failed"
    error: str


class Piece(StrictModel):
    """More text of generation `id`."""

    op: Literal["piece"] = "piece"
    id: int
    text: str


class Texts(StrictModel):
    """The complete answers of generation `id` when several were asked for; Done follows."""

    op: Literal["texts"] = "texts"
    id: int
    texts: tuple[str, ...]


class Done(StrictModel):
    """Generation `id` is over; all its text was sent. `chances` are those of a single answer.

    `slowed` says that it took long because the machine had other work.
    """

    op: Literal["done"] = "done"
    id: int
    finish: Finish
    usage: Usage
    chances: tuple[Chance, ...] = ()
    slowed: bool = False


class Refused(StrictModel):
    """Generation `id` was not begun, or failed."""

    op: Literal["refused"] = "refused"
    id: int
    error: str


ToWorker: TypeAdapter[Load | Generate | Cancel] = TypeAdapter(
    Annotated[Load | Generate | Cancel, Field(discriminator="op")]
)
FromWorker: TypeAdapter[Ready | LoadFailed | Piece | Texts | Done | Refused] = TypeAdapter(
    Annotated[Ready | LoadFailed | Piece | Texts | Done | Refused, Field(discriminator="op")]
)


def encode(message: StrictModel) -> bytes:
    """Return `message` as one line."""
    return message.model_dump_json().encode() + b"\n"


@dataclass(frozen=True)
class Request:
    """One prompt; `deadline_s` counts from when the model is loaded and begins on it."""

    role: Role
    system: str
    user: str
    grammar: str
    max_tokens: int
    deadline_s: float
    count: int = 1
    """The number of answers wanted besides the most likely one; they come as `texts`."""
    hint: str = ""
    """Text that the answer may repeat: it only makes the answer faster."""
    begun: str = ""
    """The beginning of the answer, if `grammar` continues the last answer to this prompt: its
    evaluated tokens are used again. If several answers are wanted, all of them begin so, as the
    last answer did."""
    within: str = ""
    """The beginning of the most likely answer within which all of several answers leave it; '' lets
    them leave it anywhere."""
    stop: str = ""
    """A regular expression: each of several answers ends where this is found in its text."""
    schema: dict[str, Any] | None = None
    """The JSON schema of the answer for a model on a server, in place of `grammar`."""
    yields: bool = False
    """True if no caller waits: any other prompt interrupts it, and it is `cancelled`. The evaluated
    part of the prompt is kept, so that it may soon be asked again."""


@dataclass(frozen=True)
class Completed:
    """The end of a generation: the whole text, what it cost and why it ended."""

    text: str
    usage: Usage
    finish: Finish
    texts: tuple[str, ...] = ()
    chances: tuple[Chance, ...] = ()
    """The probability of each token that the model chose; none for several answers."""


class Named(Protocol):
    """A model that goes by a name in logs and on the screen."""

    @property
    def name(self) -> str:
        """The name."""
        ...


class Answering(Protocol):
    """A backend that answers prompts: the engine of a local model, or of one on a server."""

    @property
    def model(self) -> Named:
        """The model that answers."""
        ...

    def generate(self, request: Request) -> AsyncGenerator[str | Completed]:
        """Give the answer to `request` in pieces, then one Completed; raises EngineError."""
        ...
