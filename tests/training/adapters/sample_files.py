"""Writes sample files for the tests of the trainer."""

from collections.abc import Iterable
from pathlib import Path

from pa_training.samples.sample import Sample


def write_samples(path: Path, samples: Iterable[Sample]) -> int:
    """Write `samples` to `path`, one JSON object a line, and return how many there were."""
    count = 0
    with path.open("w", encoding="utf-8") as stream:
        for sample in samples:
            stream.write(sample.model_dump_json() + "\n")
            count += 1
    return count
