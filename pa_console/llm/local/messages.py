"""The messages between the engine and its worker process, each a line with a JSON object."""

from typing import Annotated, Literal

from pydantic import Field, TypeAdapter

from pa_console.llm.backend import Chance, ChatFormat, Finish, Request
from pa_console.schema.base import Hex32, Role, StrictModel
from pa_console.schema.finding import Usage


class PinnedFile(StrictModel):
    """A file to load, with the SHA-256 that it must have."""

    path: str
    sha256: Hex32


class Load(StrictModel):
    """The first message to a worker: the model, its adapters, and the context `n_ctx` per role.

    The worker uses at most `threads` threads. It uses fewer if the machine is busy, unless the
    number is `fixed`. With `require_sandbox`, nothing is loaded unless every restriction holds.
    """

    op: Literal["load"] = "load"
    weights: PinnedFile
    chat: ChatFormat
    n_ctx: int
    threads: int
    fixed: bool = False
    require_sandbox: bool = False
    adapters: dict[Role, PinnedFile] = {}


class Generate(StrictModel):
    """A request to answer a prompt; each request has a higher id than the one before."""

    op: Literal["generate"] = "generate"
    id: int
    request: Request


class Cancel(StrictModel):
    """A request to stop generation `id` and every earlier one."""

    op: Literal["cancel"] = "cancel"
    id: int


class Ready(StrictModel):
    """The message that the model is loaded; `n_ctx` is the actual context size for each role.

    `unconfined` lists the restrictions that do not hold for the process, with the reasons; it is
    empty if all hold.
    """

    op: Literal["ready"] = "ready"
    n_ctx: int
    description: str
    unconfined: str = ""


class LoadFailed(StrictModel):
    """The message that the model cannot be loaded; the worker then ends."""

    op: Literal["load_failed"] = "load_failed"
    error: str


class TextPiece(StrictModel):
    """A piece of the text of generation `id`."""

    op: Literal["piece"] = "piece"
    id: int
    text: str


class Done(StrictModel):
    """The message that generation `id` has ended, sent after all of its text.

    `texts` has the complete answers if several were requested; `chances` has the token
    probabilities of a single answer. `slowed` is True if other work on the machine makes answers
    slow.
    """

    op: Literal["done"] = "done"
    id: int
    finish: Finish
    usage: Usage
    texts: tuple[str, ...] = ()
    chances: tuple[Chance, ...] = ()
    slowed: bool = False


class GenerationFailure(StrictModel):
    """The message that generation `id` could not begin, or failed."""

    op: Literal["refused"] = "refused"
    id: int
    error: str


ToWorker: TypeAdapter[Load | Generate | Cancel] = TypeAdapter(
    Annotated[Load | Generate | Cancel, Field(discriminator="op")]
)
FromWorker: TypeAdapter[Ready | LoadFailed | TextPiece | Done | GenerationFailure] = TypeAdapter(
    Annotated[Ready | LoadFailed | TextPiece | Done | GenerationFailure, Field(discriminator="op")]
)


def encode(message: StrictModel) -> bytes:
    """Return `message` as one line."""
    return message.model_dump_json().encode() + b"\n"
