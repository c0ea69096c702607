"""`pa-console mission`: one mission through all eight steps, without the screen."""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from pa_console.cli import completion
from pa_console.cli.options import JsonOption, SessionOptions
from pa_console.cli.settings_defaults import OBSERVED, settings_of


class Approve(StrEnum):
    """The ways in which a plan is approved."""

    ask = "ask"
    auto = "auto"
    never = "never"


@dataclass(frozen=True)
class MissionOptions(SessionOptions):
    """The options of a script's session."""

    alarms: Annotated[
        bool | None,
        typer.Option(
            "--alarms/--no-alarms",
            help="Alarms become missions by themselves; on by default with --scenario.",
        ),
    ] = None
    log: Annotated[Path | None, typer.Option(help="Where to write the session log.")] = None
    stepped: bool = True


def mission(
    context: typer.Context,
    text: Annotated[
        str | None,
        typer.Argument(
            help="The mission, in plain language; not needed with --scenario.",
            autocompletion=completion.words_of_mission,
        ),
    ] = None,
    *,
    options: MissionOptions,
    approve: Annotated[
        Approve,
        typer.Option(
            help="ask: on the terminal; auto: what the safeguards allow and is read without doubt."
        ),
    ] = Approve.ask,
    override_reason: Annotated[
        str, typer.Option(help="With --approve auto: override a judge's Failure, for this reason.")
    ] = "",
    event: Annotated[
        list[str] | None,
        typer.Option(
            help="Set-up before the mission, as YAML; repeatable. "
            "Example: '{kind: spawn, gate: WestGate, distance_m: 60}'"
        ),
    ] = None,
    choose: Annotated[
        int | None,
        typer.Option(
            metavar="NUMBER",
            min=1,
            help="Where the order is asked back about, take the choice of this number.",
        ),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Plan, check, rehearse, judge, decide, execute and verify one mission, or a situation's."""
    from pa_console.cli.sessions.mission import run_mission  # noqa: PLC0415 - not needed for help
    from pa_console.cli.sessions.observing import observing  # noqa: PLC0415

    settings = settings_of(context, *OBSERVED).values
    with observing(settings, options, live=True) as beside:
        run_mission(
            options,
            settings,
            beside,
            text,
            standing=None if approve is Approve.ask else approve.value,
            override_reason=override_reason,
            setup=event or (),
            choose=choose or 0,
            json=json,
        )
