"""Which samples a run learns, and which of them only up to what was understood.

Rules, facts and commands make up more than half of a sample and follow from what was understood.
Without them two to three times as many missions are read in the same time. A judge reads missions
as well, and for that no plan has to be carried out: the planner's samples tell what was asked.
"""

import random
from collections.abc import Iterable, Iterator, Mapping

from pa_console.language.canonical.reading import asked_words
from pa_console.llm.roles.grammar import PLANNED
from pa_console.llm.roles.prompts import TASKS
from pa_training.samples.sample import Sample

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
_BEFORE, _MISSION = "\nBefore: ", "\nMission: "


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
    held, said, mission = f"\n{sample.rest}".partition(_MISSION)
    _, before, commands = held.partition(_BEFORE)
    words = "".join((before, commands, said)).lstrip() + mission
    return sample.model_copy(update={"rest": words, "answer": answer, "goes_on": True})
