"""The training loop: AdamW on packs, validated and saved as it goes, stopped and resumed."""

import math
import random
import signal
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import monotonic
from types import FrameType, TracebackType
from typing import Any, Self

import torch
from torch import Tensor

from pa_console.llm.models.cache import hash_file
from pa_training.lora.adapter import Adapter
from pa_training.lora.base import Base, read_base
from pa_training.lora.checkpoint import RunFolder, State, first_weights
from pa_training.lora.config import TrainConfig, find_base
from pa_training.lora.eight_bits import in_eight_bits
from pa_training.lora.frozen import FORMATS, fastest_precision
from pa_training.lora.material import Tokeniser, packs_held_out, packs_to_learn
from pa_training.lora.model import Score, gradients, score
from pa_training.lora.packs import Pack
from pa_training.lora.workers import Workers


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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._restore()

    def _ask(self, _number: int, _frame: FrameType | None) -> None:
        self.asked = True
        self._restore()

    def _restore(self) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)
        self._previous = {}


class PackOrder:
    """Every pack once an epoch, shuffled anew each time."""

    def __init__(self, packs: Sequence[Pack], config: TrainConfig) -> None:
        self._packs, self._seed = packs, config.seed
        self._each = min(config.packs_per_step, len(packs))
        epochs = math.ceil(config.epochs * len(packs) / self._each)
        self.steps = config.steps or epochs
        self._epoch = -1
        self._shuffled: list[int] = []

    def step(self, number: int) -> list[Pack]:
        """Return the packs of step `number` (from 0), the largest first: cores end together."""
        first = number * self._each
        chosen = [self._at(place) for place in range(first, first + self._each)]
        return sorted(chosen, key=lambda pack: -pack.size)

    def _at(self, place: int) -> Pack:
        epoch, index = divmod(place, len(self._packs))
        if epoch != self._epoch:
            self._shuffled = list(range(len(self._packs)))
            random.Random(f"{self._seed}/{epoch}").shuffle(self._shuffled)
            self._epoch = epoch
        return self._packs[self._shuffled[index]]


def learning_rate(config: TrainConfig, step: int, done: float) -> float:
    """Return the rate of `step` (from 0) when `done` of the run (0 to 1) lies behind.

    Linear warm-up, then a cosine down to `final_rate`.
    """
    warm = min(1.0, (step + 1) / (config.warmup_steps + 1))
    fall = 0.5 * (1.0 + math.cos(math.pi * min(1.0, done)))
    return config.learning_rate * warm * (config.final_rate + (1.0 - config.final_rate) * fall)


BETAS = (0.9, 0.99)


@dataclass(frozen=True)
class Progress:
    """Where the run stands after a step; validation figures are of the last validation."""

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
    """What a run came to; not `finished` when it was asked to stop and can be resumed."""

    out: Path
    finished: bool
    last: Progress


def train(
    config: TrainConfig, out: Path, resume: bool, on_progress: Callable[[Progress], None]
) -> TrainResult:
    """Train an adapter into the folder `out`, or go on with the run that is there.

    Ctrl-C ends the run after the step under way, saved. A resumed run keeps its own config.
    Raises ValueError (DocumentError, ModelError) or OSError for what cannot be used.
    """
    folder = RunFolder(out)
    if resume:
        config = folder.config()
    precision = config.precision
    if precision == "auto":
        precision = fastest_precision(config.device)
        config = config.model_copy(update={"precision": precision})
    path, chat = find_base(config)
    tokeniser = Tokeniser(path, chat)
    packs, held_out = packs_to_learn(config, tokeniser), packs_held_out(config, tokeniser)
    base = read_base(path, config.device, FORMATS[precision])
    adapter = Adapter(base.shape, config.rank, config.alpha, config.seed, config.device)
    missions = hash_file(Path(config.missions)) if config.missions is not None else ""
    hashes = hash_file(path), hash_file(Path(config.data)), missions
    with Workers(config.device, config.workers) as workers, StopRequest() as stop:
        if precision == "int8":
            base = in_eight_bits(base, packs)
        run = _Run(config, base, adapter, PackOrder(packs, config), held_out, workers, folder)
        run.start(resume, hashes)
        while not run.finished and not stop.asked:
            run.step()
            on_progress(run.progress)
        run.save()
    return TrainResult(out, run.finished, run.progress)


