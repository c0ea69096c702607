"""Planner samples cut down to what was understood of the mission, which is what is hard to learn.

Rules, facts and commands make up more than half of a sample and follow from what was understood.
Without them two to three times as many missions are read in the same time.
"""

import random
from collections.abc import Iterable, Iterator

from pa_console.llm.reading import asked_words
from pa_console.training.samples import Sample

_REASON = '{"reason": "'
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
    reason = sample.answer.removeprefix(_REASON).partition('", "actions"')[0]
    asked = asked_words(reason)
    if not asked:
        return sample
    cut = sample.answer.find(" ", len(_REASON) + len(asked))
    mission = f"\n{sample.rest}".partition(_MISSION)[2]
    return sample.model_copy(
        update={
            "rest": _MISSION.lstrip() + mission,
            "answer": sample.answer[:cut],
            "goes_on": True,
        }
    )
