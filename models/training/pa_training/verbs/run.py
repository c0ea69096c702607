"""The verbs `planner` and `judge`: trains an adapter, shows how far it is, exports it."""

import sys
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError

from pa_console import __version__
from pa_console.evaluation.run_record import describe_machine
from pa_console.llm.models.cache import hash_file
from pa_console.schema.document import Document
from pa_console.terminal.output import errors, out
from pa_training.adapters.config import TrainConfig, find_base, shipped_config
from pa_training.adapters.run_folder import RunFolder
from pa_training.results.lineage import ADAPTER, RunSummary, write_summary
from pa_training.verbs.progress import TrainProgress

Task = Literal["planner", "judge"]
NEEDED = ("torch", "transformers", "peft", "datasets", "accelerate")


def run_training(
    task: Task,
    data: Path | None,
    folder: Path,
    config: Path | None,
    changes: list[str],
    minutes: float | None,
    resume: bool,
) -> None:
    """Train, or go on with the run in `folder`; then write its adapter and its summary.

    Raises ValueError without the extra, for a config that cannot be, and for what cannot
    be used.
    """
    require_extra()
    from pa_training.adapters.trainer import train  # noqa: PLC0415 - torch is slow

    if resume:
        _refuse_changes(data=data, config=config, minutes=minutes, set=changes)
        chosen = RunFolder(folder).config()
        if chosen.task != task:
            raise ValueError(f"{folder}: is a run of the {chosen.task}, not of the {task}")
    else:
        chosen = chosen_config(task, data, config, changes, minutes)
    with errors.status(f"preparing {chosen.base}"):
        find_base(chosen)
    with TrainProgress(chosen.max_minutes) as progress:
        result = train(chosen, folder, resume, progress.show)
    last = result.last
    write_summary(
        folder,
        RunSummary(
            config=chosen,
            finished=result.finished,
            step=last.step,
            steps=last.steps,
            minutes=round(last.minutes, 2),
            validation_loss=last.validation_loss,
            validation_right=last.validation_right,
            base_sha256=hash_file(find_base(chosen)[0]),
            data_sha256=hash_file(Path(chosen.data)),
            adapter_sha256=result.adapter_sha256,
            versions={
                "pa-console": __version__,
                "python": sys.version.split()[0],
                **{name: version(name) for name in NEEDED},
            },
            machine=describe_machine().lines,
        ),
    )
    adapter = f"{folder / ADAPTER}: SHA-256 {result.adapter_sha256}"
    out.print_line(adapter)
    if not result.finished:
        errors.print_line(
            f"stopped after step {last.step} of {last.steps}; "
            f"python -m pa_training {task} --out {folder} --resume goes on"
        )
        raise KeyboardInterrupt


def require_extra() -> None:
    """Raise ValueError with the remedy when what trains is not installed."""
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise ValueError(
            f"training needs {' and '.join(missing)}, which the console itself does not: "
            "pip install 'pa-console[train]'"
        )


def chosen_config(
    task: Task, data: Path | None, file: Path | None, changes: list[str], minutes: float | None
) -> TrainConfig:
    """Return the config in `file`, or the shipped one, with `data` and what was asked to differ.

    Raises DocumentError for a broken file and ValueError for a change that cannot be.
    """
    config = TrainConfig.load(file or shipped_config(task))
    if config.task != task:
        raise ValueError(f"{file}: task: is {config.task!r}; this verb trains the {task}")
    values: dict[str, Any] = config.model_dump() | dict(map(_change, changes))
    if data is None:
        raise ValueError("--data is missing: the folder that python -m pa_training data has filled")
    samples, valid = data / f"{task}.jsonl", data / f"valid-{task}.jsonl"
    if not samples.is_file() or not samples.stat().st_size:
        raise ValueError(f"{samples}: there are no samples: run python -m pa_training data")
    values["data"] = str(samples)
    values["validation"] = str(valid) if valid.is_file() and valid.stat().st_size else None
    if minutes is not None:
        values["max_minutes"] = minutes
    try:
        return TrainConfig.model_validate(values)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        known = ", ".join(TrainConfig.model_fields)
        raise ValueError(
            f"--set: {'.'.join(map(str, first['loc']))}: {first['msg']}; known: {known}"
        ) from error


def _change(text: str) -> tuple[str, Any]:
    name, equals, value = text.partition("=")
    if not equals:
        raise ValueError(f"--set {text}: write NAME=VALUE, e.g. --set rank=32")
    return name.strip(), Document(f"--set {name.strip()}", value).value


def _refuse_changes(**given: object) -> None:
    """Raise ValueError for options that a run that is gone on with would not heed."""
    for name, value in given.items():
        if value:
            raise ValueError(f"--{name} cannot be changed with --resume: a run keeps its config")
