"""`pa-console mission`: one mission, or those of a situation, without the screen."""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from pa_console.cli import completion
from pa_console.cli.options import JsonOption, SessionOptions
from pa_console.cli.settings_defaults import OBSERVED, settings_of


class Approve(StrEnum):
    """The ways in which plans are approved."""

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
            help="Queue a mission for each alarm automatically. Default: only with --scenario.",
        ),
    ] = None
    log: Annotated[Path | None, typer.Option(help="File for the session log.")] = None
    stepped: bool = True


def mission(
    context: typer.Context,
    text: Annotated[
        str | None,
        typer.Argument(
            help="Mission in plain language; optional with --scenario.",
            autocompletion=completion.words_of_mission,
        ),
    ] = None,
    *,
    options: MissionOptions,
    approve: Annotated[
        Approve,
        typer.Option(
            help="ask: ask on the terminal; auto: approve a plan that the safeguards allow, if its "
            "order was read with confidence; never: reject every plan."
        ),
    ] = Approve.ask,
    override_reason: Annotated[
        str, typer.Option(help="With --approve auto: reason to override the judge's Failure.")
    ] = "",
    event: Annotated[
        list[str] | None,
        typer.Option(
            help="Event to simulate before the mission, as YAML. Repeatable. "
            "Example: '{kind: spawn, gate: WestGate, distance_m: 60}'"
        ),
    ] = None,
    choose: Annotated[
        int | None,
        typer.Option(
            metavar="NUMBER",
            min=1,
            help="If the console asks what the order means, take the choice with this number.",
        ),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Run one mission without the screen, or the missions of a situation.

    Each mission is planned, checked, rehearsed, judged, approved, executed and verified.
    """
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
