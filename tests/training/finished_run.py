"""A training run and its data set on disk, as the verbs leave them, without any training."""

import hashlib
from pathlib import Path

from pa_console.llm.models.cache import hash_file
from pa_training.adapters.config import TrainConfig
from pa_training.results.lineage import ADAPTER, RunSummary, write_summary
from pa_training.samples.data_report import write_report
from pa_training.samples.data_set import DataFolder, Made
from pa_training.samples.sample import Sample

CURVE = """\
step,minutes,samples,train_loss,validation_loss,validation_right
50,1,400,2.5,2.25,0.125
100,2,800,1.5,1.75,0.5
"""


def data_set(folder: Path) -> Path:
    """Fill `folder` with two samples of one group."""
    samples = tuple(
        Sample(group="g", system="s", picture="p", rest="r", answer="{}", task="planner", kind=kind)
        for kind in ("go/target", "look")
    )
    made = Made(
        name="g",
        valid=False,
        generator="0123456789ab",
        samples=samples,
        dropped={"go: checks WF-03": 4},
    )
    DataFolder(folder).add(made)
    write_report(folder)
    return folder


def finished_run(folder: Path, data: Path) -> Path:
    """Fill `folder` with a run of the planner on the data set in `data`."""
    folder.mkdir(parents=True)
    (folder / ADAPTER).write_bytes(b"GGUF adapter")
    (folder / "curve.csv").write_text(CURVE)
    samples = data / "planner.jsonl"
    write_summary(
        folder,
        RunSummary(
            config=TrainConfig(task="planner", base="smollm2-135m", data=str(samples)),
            finished=True,
            step=100,
            steps=100,
            minutes=2.0,
            validation_loss=1.75,
            validation_right=0.5,
            base_sha256="b" * 64,
            data_sha256=hash_file(samples),
            adapter_sha256=hashlib.sha256(b"GGUF adapter").hexdigest(),
            versions={"torch": "2.0"},
            machine=("a small machine",),
        ),
    )
    return folder
