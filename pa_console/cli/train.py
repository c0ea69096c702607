"""`pa-console train`: makes training data, trains adapters, writes generated mission sets.

The library that trains is an extra; nothing of it is imported before a verb needs it.
"""

from pathlib import Path
from typing import Annotated, Literal

import typer

from pa_console.cli.output import JsonOption, RulesOption

app = typer.Typer(
    help="Make training data, train the adapters of the default model, describe them.",
    no_args_is_help=True,
)
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Seed of the generator.")]


@app.command()
def data(
    out: Annotated[
        Path,
        typer.Option("--out", help="Folder of the data set; one that is there is gone on with."),
    ],
    groups: Annotated[
        int, typer.Option(min=1, help="Situations in random worlds, those that are there counted.")
    ] = 1000,
    missions: Annotated[int, typer.Option(min=1, help="Missions in each situation.")] = 8,
    seed: SeedOption = 1,
    jobs: Annotated[int, typer.Option(min=1, help="Processes side by side.")] = 2,
    only: Annotated[
        Literal["planner", "judge"] | None,
        typer.Option(help="Make the samples of one adapter only; the other's can follow later."),
    ] = None,
    rules: RulesOption = "checkpoint",
    json: JsonOption = False,
) -> None:
    """Make missions in random worlds with plans that were proven right, and plans to judge."""
    from pa_console.cli.train_data import make_data  # noqa: PLC0415 - see the module

    make_data(
        out, groups, missions, seed, jobs, (only,) if only else ("planner", "judge"), rules, json
    )
