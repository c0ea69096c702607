"""How far an evaluation is: a live bar on a terminal, a line a run elsewhere."""

from typing import Self

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from pa_console.cli.live_bar import LiveBar
from pa_console.cli.output import errors
from pa_console.evaluation.record import RunRecord
from pa_console.tui.words import count


class EvalProgress(LiveBar):
    """Counts runs as they end, with how many succeeded strictly."""

    def __init__(self, total: int, done: int) -> None:
        """`done` of `total` runs were there already."""
        self._total, self._made, self._strict = total, done, 0
        self._before = done
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=errors,
            transient=True,
        )
        self._task = self._progress.add_task("starting", total=total, completed=done)

    def __enter__(self) -> Self:
        super().__enter__()
        if self._before:
            errors.print(f"there already: {self._before} of {count(self._total, 'run')}")
        return self

    def add(self, record: RunRecord) -> None:
        """Count one more run."""
        self._made += 1
        self._strict += record.strict
        share = f"strict {self._strict}/{self._made - self._before}"
        self._progress.update(self._task, advance=1, description=f"{share}  {record.run}")
        if not errors.is_terminal:
            word = "ok" if record.strict else "failed"
            line = f"{self._made}/{self._total} {record.run}: {record.status}, strict {word}"
            errors.print(line, markup=False, soft_wrap=True)
