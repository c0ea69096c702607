"""Trains one adapter for planner, judge and outcome on a GPU, in minutes that are counted.

`python -m pa_training.gpu.train --base B.gguf --corpus NAME=FILE:SHARE ... --out RUN` needs
torch, numpy and gguf, and nothing else of the console. The rate follows the clock, so that the run
ends on time; a checkpoint is written every other minute and a run goes on from it (`--resume`).
"""

import argparse
import json
import math
import os
import queue
import random
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from pa_training.gpu import attention, flash
from pa_training.gpu.batches import Batch, in_batches, make_batch
from pa_training.gpu.corpus import Pack, read_corpus
from pa_training.lora.adapter import Adapter, Pair
from pa_training.lora.base import Base, read_base
from pa_training.lora.kernels import answer_loss, score_answers
from pa_training.lora.model import hidden

BETAS = (0.9, 0.99)
AHEAD = 6
"""Batches that are laid out while the GPU computes."""
MOST_FILE = 15 * 2**20
"""Bytes of one file of a checkpoint."""


@dataclass(frozen=True)
class Config:
    """Everything that decides a run but its base and its corpora."""

    rank: int = 64
    alpha: float = 128.0
    rate: float = 6e-4
    final: float = 0.02
    warmup: int = 40
    clip: float = 1.0
    tokens: int = 49152
    minutes: float = 5.0
    steps: int = 1_000_000
    seed: int = 0


@dataclass(frozen=True)
class Corpus:
    """Packs that make up a `share` of the tokens that are learnt."""

    name: str
    packs: Sequence[Pack]
    share: float


