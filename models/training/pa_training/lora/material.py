"""What a run learns from: samples as the tokens that the model meets, in packs.

Rules, facts and commands make up more than half of a sample and follow from what was understood.
Without them two to three times as many missions are read in the same time. A judge reads missions
as well, and for that no plan has to be carried out: the planner's samples tell what was asked.

Prompts go through the product's own `ChatPrompt`. An answer is tokenised plainly, which is what
decoding under a grammar comes to: llguidance forces a token only where no other can follow
(tests/training/lora/test_tokens.py replays answers through the real grammars).
"""

import random
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import takewhile
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from pa_console.llm.models.catalogue import ChatFormat
from pa_console.llm.roles.compact_prompt import TASKS
from pa_console.llm.roles.grammar import PLANNED
from pa_console.llm.worker.chat import ChatPrompt
from pa_console.llm.worker.runtime import Runtime
from pa_console.llm.worker.threads import FreeCores
from pa_console.orders.reading import asked_words
from pa_training.lora.config import TrainConfig
from pa_training.lora.packs import Branch, Pack
from pa_training.samples.sample import Sample, read_samples

OTHERS = "others"
_SPOKEN = "spoken"


def drawn(samples: Iterable[Sample], shares: Mapping[str, float], seed: int) -> Iterator[Sample]:
    """Yield a share of `samples`, by the first word of their kind: `compound` of `compound/2`.

    What was worded without templates may have a share of its own, `compound/spoken`; what is not
    named has that of `others`, or is learnt whole. Equal seeds draw the same samples.
    """
    for sample in samples:
        chance = random.Random(f"shares/{seed}/{sample.group}/{sample.rest}").random()
        if chance < _share(sample.kind, shares):
            yield sample


def _share(kind: str, shares: Mapping[str, float]) -> float:
    parts = kind.split("/")
    keys = [parts[0], OTHERS]
    if parts[-1] == _SPOKEN:
        keys = [way for key in keys for way in (f"{key}/{_SPOKEN}", key)]
    return next((shares[key] for key in keys if key in shares), 1.0)


_REASON, _FEEDBACK = '{"reason": "', '{"feedback": "'
_MISSION = "\nMission: "


def readings(samples: Iterable[Sample], share: float, seed: int) -> Iterator[Sample]:
    """Yield `samples`, those of a `share` (0 to 1) of the groups cut down to their readings."""
    for sample in samples:
        drawn = random.Random(f"readings/{seed}/{sample.group}").random() < share
        yield reading_of(sample) if drawn and sample.task == "planner" else sample


def reading_of(sample: Sample) -> Sample:
    """Return `sample` without its rules and with its answer up to the first word after the reading.

    That word tells that nothing more was asked. A sample whose reason has no reading stays whole.
    """
    asked = _asked(sample)
    if not asked:
        return sample
    return _begun(sample, sample.answer[: sample.answer.find(" ", len(_REASON) + len(asked))])


def judge_readings(samples: Iterable[Sample]) -> Iterator[Sample]:
    """Yield what the judge is to read of the missions of planner `samples`, where they tell it.

    Its answer begins with the same words, and goes on with what was planned.
    """
    for sample in samples:
        asked = _asked(sample).removesuffix("; ")
        if asked:
            begun = _begun(sample, f"{_FEEDBACK}{asked}{PLANNED.rstrip(': ')}")
            system = begun.system.replace(TASKS["planner"], TASKS["judge"], 1)
            yield begun.model_copy(update={"system": system, "task": "judge"})


def _asked(sample: Sample) -> str:
    """Return how the reason of a planner's sample begins, '' where that is no reading."""
    return asked_words(sample.answer.removeprefix(_REASON).partition('", "actions"')[0])


def _begun(sample: Sample, answer: str) -> Sample:
    """Return `sample` without its rules, with only the beginning of an answer."""
    mission = f"\n{sample.rest}".partition(_MISSION)[2]
    return sample.model_copy(
        update={"rest": _MISSION.lstrip() + mission, "answer": answer, "goes_on": True}
    )


class Tokeniser:
    """The chat format and vocabulary of one model file."""

    def __init__(self, path: Path, chat: ChatFormat) -> None:
        """Load the vocabulary of the file at `path`; raises ValueError when it is no model."""
        self._runtime = Runtime(str(path), n_ctx=64, cores=FreeCores(1), stopped=lambda: False)
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


def packs_to_learn(config: TrainConfig, tokeniser: Tokeniser) -> list[Pack]:
    """Return the samples of `config`, of a judge also the missions that it learns to read.

    Raises OSError, and ValueError for a file that holds no sample of the task.
    """
    packs = _packs(config, Path(config.data), tokeniser, config.readings, config.shares)
    if config.missions is not None and config.task == "judge":
        missions = read_samples(Path(config.missions), "planner")
        packs += make_packs(judge_readings(missions), tokeniser, config.pack_tokens)
    return packs


def packs_held_out(config: TrainConfig, tokeniser: Tokeniser) -> list[Pack]:
    """Return whole packs of the validation file until there are samples enough."""
    if config.validation is None:
        return []
    kept: list[Pack] = []
    for pack in _packs(config, Path(config.validation), tokeniser):
        if sum(len(p.branches) for p in kept) >= config.validation_samples:
            break
        kept.append(pack)
    return kept


def _packs(
    config: TrainConfig,
    path: Path,
    tokeniser: Tokeniser,
    short: float = 0.0,
    shares: Mapping[str, float] = MappingProxyType({}),
) -> list[Pack]:
    """Return `shares` of the samples of `path` as packs, some cut down to their readings.

    Raises ValueError when there is none of the task.
    """
    samples = drawn(read_samples(path, config.task), shares, config.seed)
    packs = make_packs(readings(samples, short, config.seed), tokeniser, config.pack_tokens)
    if not packs:
        raise ValueError(f"{path}: holds no sample for the {config.task}")
    return packs
