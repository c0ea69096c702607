"""A run learns, can be stopped and resumed without a trace, and says what is wrong."""

import json
import os
import signal
from pathlib import Path

import gguf
import pytest
import torch

from pa_training.lora.checkpoint import CHECKPOINT, CURVE, LOG, RunFolder
from pa_training.lora.config import TrainConfig, shipped_config
from pa_training.lora.export import export_adapter
from pa_training.lora.loop import Progress, learning_rate, train
from tests.training.lora.small_run import config, ignore


def logged(out: Path) -> list[dict[str, float]]:
    """Return the log without what the clock says."""
    lines = [json.loads(line) for line in (out / LOG).read_text().splitlines()]
    return [{k: line[k] for k in ("step", "loss", "rate", "norm", "tokens")} for line in lines]


def test_a_run_learns_and_draws_its_curve(tiny: Path, data: Path, tmp_path: Path) -> None:
    seen: list[Progress] = []
    result = train(config(tiny, data, steps=40), tmp_path / "run", False, seen.append)
    assert result.finished
    assert [progress.step for progress in seen] == list(range(1, 41))
    assert seen[-1].loss < 0.7 * seen[0].loss
    rows = (tmp_path / "run" / CURVE).read_text().splitlines()[1:]
    assert [int(row.split(",")[0]) for row in rows] == list(range(4, 41, 4))
    losses = [float(row.split(",")[4]) for row in rows]
    assert losses[-1] < losses[0]
    assert result.last.validation_loss == pytest.approx(losses[-1], rel=1e-4)


def test_ctrl_c_saves_and_the_resumed_run_is_the_uninterrupted_one(
    tiny: Path, data: Path, tmp_path: Path
) -> None:
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    train(config(tiny, data), whole, False, ignore)

    def interrupt(progress: Progress) -> None:
        if progress.step == 3:
            os.kill(os.getpid(), signal.SIGINT)

    first = train(config(tiny, data), parts, False, interrupt)
    assert not first.finished
    assert first.last.step == 3
    second = train(config(tiny, data, seed=9), parts, True, ignore)
    assert second.finished
    assert logged(parts) == logged(whole)
    states = [RunFolder(out).load() for out in (whole, parts)]
    for one, other in zip(states[0].masters, states[1].masters, strict=True):
        assert torch.equal(one, other)


