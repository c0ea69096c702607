"""Tokenised packs in one small file: what a machine without a network and a tokeniser learns from.

A file holds flat arrays, compressed with LZMA: the tokens of every pack one after another, and how
long prefixes, branches and answers are. Tokens repeat much, so that a sample takes some 40 bytes.
"""

import io
import lzma
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

_ARRAYS = ("tokens", "prefixes", "branches", "lengths", "answers", "given")


@dataclass(frozen=True)
class Branch:
    """What continues a prefix: `tokens` (all that is read), of which the last are predicted.

    `targets` are what these positions predict; `learnt` is False for what the grammar writes.
    """

    tokens: NDArray[np.int32]
    targets: NDArray[np.int32]
    learnt: NDArray[np.bool_]


@dataclass(frozen=True)
class Pack:
    """A prefix and its branches."""

    prefix: NDArray[np.int32]
    branches: tuple[Branch, ...]

    @property
    def size(self) -> int:
        """Tokens that are computed."""
        return len(self.prefix) + sum(len(branch.tokens) for branch in self.branches)

    @property
    def longest(self) -> int:
        """Tokens of the longest branch."""
        return max(len(branch.tokens) for branch in self.branches)


def write_corpus(path: Path, packs: Iterable[Pack]) -> int:
    """Write `packs` to `path` and return its size in bytes; raises OSError."""
    tokens: list[NDArray[np.int32]] = []
    prefixes, counts, lengths, answers = (list[int]() for _ in range(4))
    given: list[NDArray[np.bool_]] = []
    for pack in packs:
        tokens.append(pack.prefix)
        prefixes.append(len(pack.prefix))
        counts.append(len(pack.branches))
        for branch in pack.branches:
            tokens += [branch.tokens, branch.targets[-1:]]
            lengths.append(len(branch.tokens))
            answers.append(len(branch.targets))
            given.append(~branch.learnt)
    flat = np.concatenate(tokens)
    arrays: Mapping[str, NDArray[np.generic]] = {
        "tokens": flat.astype(np.uint16 if flat.max(initial=0) < 2**16 else np.uint32),
        "prefixes": np.array(prefixes, np.uint16),
        "branches": np.array(counts, np.uint16),
        "lengths": np.array(lengths, np.uint16),
        "answers": np.array(answers, np.uint16),
        "given": np.packbits(np.concatenate(given)),
    }
    stream = io.BytesIO()
    np.savez(stream, **arrays)  # type: ignore[arg-type]
    packed = lzma.compress(stream.getvalue(), preset=6)
    path.write_bytes(packed)
    return len(packed)


def read_corpus(path: Path) -> list[Pack]:
    """Read the packs at `path`; raises ValueError when it is no such file, or OSError."""
    try:
        loaded = np.load(io.BytesIO(lzma.decompress(path.read_bytes())))
        tokens, prefixes, counts, lengths, answers, given = (loaded[name] for name in _ARRAYS)
    except (lzma.LZMAError, KeyError, ValueError) as error:
        raise ValueError(f"{path}: is no corpus: {error}: make it anew") from error
    tokens = tokens.astype(np.int32)
    learnt = ~np.unpackbits(given, count=int(answers.sum())).astype(bool)
    packs: list[Pack] = []
    at = number = mark = 0
    for prefix, count in zip(prefixes.tolist(), counts.tolist(), strict=True):
        head, at = tokens[at : at + prefix], at + prefix
        branches: list[Branch] = []
        for _ in range(count):
            length, answer = int(lengths[number]), int(answers[number])
            whole, at = tokens[at : at + length + 1], at + length + 1
            own, mark = learnt[mark : mark + answer], mark + answer
            branches.append(Branch(whole[:-1], whole[len(whole) - answer :], own))
            number += 1
        packs.append(Pack(head, tuple(branches)))
    return packs
