"""Small models and data sets that training is tried on.

Tests that train need the extra `train`; without it they are left out, and `test_verbs.py` says so.
"""

from importlib.util import find_spec
from pathlib import Path

import pytest

from pa_training.samples.sample import Sample
from pa_training.verbs.run import NEEDED
from tests.training.adapters.sample_files import write_samples
from tests.training.adapters.tiny import write_tiny

TRAINING = ["test_lineage_of_files.py", "test_parity.py", "test_start.py", "test_trainer.py"]
collect_ignore = [] if all(map(find_spec, NEEDED)) else TRAINING


@pytest.fixture(scope="session")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny(tmp_path_factory.mktemp("tiny") / "tiny.gguf")


@pytest.fixture(scope="session")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three groups of samples whose answers follow from their prompts."""
    path = tmp_path_factory.mktemp("data") / "data.jsonl"
    samples = [
        Sample(
            group=f"g{group}",
            system="Plan.",
            picture=f"Gate{group}: nobody\n",
            rest=f"Mission: {word}",
            answer=f'{{"do": "{word[:2]}"}}',
            task="planner",
            kind="go",
        )
        for group in range(3)
        for word in ("go east", "look west", "hold", "report")
    ]
    write_samples(path, samples)
    return path