class _Run:
    """One run in memory."""

    def __init__(  # noqa: PLR0917
        self,
        config: TrainConfig,
        base: Base,
        adapter: Adapter,
        order: PackOrder,
        held_out: Sequence[Pack],
        workers: Workers,
        folder: RunFolder,
    ) -> None:
        self._config, self._base, self._adapter, self._order = config, base, adapter, order
        self._held_out, self._workers, self._folder = held_out, workers, folder
        self._optimiser = torch.optim.AdamW(
            adapter.masters, lr=0.0, betas=BETAS, weight_decay=config.weight_decay, foreach=True
        )
        self._state = State(adapter.masters, self._optimiser.state_dict())
        self._before = 0.0
        self._saved = self._began = monotonic()
        self.progress = Progress(0, order.steps, 0.0, 0.0, 0.0, 0.0)

    def start(self, resume: bool, hashes: tuple[str, str, str]) -> None:
        """Begin, or continue at the last checkpoint; raises ValueError when inputs changed."""
        if not resume:
            self._folder.begin(self._config)
            state = self._state
            state.base_sha256, state.data_sha256, state.missions_sha256 = hashes
            first = first_weights(self._config, self._base.shape, hashes[0])
            if first is not None:
                self._take_over(first)
            self.save()
            return
        state = self._folder.load()
        if (state.base_sha256, state.data_sha256, state.missions_sha256) != hashes:
            raise ValueError(
                f"{self._folder.path}: base or data changed since the run began: start it anew"
            )
        self._folder.rewind(state.step)
        self._take_over(state.masters)
        self._optimiser.load_state_dict(state.optimiser)
        self._state = replace(state, masters=self._adapter.masters)
        self._before = state.seconds
        self.progress = replace(self.progress, step=state.step, minutes=state.seconds / 60.0)

    def _take_over(self, saved: Sequence[Tensor]) -> None:
        """Go on from the weights of another moment."""
        with torch.no_grad():
            for master, other in zip(self._adapter.masters, saved, strict=True):
                master.copy_(other)

    @property
    def finished(self) -> bool:
        """Whether all steps are done, or the time is up."""
        return self._done() >= 1.0

    def step(self) -> None:
        """Do one optimiser step, and validate and save when it is time to."""
        began = monotonic()
        state, config = self._state, self._config
        packs = self._order.step(state.step)
        rate = learning_rate(config, state.step, self._done())
        loss, norm = self._learn(packs, rate)
        tokens = sum(pack.size for pack in packs)
        state.step += 1
        state.samples += sum(len(pack.branches) for pack in packs)
        state.tokens += tokens
        state.seconds = self._seconds()
        seconds = monotonic() - began
        self._folder.log(
            {
                "step": state.step,
                "loss": loss,
                "rate": rate,
                "norm": norm,
                "tokens": tokens,
                "seconds": round(seconds, 3),
                "minutes": round(state.seconds / 60.0, 3),
            }
        )
        self.progress = replace(
            self.progress,
            step=state.step,
            loss=loss,
            rate=rate,
            tokens_per_s=tokens / seconds,
            minutes=state.seconds / 60.0,
        )
        if state.step % config.validate_every == 0 or self.finished:
            self._validate()
        if monotonic() - self._saved > 60.0 * config.checkpoint_minutes:
            self.save()

    def save(self) -> None:
        """Write a checkpoint."""
        self._state.optimiser = self._optimiser.state_dict()
        self._state.seconds = self._seconds()
        self._folder.save(self._state)
        self._saved = monotonic()

    def _learn(self, packs: Sequence[Pack], rate: float) -> tuple[float, float]:
        """Return the loss and the gradient's norm of one update with the mean over `packs`."""
        pairs = self._adapter.working(self._base.embedding.dtype)
        weight = sum(pack.loss_weight for pack in packs)
        total, loss = list[Tensor](), 0.0
        for share, found in self._workers.map(
            lambda pack: gradients(self._base, pairs, pack, weight), packs
        ):
            loss += share
            total = total or [torch.zeros_like(x, dtype=torch.float32) for x in found]
            for one, other in zip(total, found, strict=True):
                one.add_(other)
        self._adapter.set_gradients(total)
        norm = torch.nn.utils.clip_grad_norm_(self._adapter.masters, self._config.clip)
        for group in self._optimiser.param_groups:
            group["lr"] = rate
        self._optimiser.step()
        return loss, float(norm)

    def _validate(self) -> None:
        """Add a row to the curve."""
        pairs = self._adapter.working(self._base.embedding.dtype)
        scores = self._workers.map(lambda pack: score(self._base, pairs, pack), self._held_out)
        whole = sum(scores, Score())
        state, loss, right = self._state, float("nan"), float("nan")
        if whole.samples:
            loss, right = whole.loss / whole.tokens, whole.right / whole.samples
            self.progress = replace(self.progress, validation_loss=loss, validation_right=right)
        minutes = state.seconds / 60.0
        self._folder.add_to_curve(
            state.step, minutes, state.samples, self.progress.loss, loss, right
        )

    def _seconds(self) -> float:
        return self._before + monotonic() - self._began

    def _done(self) -> float:
        """Return how much of the run is done, by steps or by the clock."""
        share = self._state.step / self._order.steps
        minutes = self._config.max_minutes
        return max(share, self._seconds() / (60.0 * minutes)) if minutes else share
