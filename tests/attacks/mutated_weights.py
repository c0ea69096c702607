"""llama.cpp and damaged GGUF files.

The header of each file is checked; what passes is loaded, and a prompt evaluated, by a process that
is confined like the worker. A process that dies or hangs is a hit.
"""

import os
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from random import Random
from typing import NamedTuple

import gguf
import numpy as np

from pa_console.llm.models.gguf_bounds import GgufKind, check_gguf
from tests.training.adapters.tiny import HIDDEN, LAYERS, WIDTH, write_tiny

RANK = 4
LIMIT_S = 20
"""The longest time for a small file."""
EXTREMES = (0, 1, 2, 3, 7, 63, 64, 255, 1 << 15, 1 << 31, (1 << 32) - 1, 1 << 62, (1 << 64) - 1)
Place = tuple[int, int]
"""Where a number or a text of a header stands: its offset and its size, bytes."""
Outcome = str


class Damaged(NamedTuple):
    """A damaged file, and how it was damaged."""

    kind: GgufKind
    how: str
    content: bytes


def write_adapter(path: Path) -> Path:
    """Write an adapter for the model of `write_tiny` to `path`."""
    writer = gguf.GGUFWriter(path, "llama")
    writer.add_type("adapter")
    writer.add_string("adapter.type", "lora")
    writer.add_float32("adapter.lora.alpha", 8.0)
    random = np.random.default_rng(1)
    for layer in range(LAYERS):
        for part, wide in (("attn_q", WIDTH), ("attn_output", WIDTH), ("ffn_gate", HIDDEN)):
            for half, shape in (("lora_a", (RANK, WIDTH)), ("lora_b", (wide, RANK))):
                values = random.normal(0.0, 0.1, shape).astype(np.float16)
                writer.add_tensor(f"blk.{layer}.{part}.weight.{half}", values)
    writer.write_header_to_file()
    writer.write_kv_data_to_file()
    writer.write_tensors_to_file()
    writer.close()
    return path


def places(path: Path) -> list[Place]:
    """Return every number and text of the header of `path`."""
    reader = gguf.GGUFReader(path)
    found: list[Place] = []
    for field in (*reader.fields.values(), *(tensor.field for tensor in reader.tensors)):
        at = field.offset
        for part in field.parts:
            found.append((at, part.nbytes))
            at += part.nbytes
    return [place for place in found if place[1]]


