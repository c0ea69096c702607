"""`python -m pa_training`: makes training data, trains adapters, writes mission sets and cards.

The library that trains is an extra; nothing of it is imported before a verb needs it.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

import typer

from pa_console.cli.main import run
from pa_console.cli.options import JsonOption, RulesOption

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
    spoken: Annotated[
        bool,
        typer.Option(
            "--spoken", help="Learn what people say for generated situations beside the writers."
        ),
    ] = False,
    plans: Annotated[
        int, typer.Option(min=0, help="Orders in each situation with whole plans and verdicts.")
    ] = 4,
    rounds: Annotated[
        int,
        typer.Option(min=1, help="Situations at each site; the first is the one its writer saw."),
    ] = 1,
    groups: Annotated[
        int | None, typer.Option(min=1, help="Situations at most; all if left out.")
    ] = None,
    jobs: Annotated[int, typer.Option("--jobs", min=1, help="Processes side by side.")] = 2,
    rules: RulesOption = "checkpoint",
    json: JsonOption = False,
) -> None:
    """Make readings of written orders, plans that were proven right, and plans to judge."""
    from pa_training.verbs.data import make_data, wanted_groups  # noqa: PLC0415

    wanted = wanted_groups(rounds, plans, groups, spoken=spoken)
    make_data(out, wanted, jobs, rules, json)


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
    source: Annotated[
        Literal["written", "spoken", "development", "sealed"],
        typer.Option("--from", help="The writers whose orders become missions."),
    ] = "development",
) -> None:
    """Write orders of writers as missions that 'pa-console eval --missions' runs."""
    from pa_training.results.written_missions import write_written_missions  # noqa: PLC0415

    missions = write_written_missions(out, source)
    typer.echo(f"{len(missions.missions)} missions in {out}")


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