def test_what_was_logged_after_the_checkpoint_is_forgotten(
    tiny: Path, data: Path, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    stopped_at: list[bytes] = []

    def keep(progress: Progress) -> None:
        if progress.step == 2:
            os.kill(os.getpid(), signal.SIGINT)

    train(config(tiny, data), out, False, keep)
    stopped_at.append((out / CHECKPOINT).read_bytes())
    train(config(tiny, data), out, True, ignore)
    whole = logged(out)
    (out / CHECKPOINT).write_bytes(stopped_at[0])
    train(config(tiny, data), out, True, ignore)
    assert logged(out) == whole


def test_the_seed_decides_the_result_and_the_workers_do_not(
    tiny: Path, data: Path, tmp_path: Path
) -> None:
    runs = {"one": (1, 1), "two": (1, 2), "other": (2, 2)}
    for name, (seed, workers) in runs.items():
        chosen = config(tiny, data, seed=seed, workers=workers, steps=3)
        train(chosen, tmp_path / name, False, ignore)
    one, two, other = ([line["loss"] for line in logged(tmp_path / name)] for name in runs)
    assert one == pytest.approx(two, rel=1e-5)
    assert one != pytest.approx(other, rel=1e-5)


def test_a_run_keeps_the_format_that_its_machine_computes_in(
    tiny: Path, data: Path, tmp_path: Path
) -> None:
    train(config(tiny, data, steps=1, precision="auto"), tmp_path / "run", False, ignore)
    chosen = RunFolder(tmp_path / "run").config().precision
    assert chosen in ("bfloat16", "float32")
    named = config(tiny, data, steps=1, precision=chosen)
    train(named, tmp_path / "named", False, ignore)
    assert logged(tmp_path / "run") == logged(tmp_path / "named")


@pytest.mark.parametrize("precision", ["bfloat16", "float32", "int8"])
def test_a_run_learns_in_the_format_that_it_is_told(
    tiny: Path, data: Path, tmp_path: Path, precision: str
) -> None:
    out = tmp_path / "run"
    train(config(tiny, data, precision=precision), out, False, ignore)
    losses = [line["loss"] for line in logged(out)]
    assert losses[-1] < losses[0]
    assert RunFolder(out).config().precision == precision


def test_an_exported_run_says_where_it_comes_from(tiny: Path, data: Path, tmp_path: Path) -> None:
    train(config(tiny, data, steps=2), tmp_path / "run", False, ignore)
    target = tmp_path / "models" / "planner.lora.gguf"
    export_adapter(tmp_path / "run", target)
    reader = gguf.GGUFReader(target)
    fields = {name: field.contents() for name, field in reader.fields.items()}
    assert fields["general.type"] == "adapter"
    assert fields["adapter.type"] == "lora"
    assert fields["adapter.lora.alpha"] == 32.0
    assert fields["pa_console.training.samples"] == "16"
    written = json.loads(fields["pa_console.training.config"])
    assert (written["rank"], written["data"]) == (4, data.name)
    assert {tensor.tensor_type.name for tensor in reader.tensors} == {"F16"}
    assert len(reader.tensors) == 2 * 7 * 2


def test_a_run_is_not_overwritten(tiny: Path, data: Path, tmp_path: Path) -> None:
    train(config(tiny, data, steps=1), tmp_path, False, ignore)
    with pytest.raises(ValueError, match="holds a training run already"):
        train(config(tiny, data, steps=1), tmp_path, False, ignore)


def test_a_run_does_not_go_on_with_other_data(tiny: Path, data: Path, tmp_path: Path) -> None:
    own = tmp_path / "own.jsonl"
    own.write_text(data.read_text())
    train(config(tiny, own, steps=1), tmp_path / "run", False, ignore)
    own.write_text(data.read_text().replace("east", "south"))
    with pytest.raises(ValueError, match="base or data changed"):
        train(config(tiny, own), tmp_path / "run", True, ignore)


def test_a_run_does_not_go_on_with_other_missions(tiny: Path, data: Path, tmp_path: Path) -> None:
    judged, read = tmp_path / "judge.jsonl", tmp_path / "planner.jsonl"
    judged.write_text(data.read_text().replace('"planner"', '"judge"'))
    read.write_text(data.read_text())
    chosen = config(tiny, judged, task="judge", validation=str(judged), missions=str(read), steps=1)
    train(chosen, tmp_path / "run", False, ignore)
    read.write_text(data.read_text().replace("east", "south"))
    with pytest.raises(ValueError, match="base or data changed"):
        train(chosen, tmp_path / "run", True, ignore)


def test_nothing_to_resume_is_said(tiny: Path, data: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no training run to go on with"):
        train(config(tiny, data), tmp_path / "none", True, ignore)


def test_data_without_a_sample_of_the_task_is_refused(
    tiny: Path, data: Path, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match="no sample for the judge"):
        train(config(tiny, data, task="judge"), tmp_path / "run", False, ignore)


def test_the_rate_rises_then_falls(tiny: Path, data: Path) -> None:
    chosen = config(tiny, data, steps=100, warmup_steps=10)
    rates = [learning_rate(chosen, step, step / 100) for step in range(100)]
    top = rates.index(max(rates))
    assert 8 <= top <= 11
    assert rates[: top + 1] == sorted(rates[: top + 1])
    assert rates[top:] == sorted(rates[top:], reverse=True)
    assert 0.0 < rates[-1] < 0.1 * chosen.learning_rate


@pytest.mark.parametrize("task", ["planner", "judge"])
def test_the_shipped_configurations_can_be_read(task: str) -> None:
    assert TrainConfig.load(shipped_config(task)).task == task


def test_bytes_are_not_multiplied_on_a_gpu(tiny: Path, data: Path) -> None:
    with pytest.raises(ValueError, match=r"precision\n.*int8 is for device: cpu"):
        config(tiny, data, precision="int8", device="cuda")
