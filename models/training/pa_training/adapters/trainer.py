"""The trainer: transformers' own, on answers only, watched, stopped and resumed."""

import math
import signal
import threading
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import monotonic
from types import FrameType
from typing import Any, Self, cast

import numpy as np
import torch
from datasets import Dataset
from peft import PeftModel
from torch import Tensor
from torch.nn import functional
from torch.optim.lr_scheduler import LambdaLR
from transformers import (
    EvalPrediction,
    PrinterCallback,
    Trainer,
    TrainerCallback,
    TrainerControl,
    TrainerState,
    TrainingArguments,
    set_seed,
)
from transformers.utils import logging

from pa_console.llm.models.cache import hash_file
from pa_training.adapters.adapter_file import (
    BASE,
    BASE_SHA256,
    DATA_SHA256,
    EARLIER,
    SAMPLES,
    STEPS,
    write_adapter,
)
from pa_training.adapters.config import TrainConfig, find_base
from pa_training.adapters.material import (
    NOT_LEARNT,
    Row,
    Tokeniser,
    packs_of,
    rows_held_out,
    rows_to_learn,
)
from pa_training.adapters.network import (
    adapted,
    architecture,
    in_bfloat16,
    load_base,
    matrices,
    paired_heads,
    set_matrices,
)
from pa_training.adapters.run_folder import RunFolder
from pa_training.adapters.starts import first_matrices
from pa_training.results.lineage import ADAPTER, kept_earlier, run_row, to_json

ADAM_BETA2 = 0.99


@dataclass(frozen=True)
class Progress:
    """The state of a run after a step; validation figures are of the last validation."""

    step: int
    steps: int
    loss: float
    rate: float
    tokens_per_s: float
    minutes: float
    validation_loss: float | None = None
    validation_right: float | None = None


@dataclass(frozen=True)
class TrainResult:
    """The end of a run; not `finished` when it was asked to stop and can be resumed."""

    finished: bool
    last: Progress
    adapter_sha256: str


def train(
    config: TrainConfig, out: Path, resume: bool, on_progress: Callable[[Progress], None]
) -> TrainResult:
    """Train an adapter into the folder `out`, or go on with the run that is there.

    Ctrl-C ends the run after the step under way, saved and exported. A resumed run keeps its own
    config. Raises ValueError (DocumentError, ModelError) or OSError for what cannot be used.
    """
    logging.disable_progress_bar()
    logging.set_verbosity_error()
    warnings.filterwarnings("ignore", "Could not find a config file")  # of a base that is a file
    folder = RunFolder(out)
    if resume:
        config = folder.config()
    path, chat = find_base(config)
    tokeniser = Tokeniser(path, chat)
    rows, held_out = rows_to_learn(config, tokeniser), rows_held_out(config, tokeniser)
    inputs = {name: hash_file(Path(file)) for name, file in (("base", path), ("data", config.data))}
    set_seed(config.seed)
    base = load_base(path, config)
    model = adapted(base, config)
    heads = paired_heads(path, base)
    checkpoint: Path | None = None
    if resume:
        checkpoint = folder.go_on(inputs)
    else:
        first = first_matrices(config, matrices(model), heads, inputs["base"])
        folder.begin(config, inputs)
        set_matrices(model, first)
    with StopRequest() as stop:
        watch = _Watch(config, folder, len(rows), stop, on_progress)
        trainer = _AnswerTrainer(config, model, watch, rows, held_out, out)
        trainer.train(resume_from_checkpoint=str(checkpoint) if checkpoint else None)
    origin = {
        BASE: config.without_folders().base,
        BASE_SHA256: inputs["base"],
        DATA_SHA256: inputs["data"],
        STEPS: str(watch.progress.step),
        SAMPLES: str(watch.samples),
        EARLIER: to_json([*kept_earlier(out), run_row(out, config)]),
    }
    sha256 = write_adapter(
        out / ADAPTER, architecture(path), matrices(model), heads, config, origin
    )
    return TrainResult(watch.finished, watch.progress, sha256)


class StopRequest:
    """A context in which the first Ctrl-C or SIGTERM only sets `asked`."""

    def __init__(self) -> None:
        self.asked = False
        self._previous: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._previous[number] = signal.signal(number, self._ask)
        return self

    def __exit__(self, *_: object) -> None:
        self._restore()

    def _ask(self, _number: int, _frame: FrameType | None) -> None:
        self.asked = True
        self._restore()

    def _restore(self) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)
        self._previous = {}


