"""How far a data set or a training run is: a live bar on a terminal, some lines elsewhere."""

from time import monotonic
from typing import TYPE_CHECKING

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from pa_console.cli.progress_bars import LiveBar
from pa_console.schema.text import count
from pa_console.terminal.output import errors

if TYPE_CHECKING:  # it needs torch, which only training itself may import
    from pa_training.adapters.trainer import Progress as Step

LINE_S = 60.0
"""How often a line is written where there is no terminal, seconds."""

SPEED_OVER_S = 300.0
"""Time left is told by the speed of this long, seconds: groups differ."""


class DataProgress(LiveBar):
    """Counts groups and samples as they are made."""

    def __init__(self, total: int, done: int) -> None:
        """`done` of `total` groups were there already."""
        self._total, self._done, self._samples = total, done, 0
        self._began = self._told = monotonic()
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            MofNCompleteColumn(),
            TextColumn("groups"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=errors,
            transient=True,
            speed_estimate_period=SPEED_OVER_S,
        )
        self._task = self._progress.add_task("starting", total=total, completed=done)

    def add(self, samples: int) -> None:
        """Count one more group with so many samples."""
        self._done += 1
        self._samples += samples
        now = monotonic()
        rate = self._samples / max(now - self._began, 1e-6)
        text = f"{count(self._samples, 'sample')}, {rate:.1f}/s"
        self._progress.update(self._task, advance=1, description=text)
        if not errors.is_terminal and (now - self._told > LINE_S or self._done == self._total):
            self._told = now
            errors.print_line(f"{self._done}/{self._total} groups: {text}")


class TrainProgress(LiveBar):
    """Shows the steps of a training run; nothing of what trains is imported for it."""

    def __init__(self, minutes: float | None) -> None:
        """A run of at most `minutes`, if there is such a limit."""
        self._minutes = minutes
        self._told = monotonic()
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            TextColumn("{task.fields[left]}"),
            console=errors,
            transient=True,
        )
        self._task = self._progress.add_task("reading data and base", total=None, left="")

    def show(self, now: "Step") -> None:
        """Show where the run stands after a step."""
        text = f"step {now.step}/{now.steps}  loss {now.loss:.3f}  {now.tokens_per_s:.0f} tokens/s"
        if now.validation_loss is not None and now.validation_right is not None:
            text += f"  validation {now.validation_loss:.3f}, {now.validation_right:.1%} right"
        share = now.step / now.steps
        if self._minutes is not None:
            share = max(share, now.minutes / self._minutes)
        left = f"{now.minutes * (1.0 / min(share, 1.0) - 1.0):.1f} min left"
        self._progress.update(
            self._task, total=1.0, completed=min(share, 1.0), description=text, left=left
        )
        ended = share >= 1.0
        if not errors.is_terminal and (ended or monotonic() - self._told > LINE_S):
            self._told = monotonic()
            errors.print_line(f"{text}  {left}")