class Damage:
    """Damages the file at `path`, each time in another way."""

    def __init__(self, path: Path, kind: GgufKind, random: Random) -> None:
        self._kind: GgufKind = kind
        self._whole, self._random = path.read_bytes(), random
        self._places = places(path)
        self._end = max(at + size for at, size in self._places)
        """The end of the header."""

    def file(self) -> Damaged:
        """Return the next damaged file."""
        way = self._random.choice((
            self._number, self._number, self._number, self._bits, self._text, self._cut,
            self._twice, self._missing, self._neighbour,
        ))  # fmt: skip
        return Damaged(self._kind, way.__name__.strip("_"), way())

    def _put(self, at: int, value: bytes) -> bytes:
        return self._whole[:at] + value + self._whole[at + len(value) :]

    def _number(self) -> bytes:
        """Put an extreme number in the place of a number."""
        numbers = [place for place in self._places if place[1] in (1, 4, 8)]
        at, size = self._random.choice(numbers)
        near = int.from_bytes(self._whole[at : at + size], "little")
        value = self._random.choice((*EXTREMES, near - 1, near + 1, 2 * near, len(self._whole)))
        return self._put(at, (value % (1 << 8 * size)).to_bytes(size, "little"))

    def _bits(self) -> bytes:
        """Flip some bits of the header."""
        content = bytearray(self._whole)
        for _ in range(self._random.randint(1, 16)):
            content[self._random.randrange(self._end)] ^= 1 << self._random.randrange(8)
        return bytes(content)

    def _text(self) -> bytes:
        """Put random bytes in the place of a text or a number."""
        at, size = self._random.choice(self._places)
        return self._put(at, self._random.randbytes(size))

    def _cut(self) -> bytes:
        """Cut the file, within its header or its weights."""
        return self._whole[: self._random.choice((self._end, len(self._whole))) * 7 // 8]

    def _twice(self) -> bytes:
        """Put a part of the header there twice."""
        at, size = self._random.choice(self._places)
        return self._whole[: at + size] + self._whole[at:]

    def _missing(self) -> bytes:
        """Leave a part of the header out."""
        at, size = self._random.choice(self._places)
        return self._whole[:at] + self._whole[at + size :]

    def _neighbour(self) -> bytes:
        """Copy a part of the header over another one of the same size."""
        at, size = self._random.choice(self._places)
        other = self._random.choice([place for place in self._places if place[1] == size])
        return self._put(at, self._whole[other[0] : other[0] + size])


def damaged_files(folder: Path, count: int, seed: int) -> Iterator[Damaged]:
    """Yield damaged models and adapters, three models to two adapters; writes into `folder`."""
    random = Random(seed)
    model = Damage(write_tiny(folder / "whole.gguf"), "model", random)
    adapter = Damage(write_adapter(folder / "whole.lora.gguf"), "adapter", random)
    for number in range(count):
        yield (adapter if number % 5 < 2 else model).file()


def tried(path: Path, kind: GgufKind, whole: Path) -> Outcome:
    """Return what comes of loading `path` in a confined process of its own.

    "loaded", "refused" with a clear error, or else how it died. `whole` is the model for adapters.
    """
    try:
        check_gguf(str(path), kind)
    except ValueError as error:
        return "refused" if str(path) in str(error) else "an unclear error"
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        code = 99
        try:
            code = _load(path, kind, whole)
        finally:
            os._exit(code)
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        return signal.Signals(os.WTERMSIG(status)).name
    return {0: "loaded", 1: "refused"}.get(os.WEXITSTATUS(status), "another error")


def _load(path: Path, kind: GgufKind, whole: Path) -> int:
    """Load as the worker does; return 0 if it answers, 1 if it is refused with a clear error."""
    from pa_console.llm.local.confinement import confine, read_only  # noqa: PLC0415 - in the child
    from pa_console.llm.local.runtime import Runtime  # noqa: PLC0415
    from pa_console.llm.local.threads import FreeCores  # noqa: PLC0415

    signal.alarm(LIMIT_S)
    os.dup2(os.open(os.devnull, os.O_RDWR), 2)
    read_only((str(path), str(whole)))
    confine(path.stat().st_size, 1)
    try:
        model, adapters = (path, None) if kind == "model" else (whole, {0: str(path)})
        runtime = Runtime(
            str(model),
            n_ctx=512,
            cores=FreeCores(1, fixed=True),
            stopped=lambda: False,
            adapters=adapters,
        )
        runtime.begin(0, runtime.tokenise("Where is the gate?", special=True) or [0])
    except (ValueError, RuntimeError):
        return 1
    return 0


def campaign(count: int, seed: int) -> tuple[list[str], list[str]]:
    """Try so many damaged files; return how often each outcome came, and the hits."""
    import_module("pa_console.llm.local.runtime")  # once, for all processes
    outcomes, hits = Counter[str](), list[str]()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for damaged in damaged_files(folder, count, seed):
            path = folder / "damaged.gguf"
            path.write_bytes(damaged.content)
            outcome = tried(path, damaged.kind, folder / "whole.gguf")
            outcomes[f"{damaged.kind} {outcome}"] += 1
            if outcome not in ("loaded", "refused"):
                hits.append(f"{damaged.kind}: {damaged.how}: {outcome}")
    return [f"{outcome}: {times}" for outcome, times in sorted(outcomes.items())], hits
