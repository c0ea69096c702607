"""Samples as the very tokens that the model will meet when it runs.

Prompts go through the product's own `ChatPrompt`. An answer is tokenised plainly, which is what
decoding under a grammar comes to: llguidance forces a token only where no other can follow
(tests/training/lora/test_tokens.py replays answers through the real grammars).
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pa_console.llm.catalog import ChatFormat
from pa_console.llm.chat import ChatPrompt
from pa_console.llm.runtime import Runtime
from pa_console.training.samples import Sample

Tokens = NDArray[np.int32]


@dataclass(frozen=True)
class Branch:
    """One sample behind the shared prefix.

    `tokens` are the rest of the prompt, then the answer without its last token; `targets` is the
    answer: what the last `len(targets)` of `tokens` are to predict, each with its weight. A
    weight of zero is that of a token which the grammar writes.
    """

    tokens: Tokens
    targets: Tokens
    weights: NDArray[np.float32]


@dataclass(frozen=True)
class Pack:
    """A prefix and the samples that continue it."""

    prefix: Tokens
    branches: tuple[Branch, ...]

    @property
    def size(self) -> int:
        """Tokens that are computed."""
        return len(self.prefix) + sum(len(branch.tokens) for branch in self.branches)

    @property
    def loss_weight(self) -> float:
        """Sum of the weights of all tokens that are to be predicted."""
        return float(sum(branch.weights.sum() for branch in self.branches))


class Tokeniser:
    """The chat format and vocabulary of one model file."""

    def __init__(self, path: Path, chat: ChatFormat) -> None:
        """Load the vocabulary of the file at `path`; raises ValueError when it is no model."""
        self._runtime = Runtime(str(path), n_ctx=64, threads=1, stopped=lambda: False)
        self._chat = ChatPrompt(self._runtime, chat)

    def prompt(self, sample: Sample) -> list[int]:
        """Return the prompt of `sample` up to where the model answers."""
        return self._chat.tokens(sample.system, sample.picture + sample.rest)

    def around(self, system: str, picture: str) -> tuple[list[int], list[int]]:
        """Return the prompt up to the end of `picture`, and what stands behind the user's turn."""
        whole = self._chat.tokens(system, picture)
        end = self._chat.closing()
        return whole[: len(whole) - len(end)], end

    def text(self, words: str) -> list[int]:
        """Return the tokens of `words` within a user's turn."""
        return self._runtime.tokenise(words, special=False)

    def answer(self, sample: Sample) -> list[int]:
        """Return the answer of `sample` and, if it is whole, the token that ends it."""
        written = self._runtime.tokenise(sample.answer, special=False)
        return written if sample.goes_on else [*written, self._runtime.end_token]

    def weights(self, sample: Sample) -> NDArray[np.float32]:
        """Return the weight of every token of `answer`: none within what is given."""
        tokens = self.answer(sample)
        weights = np.full(len(tokens), sample.weight, np.float32)
        if sample.given:
            written = tokens if sample.goes_on else tokens[:-1]
            lengths = [len(self._runtime.token_text(token)) for token in written]
            ends = np.cumsum(lengths)
            begin = sample.answer.index(sample.given)
            inside = (ends - lengths >= begin) & (ends <= begin + len(sample.given))
            weights[: len(written)][inside] = 0.0
        return weights


def make_packs(samples: Iterable[Sample], tokeniser: Tokeniser, most_tokens: int) -> list[Pack]:
    """Pack samples that share a prefix, at most `most_tokens` together where there are several.

    Groups and their samples stay in the order of the file.
    """
    groups: dict[tuple[str, str, str], list[Sample]] = {}
    for sample in samples:
        groups.setdefault((sample.group, sample.system, sample.picture), []).append(sample)
    return [
        pack for group in groups.values() for pack in _pack_group(group, tokeniser, most_tokens)
    ]


def _pack_group(
    samples: Sequence[Sample], tokeniser: Tokeniser, most_tokens: int
) -> Iterator[Pack]:
    """Yield packs of one group, filled in order."""
    prompts = [tokeniser.prompt(sample) for sample in samples]
    shared = _shared(prompts)
    branches = [
        _branch(prompt[shared:], tokeniser.answer(sample), tokeniser.weights(sample))
        for prompt, sample in zip(prompts, samples, strict=True)
    ]
    prefix = np.array(prompts[0][:shared], np.int32)
    together: list[Branch] = []
    size = shared
    for branch in branches:
        if together and size + len(branch.tokens) > most_tokens:
            yield Pack(prefix, tuple(together))
            together, size = [], shared
        together.append(branch)
        size += len(branch.tokens)
    yield Pack(prefix, tuple(together))


def _branch(rest: Sequence[int], answer: Sequence[int], weights: NDArray[np.float32]) -> Branch:
    return Branch(np.array([*rest, *answer[:-1]], np.int32), np.array(answer, np.int32), weights)


def _shared(prompts: Sequence[Sequence[int]]) -> int:
    """Return how many tokens all prompts begin with, leaving each one of its own at least."""
    most = min(map(len, prompts)) - 1
    columns = zip(*(prompt[:most] for prompt in prompts), strict=True)
    return sum(1 for _ in takewhile(lambda column: len(set(column)) == 1, columns))
