"""Which share of the samples of each kind is learnt: more of what is hard, less of what is not."""

import random
from collections.abc import Iterable, Iterator, Mapping

from pa_console.training.samples import Sample

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
