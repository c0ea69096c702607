"""The options of verbs that can do their work on Dask's workers; Dask is imported by them alone."""

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:  # it imports Dask
    from pa_console.evaluation.runs.dask_sweep import Workers

WorkersOption = Annotated[
    int, typer.Option(min=0, help="Make them in so many processes of this machine (Dask).")
]
SchedulerOption = Annotated[
    str, typer.Option(help="Make them on the workers of this Dask scheduler: tcp://HOST:PORT.")
]


def one_of(**given: bool) -> None:
    """Raise ValueError where more than one of these options was given."""
    if sum(given.values()) > 1:
        names = [f"--{name}" for name in given]
        raise ValueError(f"give one of {', '.join(names[:-1])} and {names[-1]}")


def dask_workers(where: int | str) -> "Workers":
    """Return that many processes of this machine, or the workers of the scheduler at that address.

    Raises ValueError without Dask.
    """
    try:
        from pa_console.evaluation.runs.dask_sweep import Workers  # noqa: PLC0415
    except ImportError as error:
        raise ValueError("a sweep needs Dask: pip install 'pa-console[sweep]'") from error
    return Workers(count=where) if isinstance(where, int) else Workers(scheduler=where)
