"""The messages between the engine and its worker process: one JSON object a line."""

from typing import Annotated, Literal

from pydantic import Field, TypeAdapter

from pa_console.llm.catalog import ChatFormat
from pa_console.llm.confidence import Chance
from pa_console.llm.prepare import Sha256
from pa_console.schema.base import StrictModel
from pa_console.schema.event import Role
from pa_console.schema.finding import Usage

Finish = Literal["stop", "length", "cancelled", "deadline"]


class PinnedFile(StrictModel):
    """A file to load, and the SHA-256 without which it is not loaded."""

    path: str
    sha256: Sha256


class Load(StrictModel):
    """First message to a worker: the model, its adapters, and the context `n_ctx` of each role."""

    op: Literal["load"] = "load"
    weights: PinnedFile
    chat: ChatFormat
    n_ctx: int
    threads: int
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
    """Generation `id` is over; all its text was sent. `chances` are those of a single answer."""

    op: Literal["done"] = "done"
    id: int
    finish: Finish
    usage: Usage
    chances: tuple[Chance, ...] = ()


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
