"""The process that runs the model: it reads requests on stdin and writes answers on stdout.

Only this process imports llama.cpp and llguidance. It ignores Ctrl-C, which its parent handles, and
prints nothing to the terminal. It ends as soon as its parent has ended. It loads only files with
the hashes that its parent names. Before that, it gives up all access that it does not need (see
`confinement`).
"""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from queue import SimpleQueue
from typing import IO, TYPE_CHECKING

from pa_console.llm.local.confinement import (
    Restriction,
    confine,
    gaps,
    read_only,
    require_all,
)
from pa_console.llm.local.messages import (
    Cancel,
    Done,
    Generate,
    GenerationFailure,
    Load,
    LoadFailed,
    PinnedFile,
    Ready,
    TextPiece,
    ToWorker,
    encode,
)
from pa_console.llm.models.cache import CheckedFile
from pa_console.llm.models.gguf_bounds import check_gguf
from pa_console.schema.base import Role, StrictModel

if TYPE_CHECKING:
    from pa_console.llm.local.decoding import ChatPrompt, Decoder

SEQUENCES: dict[Role, int] = {"planner": 0, "judge": 1, "outcome": 2}
"""The sequence of each role. Each sequence has its own KV cache, so that the fixed part of a role's
prompts is evaluated once."""


class Inbox:
    """A reader of the parent's messages; its thread notices a cancel while the model runs."""

    def __init__(self, stream: IO[bytes]) -> None:
        self.requests: SimpleQueue[Generate] = SimpleQueue()
        self._stream = stream
        self._cancelled = 0
        self.current = 0
        threading.Thread(target=self._listen, daemon=True).start()

    def stopped(self) -> bool:
        """Return True if the current generation was cancelled."""
        return self.current <= self._cancelled

    def _listen(self) -> None:
        for line in self._stream:
            message = ToWorker.validate_json(line)
            if isinstance(message, Cancel):
                self._cancelled = max(self._cancelled, message.id)
            elif isinstance(message, Generate):
                self.requests.put(message)
        os._exit(0)


def serve(load: Load, inbox: Inbox, outbox: IO[bytes], reading: Restriction) -> None:
    """Load a model, then answer requests one after another.

    `reading` is the restriction that was set before the process started its first thread.
    """

    def send(message: StrictModel) -> None:
        outbox.write(encode(message))

    files: dict[PinnedFile, CheckedFile] = {}
    try:
        with ThreadPoolExecutor(1) as hashing:
            opened = hashing.submit(_open, (load.weights, *load.adapters.values()))
            from pa_console.llm.local.decoding import ChatPrompt, Decoder  # noqa: PLC0415
            from pa_console.llm.local.runtime import Runtime  # noqa: PLC0415
            from pa_console.llm.local.threads import FreeCores  # noqa: PLC0415

            cores = FreeCores(load.threads, fixed=load.fixed)
            files = opened.result()
        size = sum(file.size for file in files.values())
        restrictions = (reading, *confine(size, load.threads))
        if load.require_sandbox:
            require_all(restrictions)
        for pin in set(load.adapters.values()):
            check_gguf(files[pin].route, "adapter", name=files[pin].path)
        weights = files[load.weights]
        quantised = check_gguf(weights.route, "model", name=weights.path)
        inbox.current = 1
        runtime = Runtime(
            weights.route,
            n_ctx=load.n_ctx,
            cores=cores,
            stopped=inbox.stopped,
            adapters={SEQUENCES[role]: files[pin].route for role, pin in load.adapters.items()},
            # llama.cpp copies most quantised weights into another layout, and a mapped file would
            # stay in memory beside the copy.
            mapped=not quantised,
        )
        chat, decoder = ChatPrompt(runtime, load.chat), Decoder(runtime)
        _check(files.values())
    except Exception as error:  # the parent must be informed of any error
        send(LoadFailed(error=_in_words(error, files.values())))
        return
    unconfined = gaps(restrictions)
    send(Ready(n_ctx=runtime.n_ctx, description=runtime.description, unconfined=unconfined))
    while True:
        request = inbox.requests.get()
        try:
            _check(files.values())
        except (OSError, ValueError) as error:
            send(LoadFailed(error=str(error)))
            return
        inbox.current = request.id
        try:
            done = _answer(decoder, chat, request, send)
        except (ValueError, RuntimeError) as error:
            send(GenerationFailure(id=request.id, error=str(error)))
        else:
            send(done.model_copy(update={"slowed": runtime.cores.busy()}))


def _open(pins: Iterable[PinnedFile]) -> dict[PinnedFile, CheckedFile]:
    """Open every file once and hash it; raises ValueError if a file is not the pinned one."""
    return {pin: CheckedFile(pin.path, pin.sha256) for pin in set(pins)}


def _check(files: Iterable[CheckedFile]) -> None:
    """Raise ValueError if a file in use has changed; this takes 10 µs."""
    for file in files:
        file.check()


def _in_words(error: Exception, files: Iterable[CheckedFile]) -> str:
    """Return the text of an error, with the names of files instead of their descriptors."""
    text = str(error) or type(error).__name__
    for file in files:
        text = text.replace(f"{file.route}:", f"{file.path}:")
    return text


def _answer(
    decoder: "Decoder", chat: "ChatPrompt", message: Generate, send: Callable[[StrictModel], None]
) -> Done:
    """Write one answer piece by piece, or several at once; return how the generation ended."""
    request = message.request
    sequence = SEQUENCES[request.role]
    prompt = chat.tokens(request.system, request.user)
    if request.count == 1:
        finish, usage = decoder.answer(
            sequence, prompt, request, lambda text: send(TextPiece(id=message.id, text=text))
        )
        return Done(id=message.id, finish=finish, usage=usage, chances=decoder.chances)
    texts, finish, usage = decoder.several(sequence, prompt, request)
    return Done(id=message.id, finish=finish, usage=usage, texts=tuple(texts))


def _first(stream: IO[bytes]) -> Load:
    """Return the parent's first message, which names the files to load."""
    line = stream.readline()
    if not line:
        sys.exit(0)
    load = ToWorker.validate_json(line)
    if not isinstance(load, Load):
        raise TypeError("the first message must be Load")
    return load


def main() -> None:
    """Reserve the pipes to the parent for messages, then load the model and answer requests."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    incoming, outgoing = os.dup(0), os.dup(1)
    nothing = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):
        os.dup2(nothing, descriptor)
    stream = os.fdopen(incoming, "rb")
    load = _first(stream)
    reading = read_only(pin.path for pin in (load.weights, *load.adapters.values()))
    try:
        serve(load, Inbox(stream), os.fdopen(outgoing, "wb", buffering=0), reading)
    except BrokenPipeError:
        sys.exit(0)


if __name__ == "__main__":
    main()