def rate_share(config: TrainConfig, step: int, done: float) -> float:
    """Return the share of the learning rate at `step` (from 0) when `done` (0 to 1) lies behind.

    Linear warm-up, then a cosine down to `final_rate`.
    """
    warm = min(1.0, (step + 1) / (config.warmup_steps + 1))
    fall = 0.5 * (1.0 + math.cos(math.pi * min(1.0, done)))
    return warm * (config.final_rate + (1.0 - config.final_rate) * fall)


class _Watch(TrainerCallback):
    """Keeps the time, the curve and the checkpoints of a run, and ends it when it is to end."""

    def __init__(
        self,
        config: TrainConfig,
        folder: RunFolder,
        rows: int,
        stop: StopRequest,
        on_progress: Callable[[Progress], None],
    ) -> None:
        per_step = min(config.samples_per_step, rows)
        self.steps = config.steps or math.ceil(config.epochs * rows / per_step)
        self.progress = Progress(0, self.steps, 0.0, 0.0, 0.0, 0.0)
        self.samples = 0
        self._config, self._folder, self._rows = config, folder, rows
        self._stop, self._on_progress = stop, on_progress
        self._validates = config.validation is not None
        self._before_s, self._tokens = 0.0, 0
        self._began = self._saved = self._step_began = monotonic()

    @property
    def finished(self) -> bool:
        """True once all steps are done, or the time is up."""
        return self.done(self.progress.step) >= 1.0

    def done(self, step: int) -> float:
        """Return how much of the run is done after `step` steps, by steps or by the clock."""
        minutes = self._config.max_minutes
        return max(step / self.steps, self._seconds() / (60.0 * minutes) if minutes else 0.0)

    def on_train_begin(
        self, args: TrainingArguments, state: TrainerState, control: TrainerControl, **kwargs: Any
    ) -> None:
        """Go on with the clock of a run that is resumed."""
        minutes = (line.get("minutes", 0.0) for line in state.log_history)
        self._before_s = 60.0 * max(minutes, default=0.0)
        self._began = self._saved = self._step_began = monotonic()
        self._tokens = int(state.num_input_tokens_seen)
        self.progress = replace(
            self.progress, step=state.global_step, minutes=self._before_s / 60.0
        )

    def on_step_end(
        self, args: TrainingArguments, state: TrainerState, control: TrainerControl, **kwargs: Any
    ) -> None:
        """Decide whether a validation, a checkpoint or the end follows this step."""
        last = self.done(state.global_step) >= 1.0
        control.should_training_stop = last or self._stop.asked
        control.should_evaluate = control.should_evaluate or (last and self._validates)
        due = monotonic() - self._saved > 60.0 * self._config.checkpoint_minutes
        control.should_save = due or control.should_training_stop

    def on_log(
        self, args: TrainingArguments, state: TrainerState, control: TrainerControl, **kwargs: Any
    ) -> None:
        """Report a step; the time goes into the state, which a checkpoint keeps."""
        logs, minutes = kwargs["logs"], self._seconds() / 60.0
        state.log_history[-1]["minutes"] = round(minutes, 4)
        if "loss" not in logs:
            return
        now, tokens = monotonic(), int(state.num_input_tokens_seen)
        self.samples = round((state.epoch or 0.0) * self._rows)
        self.progress = replace(
            self.progress,
            step=state.global_step,
            loss=logs["loss"],
            rate=logs["learning_rate"],
            tokens_per_s=(tokens - self._tokens) / max(now - self._step_began, 1e-6),
            minutes=minutes,
        )
        self._tokens, self._step_began = tokens, now
        noted = state.global_step % self._config.validate_every == 0 or self.finished
        if noted and not self._validates:
            self._note(math.nan, math.nan)
        self._on_progress(self.progress)

    def on_evaluate(
        self, args: TrainingArguments, state: TrainerState, control: TrainerControl, **kwargs: Any
    ) -> None:
        """Take over what a validation found."""
        loss, right = (kwargs["metrics"][name] for name in ("eval_loss", "eval_right"))
        self.progress = replace(self.progress, validation_loss=loss, validation_right=right)
        self._note(loss, right)

    def on_save(
        self, args: TrainingArguments, state: TrainerState, control: TrainerControl, **kwargs: Any
    ) -> None:
        """Note when the last checkpoint was written."""
        self._saved = monotonic()

    def _note(self, loss: float, right: float) -> None:
        """Add a row to the curve."""
        now = self.progress
        self._folder.add_to_curve(now.step, now.minutes, self.samples, now.loss, loss, right)

    def _seconds(self) -> float:
        return self._before_s + monotonic() - self._began