def main() -> None:
    """Train as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--base", type=Path, required=True)
    parser.add_argument("--corpus", action="append", required=True, metavar="NAME=FILE:SHARE")
    parser.add_argument("--valid", action="append", default=[], metavar="NAME=FILE")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--dtype", default="bfloat16")
    parser.add_argument("--attention", choices=("flash", "grid"), default="flash")
    parser.add_argument("--resume", action="store_true")
    parser.add_argument("--profile", action="store_true", help="where the time goes, 5 steps")
    for name, value in asdict(Config()).items():
        parser.add_argument(f"--{name}", type=type(value), default=value)
    args = parser.parse_args()
    config = Config(**{name: getattr(args, name) for name in asdict(Config())})
    corpora = [_corpus(text) for text in args.corpus]
    valid = {name: read_corpus(Path(file)) for name, _, file in map(_parted, args.valid)}
    base = read_base(args.base, args.device, getattr(torch, args.dtype))
    with_flash = args.attention == "flash" and not base.shape.window
    run = Run(config, base, corpora, valid, args.out, with_flash, args.resume)
    if args.profile:
        run.profile()
    run.go()


def _parted(text: str) -> tuple[str, str, str]:
    return text.partition("=")


def _corpus(text: str) -> Corpus:
    name, _, rest = _parted(text)
    file, _, share = rest.rpartition(":")
    return Corpus(name, read_corpus(Path(file)), float(share))


class Run:
    """One run: batches are made ahead by a thread, steps are timed, checkpoints are written."""

    def __init__(  # noqa: PLR0917
        self,
        config: Config,
        base: Base,
        corpora: Sequence[Corpus],
        valid: dict[str, list[Pack]],
        out: Path,
        with_flash: bool,
        resume: bool,
    ) -> None:
        self._flash = with_flash
        self._attend: Callable[..., Tensor] = flash.attend if with_flash else attention.attend
        self._config, self._base, self._corpora, self._out = config, base, corpora, out
        self._device = base.embedding.device
        self._window = base.shape.window
        out.mkdir(parents=True, exist_ok=True)
        self.adapter = Adapter(base.shape, config.rank, config.alpha, config.seed, self._device)
        self._optimiser = torch.optim.AdamW(
            self.adapter.masters, lr=0.0, betas=BETAS, weight_decay=0.0, foreach=True
        )
        self._valid = {name: self._batches_of(packs) for name, packs in valid.items()}
        self.step, self._before, self._tokens, self._best = 0, 0.0, 0, 0.0
        if resume and (out / "state.pt").exists():
            self._load()
        self._queue: queue.Queue[Batch] = queue.Queue(AHEAD)
        threading.Thread(target=self._fill, daemon=True).start()
        self._began = self._saved = self._told = time.monotonic()

    def go(self) -> None:
        """Step until the time is up."""
        losses: list[Tensor] = []
        told_at, told_tokens = self.step, self._tokens
        while not self._finished:
            try:
                losses.append(self._learn(self._queue.get()))
            except torch.OutOfMemoryError:
                self._say(step=self.step, left_out="a batch that does not fit into memory")
                torch.cuda.empty_cache()
                continue
            self.step += 1
            now = time.monotonic()
            if now - self._told > 10.0 or self._finished:
                loss = torch.stack(losses).mean().item()
                rate = (self._tokens - told_tokens) / (time.monotonic() - self._told)
                self._say(
                    step=self.step,
                    loss=round(loss, 4),
                    seconds=round(self._seconds, 1),
                    tokens_per_s=round(rate),
                    steps_per_s=round((self.step - told_at) / (now - self._told), 2),
                )
                losses, self._told = [], time.monotonic()
                told_at, told_tokens = self.step, self._tokens
            if now - self._saved > 60.0:
                self._validate()
                self.save()
                self._told = self._saved = time.monotonic()
        self._validate()
        self.save()
        self._say(done=True, step=self.step, seconds=round(self._seconds, 1), tokens=self._tokens)

    def profile(self) -> None:
        """Tell how much of the time matrix products take, over five steps after five others."""
        for _ in range(5):
            self._learn(self._queue.get())
        activities = [torch.profiler.ProfilerActivity.CUDA, torch.profiler.ProfilerActivity.CPU]
        torch.cuda.synchronize()
        began = time.monotonic()
        with torch.profiler.profile(activities=activities) as found:
            for _ in range(5):
                self._learn(self._queue.get())
            torch.cuda.synchronize()
        seconds = time.monotonic() - began
        rows = sorted(found.key_averages(), key=lambda row: -row.self_device_time_total)
        kernels = [row for row in rows if row.self_device_time_total > 0 and not row.cpu_time_total]
        total = sum(row.self_device_time_total for row in kernels)
        words = ("gemm", "cutlass", "nvjet", "matmul", "xmma", "sm90_")
        products = sum(
            row.self_device_time_total
            for row in kernels
            if any(word in row.key.lower() for word in words)
        )
        self._say(profile_s=round(seconds, 3), device_s=total / 1e6, products=products / total)
        for row in kernels[:14]:
            print(f"  {row.self_device_time_total / total:6.1%} {row.count:6d} {row.key[:90]}")

    @property
    def _seconds(self) -> float:
        return self._before + time.monotonic() - self._began

    @property
    def _done(self) -> float:
        config = self._config
        return max(self.step / config.steps, self._seconds / (60.0 * config.minutes))

    @property
    def _finished(self) -> bool:
        return self._done >= 1.0

    def _rate(self) -> float:
        config = self._config
        warm = min(1.0, (self.step + 1) / (config.warmup + 1))
        fall = 0.5 * (1.0 + math.cos(math.pi * min(1.0, self._done)))
        return config.rate * warm * (config.final + (1.0 - config.final) * fall)

    def _learn(self, batch: Batch) -> Tensor:
        pairs = self.adapter.working(self._base.embedding.dtype)
        weights = batch.learnt.float()
        states = self._states(pairs, batch)
        loss = answer_loss(states, self._base.head, batch.targets, weights / weights.sum())
        leaves = [x for pair in pairs for x in (pair.a, pair.b)]
        self.adapter.set_gradients(torch.autograd.grad(loss, leaves))
        torch.nn.utils.clip_grad_norm_(self.adapter.masters, self._config.clip, foreach=True)
        for group in self._optimiser.param_groups:
            group["lr"] = self._rate()
        self._optimiser.step()
        self._tokens += batch.size
        return loss.detach()

    def _states(self, pairs: Sequence[Pair], batch: Batch) -> Tensor:
        states = hidden(self._base, pairs, batch.tokens, batch.layout, self._attend)
        return states.index_select(0, batch.rows)

    @torch.no_grad()
    def _validate(self) -> None:
        """Tell how much is right of what is not learnt, and keep the adapter that had most."""
        pairs = self.adapter.working(self._base.embedding.dtype)
        shares = 0.0
        for name, batches in self._valid.items():
            right = samples = count = 0
            total = 0.0
            for batch in batches:
                losses, hits = score_answers(
                    self._states(pairs, batch), self._base.head, batch.targets
                )
                total += losses[batch.learnt].sum().item()
                count += int(batch.learnt.sum())
                parts = torch.split((hits | ~batch.learnt).cpu(), list(batch.lengths))
                right += sum(bool(part.all()) for part in parts)
                samples += len(parts)
            shares += right / samples
            self._say(
                step=self.step,
                valid=name,
                right=right,
                of=samples,
                share=round(right / samples, 4),
                loss=round(total / count, 4),
            )
        if shares > self._best:
            self._best = shares
            self._write(self._out / "best")

    def _batches_of(self, packs: Sequence[Pack]) -> list[Batch]:
        rng = random.Random(0)
        return [
            make_batch(some, self._window, self._device, self._flash)
            for some in in_batches(packs, self._config.tokens, rng, not self._flash)
        ]

    def _fill(self) -> None:
        """Lay batches out ahead, of every corpus as many tokens as its share."""
        rng = random.Random(f"{self._config.seed}/{self.step}")
        endless = [self._endless(corpus, rng) for corpus in self._corpora]
        given = [0.0] * len(endless)
        shares = [corpus.share for corpus in self._corpora]
        while True:
            owed = [got / share for got, share in zip(given, shares, strict=True)]
            chosen = owed.index(min(owed))
            packs = next(endless[chosen])
            given[chosen] += sum(pack.size for pack in packs)
            self._queue.put(make_batch(packs, self._window, self._device, self._flash))

    def _endless(self, corpus: Corpus, rng: random.Random) -> Iterator[tuple[Pack, ...]]:
        epoch = 0
        while True:
            yield from in_batches(corpus.packs, self._config.tokens, rng, not self._flash)
            epoch += 1
            self._say(corpus=corpus.name, epochs=epoch, step=self.step)

    def save(self) -> None:
        """Write the adapter and the whole state."""
        state = {
            "masters": [master.detach() for master in self.adapter.masters],
            "optimiser": self._optimiser.state_dict(),
            "step": self.step,
            "seconds": self._seconds,
            "tokens": self._tokens,
            "best": self._best,
        }
        torch.save(state, self._out / "state.partial")
        os.replace(self._out / "state.partial", self._out / "state.pt")
        self._write(self._out)

    def _write(self, folder: Path) -> None:
        """Write the adapter as it is, in files that are small enough to travel."""
        folder.mkdir(exist_ok=True)
        flat = torch.cat([master.detach().flatten() for master in self.adapter.masters])
        whole = flat.to(torch.float16).cpu().numpy()
        each = MOST_FILE // 2
        for number, start in enumerate(range(0, len(whole), each)):
            np.save(folder / f"masters-{number}.npy", whole[start : start + each])
        facts = {"step": self.step, "seconds": self._seconds, "tokens_learnt": self._tokens}
        facts |= asdict(self._config)
        (folder / "facts.json").write_text(json.dumps(facts), encoding="utf-8")

    def _load(self) -> None:
        state = torch.load(self._out / "state.pt", map_location=self._device, weights_only=True)
        with torch.no_grad():
            for master, saved in zip(self.adapter.masters, state["masters"], strict=True):
                master.copy_(saved)
        self._optimiser.load_state_dict(state["optimiser"])
        self.step, self._before = state["step"], state["seconds"]
        self._tokens, self._best = state["tokens"], state["best"]

    def _say(self, **facts: object) -> None:
        line = json.dumps(facts)
        print(line, flush=True)
        with (self._out / "log.jsonl").open("a", encoding="utf-8") as stream:
            stream.write(line + "\n")


if __name__ == "__main__":
    main()
