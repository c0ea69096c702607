"""A progress bar that lives as long as its `with` block."""

from types import TracebackType
from typing import Self

from rich.progress import Progress


class LiveBar:
    """What counts something on a bar; whoever derives from it makes `_progress`."""

    _progress: Progress

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self._progress.stop()
