"""`pa-console mission`: one mission through all eight steps, without the screen."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from pa_console.cli import completion
from pa_console.cli.options import (
    AcceptRulesOption,
    CertificatesOption,
    FleetOption,
    JsonOption,
    MetricsPortOption,
    ModelOption,
    RulesOption,
    ScenarioOption,
    SeedOption,
    TakContactsOption,
    TakOption,
    TakOriginOption,
    TracesOption,
    UnsignedOption,
    WitnessOption,
    WorldOption,
)
from pa_console.cli.sessions.options import SessionOptions
from pa_console.cli.settings_defaults import settings_of


class Approve(StrEnum):
    """The decider about the plan."""

    ask = "ask"
    auto = "auto"
    never = "never"


def mission(
    context: typer.Context,
    text: Annotated[
        str | None,
        typer.Argument(
            help="The mission, in plain language; not needed with --scenario.",
            autocompletion=completion.words_of_mission,
        ),
    ] = None,
    world: WorldOption = "checkpoint",
    rules: RulesOption = "checkpoint",
    model: ModelOption = None,
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
    scenario: ScenarioOption = None,
    alarms: Annotated[
        bool | None,
        typer.Option(
            "--alarms/--no-alarms",
            help="Alarms become missions by themselves; on by default with --scenario.",
        ),
    ] = None,
    seed: SeedOption = 0,
    fleet: FleetOption = "",
    certificates: CertificatesOption = None,
    log: Annotated[Path | None, typer.Option(help="Where to write the session log.")] = None,
    witness: WitnessOption = "",
    traces: TracesOption = "",
    metrics_port: MetricsPortOption = 0,
    tak: TakOption = "",
    tak_origin: TakOriginOption = "",
    tak_contacts: TakContactsOption = None,
    unsigned: UnsignedOption = False,
    accept_rules: AcceptRulesOption = False,
    json: JsonOption = False,
) -> None:
    """Plan, check, rehearse, judge, decide, execute and verify one mission, or a situation's."""
    from pa_console.cli.sessions.mission import run_mission  # noqa: PLC0415 - no help waits for it
    from pa_console.cli.sessions.observing import observing  # noqa: PLC0415

    options = SessionOptions(
        world=world,
        rules=rules,
        scenario=scenario,
        seed=seed,
        alarms=alarms,
        unsigned=unsigned,
        accept_rules=accept_rules,
        fleet=fleet,
        certificates=certificates,
        witness=witness,
        log=log,
        stepped=True,
    )
    settings = settings_of(
        context,
        traces=traces,
        metrics_port=metrics_port,
        tak=tak,
        tak_origin=tak_origin,
        tak_contacts=tak_contacts,
    ).values
    with observing(settings, world, live=True) as beside:
        run_mission(
            options,
            settings,
            model,
            beside,
            text,
            standing=None if approve is Approve.ask else approve.value,
            override_reason=override_reason,
            setup=event or (),
            json=json,
        )
