"""`pa-console console`: the screen."""

import sys
from concurrent.futures import ThreadPoolExecutor
from threading import Event
from typing import Annotated

import typer

from pa_console.cli.output import (
    AcceptRulesOption,
    ModelOption,
    RulesOption,
    ScenarioOption,
    SeedOption,
    UnsignedOption,
    WitnessOption,
    WorldOption,
    errors,
    out,
    require_keys,
)
from pa_console.cli.settings_defaults import settings_of
from pa_console.end_signals import end_signals, exit_code_of
from pa_console.llm.engine.engine import Engine
from pa_console.llm.models.catalogue import find_model
from pa_console.session.log.chain import LogError


def console(
    context: typer.Context,
    world: WorldOption = "checkpoint",
    rules: RulesOption = "checkpoint",
    model: ModelOption = None,
    scenario: ScenarioOption = None,
    seed: SeedOption = 0,
    alarms: Annotated[
        bool, typer.Option("--alarms/--no-alarms", help="Alarms become missions by themselves.")
    ] = True,
    readonly: Annotated[
        bool, typer.Option("--readonly", help="Look only: every command is refused.")
    ] = False,
    witness: WitnessOption = "",
    unsigned: UnsignedOption = False,
    accept_rules: AcceptRulesOption = False,
    mouse: Annotated[
        bool,
        typer.Option("--mouse/--no-mouse", help="Take the mouse, or leave it to the terminal."),
    ] = True,
) -> None:
    """Open the console: live checkpoint, policy browser, missions, trace and approval."""
    if not sys.stdout.isatty():
        raise ValueError("the console needs a terminal; use 'pa-console mission' in scripts")
    settings = settings_of(
        context, world=world, rules=rules, model=model or "", alarms=alarms, mouse=mouse
    )
    left = Event()

    def going_on(_done: int, _total: int, _text: str) -> None:
        if left.is_set():
            raise KeyboardInterrupt

    with ThreadPoolExecutor(1) as hashing:
        found = hashing.submit(find_model, model, going_on)
        try:
            from pa_console.cli.session_log import open_log, tell_of_witness  # noqa: PLC0415
            from pa_console.orchestrator.station.assembly import (  # noqa: PLC0415
                Site,
                load_site,
                open_station,
            )
            from pa_console.orchestrator.station.rules_in_force import RulesWatch  # noqa: PLC0415
            from pa_console.orchestrator.station.ticking import RealTimeClock  # noqa: PLC0415 - meanwhile
            from pa_console.policy.trust.pinned_rules import RefusedRulesError, RulesPins  # noqa: PLC0415
            from pa_console.signing import load_signer  # noqa: PLC0415
            from pa_console.sim.worlds.scenario_file import open_scenario  # noqa: PLC0415
            from pa_console.tui.app import ConsoleApp  # noqa: PLC0415

            pins, deadline_s = RulesPins(), settings.values.check_deadline_ms / 1000.0

            def open_site(*, accept: bool) -> Site:
                return load_site(
                    world, rules, unsigned=unsigned, pins=pins, accept=accept, deadline_s=deadline_s
                )

            try:
                site = open_site(accept=accept_rules)
            except RefusedRulesError as error:
                if not _accepted(error):
                    raise
                site = open_site(accept=True)
            file = site.rules_path
            watch = (
                RulesWatch(file, unsigned=unsigned, pins=pins, deadline_s=deadline_s)
                if file is not None
                else None
            )
            played = open_scenario(site.world, site.world_path, scenario) if scenario else None
            signer = load_signer()
            engine = Engine(found.result())
        finally:
            left.set()
    station = open_station(
        site,
        engine,
        RealTimeClock(),
        seed=seed,
        readonly=readonly,
        scenario=played,
        respond=alarms,
        watch=watch,
    )
    require_keys("use 'pa-console mission' in scripts")
    station.rate = settings.values.speed

    def cannot_write(error: LogError) -> None:
        app.notify(str(error), title="Session log", severity="error", timeout=30, markup=False)

    writer = open_log(settings.values, station.session, signer, cannot_write, witness=witness)
    app = ConsoleApp(
        site.world,
        station,
        site.rulebook,
        station.retriever,
        readonly=readonly,
        settings=settings,
        rules_file=file,
    )
    leaving = app.controllers.leaving
    with end_signals(leaving.end), writer:
        station.write_to(writer)
        app.run(mouse=mouse)
    tell_of_witness(writer)
    out.print(f"session log: {writer.path}", markup=False, soft_wrap=True)
    if leaving.ended_by:
        raise typer.Exit(exit_code_of(leaving.ended_by))


def _accepted(error: ValueError) -> bool:
    """Ask on the terminal whether refused rules go in force all the same; Enter means no."""
    errors.print(str(error), style="bold red", markup=False, soft_wrap=True)
    return sys.stdin.isatty() and typer.confirm("Put these rules in force?", default=False)
