"""`pa-console train readings`: orders with what they ask for, to be read and not carried out."""

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from pa_console.cli.output import errors, out
from pa_console.cli.train_progress import ReadingProgress
from pa_console.resources import find_data, training_data
from pa_console.training.planner_data import Recipe
from pa_console.training.reading_data import write_readings
from pa_console.tui.words import count


def make_readings(file: Path, recipes: Sequence[Recipe], rules: str, processes: int) -> None:
    """Write the samples of `recipes` to `file` and print how many there are.

    Raises DocumentError for a broken rule file, ValueError for a file that is there already and
    without a clone.
    """
    training_data("language")
    if file.exists():
        raise ValueError(f"{file}: is there already; name another file, or remove it")
    file.parent.mkdir(parents=True, exist_ok=True)
    made = 0
    written = write_readings(file, recipes, find_data("rules", rules, "rules.yaml"), processes)
    with ReadingProgress(len(recipes)) as progress, closing(written) as groups:
        for samples in groups:
            made += samples
            progress.add(samples)
    out.print(str(file), markup=False, soft_wrap=True)
    errors.print(count(made, "sample"))
