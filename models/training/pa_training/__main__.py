"""`python -m pa_training`: makes training data, trains adapters, writes generated mission sets.

The library that trains is an extra; nothing of it is imported before a verb needs it.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

import typer

from pa_console.cli.main import run
from pa_console.cli.options import JsonOption, RulesOption, SchedulerOption, WorkersOption, one_of

NAME = "python -m pa_training"
app = typer.Typer(
    name=NAME,
    help="Make training data, train the adapters of the default model, describe them.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Seed of the generator.")]
JobsOption = Annotated[int, typer.Option("--jobs", min=1, help="Processes side by side.")]
DataOption = Annotated[Path | None, typer.Option("--data", help="A folder that 'data' has filled.")]
RunOption = Annotated[
    Path, typer.Option("--out", help="Folder of the run: config, log, curve, checkpoint, adapter.")
]
ConfigOption = Annotated[
    Path | None, typer.Option("--config", help="A training config; the shipped one if left out.")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="Another value of the config; repeatable."),
]
ResumeOption = Annotated[
    bool, typer.Option("--resume", help="Go on with the run in --out, from its last checkpoint.")
]
MinutesOption = Annotated[
    float | None, typer.Option("--minutes", min=0.01, help="The run takes this long at most.")
]


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
    wordings: Annotated[
        int,
        typer.Option(
            min=1,
            help="Ways in which each mission is worded for the planner; one that asks for several "
            "things gets five times the others.",
        ),
    ] = 3,
    seed: SeedOption = 1,
    jobs: Annotated[
        int | None, typer.Option("--jobs", min=1, help="Processes side by side; 2 if left out.")
    ] = None,
    workers: WorkersOption = 0,
    scheduler: SchedulerOption = "",
    only: Annotated[
        Literal["planner", "judge"] | None,
        typer.Option(help="Make the samples of one adapter only; the other's can follow later."),
    ] = None,
    rules: RulesOption = "checkpoint",
    json: JsonOption = False,
) -> None:
    """Make missions in random worlds with plans that were proven right, and plans to judge."""
    from pa_training.samples.planner_samples import Recipe  # noqa: PLC0415
    from pa_training.verbs.data import make_data  # noqa: PLC0415 - the help waits for none of it

    one_of(jobs=jobs is not None, workers=bool(workers), scheduler=bool(scheduler))
    make_data(
        out,
        [Recipe(number, seed, missions, wordings=wordings) for number in range(groups)],
        jobs or 2,
        workers or scheduler,
        (only,) if only else ("planner", "judge"),
        rules,
        json,
    )


@app.command()
def orders(
    out: Annotated[
        Path, typer.Option("--out", help="The file that is written: tab-separated values.")
    ],
    groups: Annotated[int, typer.Option(min=1, help="Situations in random worlds.")] = 400,
) -> None:
    """Make the short orders, with what they ask, that models without adapters are shown."""
    from pa_training.verbs.data import make_taught_orders  # noqa: PLC0415

    make_taught_orders(out, groups)


@app.command()
def readings(
    out: Annotated[
        Path, typer.Option("--out", help="The file of samples, JSON lines, gzipped: NAME.jsonl.gz.")
    ],
    groups: Annotated[int, typer.Option(min=1, help="Situations in random worlds.")] = 1000,
    missions: Annotated[int, typer.Option(min=1, help="Orders in each situation.")] = 20,
    wordings: Annotated[
        int,
        typer.Option(
            min=1,
            help="Ways in which each order is worded, twice the others if "
            "it asks for several things.",
        ),
    ] = 3,
    seed: SeedOption = 1,
    split: Annotated[
        Literal["train", "heldout"],
        typer.Option(help="heldout: worlds and words that no training data has."),
    ] = "train",
    jobs: JobsOption = 2,
    rules: RulesOption = "checkpoint",
) -> None:
    """Make orders with what they ask for, a hundred times as fast as with a plan for each."""
    from pa_training.samples.planner_samples import Recipe  # noqa: PLC0415
    from pa_training.verbs.data import make_readings  # noqa: PLC0415

    recipes = [Recipe(number, seed, missions, split, wordings) for number in range(groups)]
    make_readings(out, recipes, rules, jobs)


@app.command()
def written(
    out: Annotated[
        Path, typer.Option("--out", help="The file of samples, JSON lines, gzipped: NAME.jsonl.gz.")
    ],
    kept_aside: Annotated[
        bool,
        typer.Option("--kept-aside", help="Of the writers of whom nothing is learnt: to validate."),
    ] = False,
) -> None:
    """Make samples of the orders that writers wrote in their own words."""
    from pa_training.verbs.data import make_written  # noqa: PLC0415

    make_written(out, "development" if kept_aside else "written")


def _trainer(role: Literal["planner", "judge"]) -> Callable[..., None]:
    """Return the verb that trains the adapter of `role`."""

    def train(
        out: RunOption,
        data: DataOption = None,
        config: ConfigOption = None,
        changes: SetOption = None,
        minutes: MinutesOption = None,
        resume: ResumeOption = False,
    ) -> None:
        from pa_training.verbs.run import run_training  # noqa: PLC0415

        run_training(role, data, out, config, changes or [], minutes, resume)

    train.__doc__ = (
        f"Train the {role}'s adapter; Ctrl-C ends the run so that it can be gone on with."
    )
    return train


app.command("planner")(_trainer("planner"))
app.command("judge")(_trainer("judge"))


@app.command()
def missions(
    out: Annotated[
        Path, typer.Option("--out", help="The mission set; its worlds go into a folder beside it.")
    ],
    count: Annotated[int, typer.Option(min=1, help="How many missions, about four a world.")] = 300,
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of the generator; not one that training data is from.")
    ] = 9001,
    split: Annotated[
        Literal["train", "heldout"],
        typer.Option(help="heldout: worlds and words that no training data has."),
    ] = "heldout",
    jobs: JobsOption = 2,
    rules: RulesOption = "checkpoint",
    json: JsonOption = False,
) -> None:
    """Write missions in random worlds that 'pa-console eval --missions' runs."""
    from pa_training.verbs.missions import make_missions  # noqa: PLC0415

    make_missions(out, count, seed, split, rules, jobs, json)


@app.command()
def card(
    trained: Annotated[Path, typer.Option("--run", help="Folder of a training run.")],
    data: Annotated[Path, typer.Option("--data", help="Folder of the data it was trained on.")],
    out: Annotated[Path, typer.Option("--out", help="The card, e.g. models/NAME.md.")],
    evaluation: Annotated[
        Path | None, typer.Option("--eval", help="Folder of an evaluation to take figures from.")
    ] = None,
) -> None:
    """Write the model card of an adapter: data, seeds, curve, figures, limits, licence."""
    from pa_training.results.model_card import model_card  # noqa: PLC0415

    text = model_card(trained, data, out.stem, evaluation)
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(text, encoding="utf-8", newline="\n")
    typer.echo(out)


if __name__ == "__main__":
    run(app, NAME)