class _AnswerTrainer(Trainer):
    """Learns answers only, on packs of samples that share the beginning of their prompts."""

    def __init__(  # noqa: PLR0917
        self,
        config: TrainConfig,
        model: PeftModel,
        watch: _Watch,
        rows: Sequence[Row],
        held_out: Sequence[Row],
        out: Path,
    ) -> None:
        packs = packs_of(rows, config.pack_tokens)
        per_step = min(config.samples_per_step, len(rows))
        arguments = TrainingArguments(
            output_dir=str(out),
            per_device_train_batch_size=1,
            per_device_eval_batch_size=1,
            gradient_accumulation_steps=math.ceil(per_step * len(packs) / len(rows)),
            max_steps=watch.steps,
            learning_rate=config.learning_rate,
            weight_decay=config.weight_decay,
            adam_beta2=ADAM_BETA2,
            max_grad_norm=config.clip,
            bf16=in_bfloat16(config),
            use_cpu=config.device == "cpu",
            seed=config.seed,
            train_sampling_strategy="random",
            logging_steps=1,
            eval_strategy="steps" if held_out else "no",
            eval_steps=config.validate_every,
            save_strategy="no",
            save_total_limit=1,
            label_names=["labels"],
            remove_unused_columns=False,
            include_num_input_tokens_seen="all",
            dataloader_pin_memory=torch.cuda.is_available(),
            report_to="none",
            disable_tqdm=True,
        )
        self._config, self._watch = config, watch
        super().__init__(
            model=model,
            args=arguments,
            data_collator=packed,
            train_dataset=_dataset(packs),
            eval_dataset=_dataset([[row] for row in held_out]) if held_out else None,
            compute_metrics=_right,
            preprocess_logits_for_metrics=_most_likely,
            callbacks=[watch],
        )
        self.remove_callback(PrinterCallback)
        self.model_accepts_loss_kwargs = True

    def create_scheduler(
        self,
        num_training_steps: int,
        optimizer: torch.optim.Optimizer | None = None,
    ) -> LambdaLR:
        """Return the schedule of the config."""
        self.lr_scheduler = LambdaLR(
            cast(torch.optim.Optimizer, optimizer or self.optimizer),
            lambda step: rate_share(self._config, step, self._watch.done(step)),
        )
        return self.lr_scheduler

    def compute_loss(
        self,
        model: Any,
        inputs: dict[str, Any],
        return_outputs: bool = False,
        num_items_in_batch: Tensor | int | None = None,
    ) -> Any:
        """Return the mean loss over the tokens of all answers."""
        labels = inputs.pop("labels")
        outputs = model(**inputs)
        logits = outputs.logits.float()
        summed = functional.cross_entropy(
            logits.flatten(0, 1), labels.flatten(), ignore_index=NOT_LEARNT, reduction="sum"
        )
        number = num_items_in_batch if num_items_in_batch is not None else (labels >= 0).sum()
        loss = summed / number
        return (loss, outputs) if return_outputs else loss


def _dataset(packs: Sequence[Sequence[Row]]) -> Dataset:
    return Dataset.from_list([{"rows": [dict(row) for row in pack]} for pack in packs])


def packed(packs: Sequence[Mapping[str, Sequence[Row]]]) -> dict[str, Any]:
    """Return one pack as a batch of one sequence: what its rows share, then the rest of each.

    A row sees what is shared and itself, so it learns the same as alone.
    """
    (pack,) = packs
    rows = pack["rows"]
    shared = min(row["shared"] for row in rows)
    tokens, positions = list(rows[0]["tokens"][:shared]), list(range(shared))
    owners, labels = [0] * shared, [NOT_LEARNT] * shared
    for number, row in enumerate(rows, 1):
        own = row["tokens"][shared:]
        tokens += own
        positions += range(shared, shared + len(own))
        owners += [number] * len(own)
        labels += [NOT_LEARNT] * (len(own) - len(row["targets"])) + list(row["targets"])
    owner = torch.tensor(owners)
    seen = (owner[None, :] == 0) | (owner[None, :] == owner[:, None])
    kept = [at for at, label in enumerate(labels) if label != NOT_LEARNT]
    return {
        "input_ids": torch.tensor([tokens]),
        "attention_mask": torch.tril(seen)[None, None],
        "position_ids": torch.tensor([positions]),
        "labels": torch.tensor([[labels[at] for at in kept]]),
        "logits_to_keep": torch.tensor(kept),
    }


def _most_likely(logits: Tensor, _labels: Tensor) -> Tensor:
    return logits.argmax(-1)


def _right(found: EvalPrediction) -> dict[str, float]:
    """Return the share of answers each of whose learnt tokens is the most likely one.

    Those are the answers that greedy decoding writes.
    """
    chosen, labels = np.asarray(found.predictions), np.asarray(found.label_ids)
    return {"right": float(((chosen == labels) | (labels == NOT_LEARNT)).all(axis=1).mean())}
