"""A run learns, can be stopped and resumed without a trace, and says what is wrong."""

import json
import os
import shutil
import signal
from pathlib import Path
from typing import Any

import gguf
import numpy as np
import pytest
import torch

from pa_console.llm.models.cache import hash_file
from pa_training.adapters.adapter_file import AdapterFile, Matrices
from pa_training.adapters.config import TrainConfig, shipped_config
from pa_training.adapters.material import Row, Tokeniser, packs_of, rows_to_learn
from pa_training.adapters.network import adapted, load_base
from pa_training.adapters.run_folder import RunFolder
from pa_training.adapters.trainer import Progress, packed, rate_share, train
from pa_training.results.lineage import ADAPTER, CURVE
from tests.training.adapters.small_run import config, ignore


def logged(out: Path) -> list[dict[str, float]]:
    """Return every step of the run in `out` without what the clock says."""
    checkpoint = RunFolder(out).checkpoint
    assert checkpoint is not None
    lines = json.loads((checkpoint / "trainer_state.json").read_text())["log_history"]
    return [
        {key: line[key] for key in ("step", "loss", "learning_rate", "grad_norm")}
        for line in lines
        if "loss" in line
    ]


def exported(out: Path) -> Matrices:
    return AdapterFile.open(out / ADAPTER).matrices({})


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
    assert (parts / ADAPTER).is_file()
    stopped_at = first.last.step
    assert stopped_at < 8
    second = train(config(tiny, data, seed=9), parts, True, ignore)
    assert second.finished
    assert logged(parts) == logged(whole)
    one, other = exported(whole), exported(parts)
    for name, pair in one.items():
        for left, right in zip(pair, other[name], strict=True):
            np.testing.assert_array_equal(left, right)


def test_the_curve_after_the_checkpoint_is_forgotten(
    tiny: Path, data: Path, tmp_path: Path
) -> None:
    out, kept = tmp_path / "run", tmp_path / "kept"

    def stop(progress: Progress) -> None:
        if progress.step == 2:
            os.kill(os.getpid(), signal.SIGINT)

    train(config(tiny, data), out, False, stop)
    shutil.copytree(out, kept)
    train(config(tiny, data), out, True, ignore)
    rows = [row.split(",")[0] for row in (out / CURVE).read_text().splitlines()]
    shutil.rmtree(out / f"checkpoint-{logged(out)[-1]['step']}")
    shutil.copytree(kept, out, dirs_exist_ok=True, ignore=shutil.ignore_patterns(CURVE))
    train(config(tiny, data), out, True, ignore)
    assert [row.split(",")[0] for row in (out / CURVE).read_text().splitlines()] == rows


def test_the_seed_decides_the_result(tiny: Path, data: Path, tmp_path: Path) -> None:
    for name, seed in (("one", 1), ("same", 1), ("other", 2)):
        train(config(tiny, data, seed=seed, steps=3), tmp_path / name, False, ignore)
    assert logged(tmp_path / "one") == logged(tmp_path / "same")
    first, other = (logged(tmp_path / name)[0]["loss"] for name in ("one", "other"))
    assert first != pytest.approx(other, rel=1e-5)


def summed_loss(network: Any, pack: list[Row]) -> float:
    """Return the loss of a pack, summed over its tokens."""
    batch = packed([{"rows": pack}])
    labels = batch.pop("labels")
    with torch.no_grad():
        logits = network(**batch).logits
    found = torch.nn.functional.cross_entropy(
        logits.flatten(0, 1), labels.flatten(), reduction="sum", ignore_index=-100
    )
    return float(found)


@pytest.mark.parametrize("precision", ["bfloat16", "float32"])
def test_a_run_learns_in_the_format_that_it_is_told(
    tiny: Path, data: Path, tmp_path: Path, precision: str
) -> None:
    out = tmp_path / "run"
    train(config(tiny, data, precision=precision), out, False, ignore)
    losses = [line["loss"] for line in logged(out)]
    assert losses[-1] < losses[0]
    assert RunFolder(out).config().precision == precision


def test_a_run_that_is_given_no_time_ends_at_once_and_is_whole(
    tiny: Path, data: Path, tmp_path: Path
) -> None:
    chosen = config(tiny, data, steps=10_000, max_minutes=1e-6)
    result = train(chosen, tmp_path / "run", False, ignore)
    assert result.finished
    assert result.last.step == 1
    assert result.last.validation_loss is not None


def test_a_run_without_validation_notes_how_far_it_came(
    tiny: Path, data: Path, tmp_path: Path
) -> None:
    result = train(config(tiny, data, validation=None, steps=5), tmp_path / "run", False, ignore)
    assert result.last.validation_loss is None
    rows = (tmp_path / "run" / CURVE).read_text().splitlines()[1:]
    assert [row.split(",")[0] for row in rows] == ["4", "5"]
    assert all(row.endswith("nan,nan") for row in rows)


def test_an_exported_run_says_where_it_comes_from(tiny: Path, data: Path, tmp_path: Path) -> None:
    result = train(config(tiny, data, steps=2), tmp_path / "run", False, ignore)
    target = tmp_path / "run" / ADAPTER
    assert result.adapter_sha256 == hash_file(target)
    reader = gguf.GGUFReader(target)
    fields = {name: field.contents() for name, field in reader.fields.items()}
    assert fields["general.type"] == "adapter"
    assert fields["adapter.type"] == "lora"
    assert fields["adapter.lora.alpha"] == 32.0
    assert fields["pa_console.training.samples"] == "12"
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
    rates = [rate_share(chosen, step, step / 100) for step in range(100)]
    top = rates.index(max(rates))
    assert 8 <= top <= 11
    assert rates[: top + 1] == sorted(rates[: top + 1])
    assert rates[top:] == sorted(rates[top:], reverse=True)
    assert 0.0 < rates[-1] < 0.1


@pytest.mark.parametrize("task", ["planner", "judge"])
def test_the_shipped_configurations_can_be_read(task: str) -> None:
    assert TrainConfig.load(shipped_config(task)).task == task


def test_a_pack_has_the_loss_of_its_samples_alone(tiny: Path, data: Path) -> None:
    chosen = config(tiny, data)
    pack = max(packs_of(rows_to_learn(chosen, Tokeniser(tiny, "template")), 4000), key=len)
    assert len(pack) > 1
    network: Any = adapted(load_base(tiny, chosen), chosen).eval()
    alone = sum(summed_loss(network, [row]) for row in pack)
    assert summed_loss(network, pack) == pytest.approx(alone, rel=1e-4)


def test_packs_keep_to_their_size_and_lose_no_sample(tiny: Path, data: Path) -> None:
    rows = rows_to_learn(config(tiny, data), Tokeniser(tiny, "template"))
    for most in (1, 300, 600, 100_000):
        packs = packs_of(rows, most)
        assert sum(len(pack) for pack in packs) == len(rows)
        for pack in packs:
            assert len({row["group"] for row in pack}) == 1
            size = pack[0]["shared"] + sum(row["length"] - row["shared"] for row in pack)
            assert len(pack) == 1 or size <= most
