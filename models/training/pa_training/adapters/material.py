"""Samples as tokens: the material that a run learns from.

Prompts go through the product's own `ChatPrompt`. An answer is tokenised plainly, which is what
decoding under a grammar comes to: llguidance forces a token only where no other can follow
(tests/training/adapters/test_tokens.py replays answers through the real grammars).
"""

from collections import defaultdict
from collections.abc import Sequence
from itertools import accumulate, islice
from pathlib import Path
from typing import TypedDict

from pa_console.llm.backend import ChatFormat
from pa_console.llm.local.decoding import ChatPrompt
from pa_console.llm.local.runtime import Runtime
from pa_console.llm.local.threads import FreeCores
from pa_training.adapters.config import TrainConfig
from pa_training.samples.readings import readings
from pa_training.samples.sample import Sample, read_samples

NOT_LEARNT = -100
"""Stands in `Row.targets` for a token that the grammar writes, as torch's losses have it."""


class Row(TypedDict):
    """One sample as tokens.

    `tokens` are the prompt, then the answer without its last token; `targets` are the answer, what
    the last of `tokens` are to predict.
    """

    tokens: list[int]
    targets: list[int]
    length: int
    shared: int
    """The number of first tokens that all samples of its situation have."""
    group: str
    """The situation, the same for samples with the same shared tokens."""


class Tokeniser:
    """The chat format and vocabulary of one model file."""

    def __init__(self, path: Path, chat: ChatFormat) -> None:
        """Load the vocabulary of the file at `path`; raises ValueError when it is no model."""
        self._runtime = Runtime(str(path), n_ctx=64, cores=FreeCores(1), stopped=lambda: False)
        self._chat = ChatPrompt(self._runtime, chat)

    def row(self, sample: Sample) -> Row:
        """Return `sample` as tokens; a whole answer ends with the token that ends it."""
        prompt = self._chat.tokens(sample.system, sample.picture + sample.rest)
        written = self._runtime.tokenise(sample.answer, special=False)
        answer = written if sample.goes_on else [*written, self._runtime.end_token]
        tokens = [*prompt, *answer[:-1]]
        return Row(
            tokens=tokens,
            targets=self._without_given(sample, answer),
            length=len(tokens),
            shared=self._shared(sample, prompt),
            group=f"{sample.system}\n{sample.picture}",
        )

    def _shared(self, sample: Sample, prompt: list[int]) -> int:
        """Return how many tokens of `prompt` any sample of the situation begins with."""
        begun = self._chat.tokens(sample.system, sample.picture)
        pairs = zip(begun, prompt, strict=False)
        return next((n for n, (one, other) in enumerate(pairs) if one != other), len(begun))

    def _without_given(self, sample: Sample, answer: list[int]) -> list[int]:
        """Return `answer` with NOT_LEARNT for every token within the given part."""
        if not sample.given:
            return answer
        begin = sample.answer.index(sample.given)
        end = begin + len(sample.given)
        written = answer if sample.goes_on else answer[:-1]
        ends = list(accumulate(len(self._runtime.token_text(token)) for token in written))
        learnt = [
            NOT_LEARNT if begin <= before and after <= end else token
            for token, before, after in zip(written, [0, *ends], ends, strict=False)
        ]
        return [*learnt, *answer[len(written) :]]


def packs_of(rows: Sequence[Row], most: int) -> list[list[Row]]:
    """Return `rows` in packs of one situation, each of `most` tokens at most.

    The tokens that they share count once. A row that is longer by itself is a pack of its own.
    """
    groups: defaultdict[str, list[Row]] = defaultdict(list)
    for row in rows:
        groups[row["group"]].append(row)
    packs = list[list[Row]]()
    for group in groups.values():
        room = 0
        for row in group:
            own = row["length"] - row["shared"]
            if own > room or not packs or packs[-1][0]["group"] != row["group"]:
                packs.append([])
                room = most - row["shared"]
            packs[-1].append(row)
            room -= own
    return packs


def rows_to_learn(config: TrainConfig, tokeniser: Tokeniser) -> list[Row]:
    """Return the samples of `config`.

    Raises OSError, and ValueError for a file that holds no sample of the task.
    """
    samples = read_samples(Path(config.data), config.task)
    rows = [tokeniser.row(sample) for sample in readings(samples, config.readings, config.seed)]
    if not rows:
        raise ValueError(f"{config.data}: holds no sample for the {config.task}")
    return rows


def rows_held_out(config: TrainConfig, tokeniser: Tokeniser) -> list[Row]:
    """Return the first samples of the validation file, `validation_samples` at most.

    Raises OSError, and ValueError for a file that holds no sample of the task.
    """
    if config.validation is None:
        return []
    samples = read_samples(Path(config.validation), config.task)
    rows = [tokeniser.row(sample) for sample in islice(samples, config.validation_samples)]
    if not rows:
        raise ValueError(f"{config.validation}: holds no sample for the {config.task}")
    return rows
