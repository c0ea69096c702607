"""`pa-console console`: the screen."""

import sys
from asyncio import Runner
from collections.abc import Generator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from threading import Event
from typing import TYPE_CHECKING, Annotated

import typer

from pa_console.cli.output import (
    AcceptRulesOption,
    CertificatesOption,
    FleetOption,
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
from pa_console.llm.models.preparing import Progress

if TYPE_CHECKING:
    from pa_console.orchestrator.station.assembly import Site
    from pa_console.policy.trust.pinned_rules import RulesPins
    from pa_console.session.log.chain import LogError


def console(
    context: typer.Context,
    world: WorldOption = "checkpoint",
    rules: RulesOption = "checkpoint",
    model: ModelOption = None,
    scenario: ScenarioOption = None,
    seed: SeedOption = 0,
    fleet: FleetOption = "",
    certificates: CertificatesOption = None,
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
    with Runner() as loop:
        with ThreadPoolExecutor(1) as hashing, _stopped_when_left() as going_on:
            found = hashing.submit(find_model, model, going_on)
            from pa_console.cli.fleet import find_fleet  # noqa: PLC0415
            from pa_console.cli.session_log import open_log, tell_of_witness  # noqa: PLC0415
            from pa_console.orchestrator.station.assembly import open_station  # noqa: PLC0415
            from pa_console.orchestrator.station.rules_in_force import RulesWatch  # noqa: PLC0415
            from pa_console.orchestrator.station.ticking import RealTimeClock  # noqa: PLC0415
            from pa_console.policy.trust.pinned_rules import RulesPins  # noqa: PLC0415
            from pa_console.signing import load_signer  # noqa: PLC0415
            from pa_console.sim.worlds.scenario_file import open_scenario  # noqa: PLC0415 - meanwhile

            engine = Engine(found.result())
        loop.run(engine.start())
        try:
            from pa_console.tui.app import ConsoleApp  # noqa: PLC0415 - while the model is loaded

            pins, deadline_s = RulesPins(), settings.values.check_deadline_ms / 1000.0
            on_bus = find_fleet(fleet, certificates, world, settings.values, scenario)
            site = _open_site(
                on_bus.world,
                rules,
                unsigned=unsigned,
                pins=pins,
                accept=accept_rules,
                deadline_s=deadline_s,
            )
            file = site.rules_path
            watch = (
                RulesWatch(file, unsigned=unsigned, pins=pins, deadline_s=deadline_s)
                if file is not None
                else None
            )
            played = open_scenario(site.world, site.world_path, scenario) if scenario else None
            signer = load_signer()
            station = open_station(
                site,
                engine,
                on_bus.clock(RealTimeClock()),
                seed=seed,
                readonly=readonly,
                scenario=played,
                respond=alarms,
                watch=watch,
                fleet=on_bus.drive(site),
            )
            require_keys("use 'pa-console mission' in scripts")
            station.rate = settings.values.speed

            def cannot_write(error: "LogError") -> None:
                app.notify(
                    str(error), title="Session log", severity="error", timeout=30, markup=False
                )

            writer = open_log(
                settings.values, station.session, signer, cannot_write, witness=witness
            )
            app = ConsoleApp(
                site.world,
                station,
                site.rulebook,
                station.retriever,
                readonly=readonly,
                settings=settings,
                rules_file=file,
            )
        except BaseException:
            loop.run(engine.close())
            raise
        leaving = app.controllers.leaving
        with end_signals(leaving.end), writer:
            station.write_to(writer)
            loop.run(app.run_async(mouse=mouse))
    tell_of_witness(writer)
    out.print(f"session log: {writer.path}", markup=False, soft_wrap=True)
    if leaving.ended_by:
        raise typer.Exit(exit_code_of(leaving.ended_by))


@contextmanager
def _stopped_when_left() -> Generator[Progress]:
    """Give what stops the preparing of weights, whose progress it is told, once this is left."""
    left = Event()

    def going_on(_done: int, _total: int, _text: str) -> None:
        if left.is_set():
            raise KeyboardInterrupt

    try:
        yield going_on
    finally:
        left.set()


def _open_site(
    world: str, rules: str, *, unsigned: bool, pins: "RulesPins", accept: bool, deadline_s: float
) -> "Site":
    """Load world and rules; those that are refused are offered to the operator on the terminal."""
    from pa_console.orchestrator.station.assembly import load_site  # noqa: PLC0415
    from pa_console.policy.trust.pinned_rules import RefusedRulesError  # noqa: PLC0415

    def load(*, accept: bool) -> "Site":
        return load_site(
            world, rules, unsigned=unsigned, pins=pins, accept=accept, deadline_s=deadline_s
        )

    try:
        return load(accept=accept)
    except RefusedRulesError as error:
        if not _accepted(error):
            raise
        return load(accept=True)


def _accepted(error: ValueError) -> bool:
    """Ask on the terminal whether refused rules go in force all the same; Enter means no."""
    errors.print(str(error), style="bold red", markup=False, soft_wrap=True)
    return sys.stdin.isatty() and typer.confirm("Put these rules in force?", default=False)
