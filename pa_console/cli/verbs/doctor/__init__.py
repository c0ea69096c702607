"""`pa-console doctor`: says what is missing on this machine, and how to mend it."""

import asyncio
from collections.abc import Callable, Iterator
from contextlib import aclosing
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table
from rich.text import Text

from pa_console.cli.options import JsonOption
from pa_console.cli.verbs.doctor.checks import (
    Check,
    check_broker,
    check_build_tools,
    check_confinement,
    check_folders,
    check_libraries,
    check_link,
    check_load,
    check_model,
    check_python,
    check_schemes,
    check_sessions,
    check_terminal,
    load_or_default,
)
from pa_console.fleets.newcomers import LOOK_S
from pa_console.fleets.simulated import SimulatedFleet
from pa_console.llm.backend import (
    BackendOptions,
    EngineError,
    GenerationEnd,
    ModelError,
    Request,
    open_backend,
)
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.catalogue import LocalModel, find_model
from pa_console.llm.remote.address import KEY_VARIABLES, ServerKey
from pa_console.llm.remote.engine import ServerEngine
from pa_console.llm.remote.servers import SessionModels, session_models
from pa_console.mission.context import Services
from pa_console.mission.planning.propose import ask_for_plan
from pa_console.mission.retrieve import RetrievedRules
from pa_console.policy.retriever import Retriever
from pa_console.schema.evaluation import Variant
from pa_console.schema.events.event import ServerUse
from pa_console.schema.finding import Usage
from pa_console.schema.mission import Mission
from pa_console.schema.text import count
from pa_console.session.log.writer import default_folder
from pa_console.settings.schema import Settings
from pa_console.sim.checkpoint import Checkpoint
from pa_console.station.assembly import load_site
from pa_console.terminal.output import FAILED, errors, out, print_json

STYLES = {"ok": "green", "warning": "yellow", "missing": "bold red"}


def doctor(
    certificates: Annotated[
        Path | None,
        typer.Option(
            "--certificates",
            help="Look at the broker's configuration in this folder of 'pa-console site init' too.",
        ),
    ] = None,
    fleet: Annotated[
        list[str] | None,
        typer.Option(
            "--fleet",
            metavar="URL",
            help="Look at the robots on this link too, such as ros2:ADDRESS; nothing is commanded.",
        ),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Look for everything that the console needs; exit code 0 when nothing is missing."""
    with errors.status("looking") as status:
        checks = [check_broker(certificates)] if certificates is not None else []
        for url in fleet or ():
            status.update(f"looking at {url}, {LOOK_S:g} s at most")
            checks.append(check_link(url, load_or_default()[0].values))
        for check in _checks(status.update):
            checks.append(check)
            status.update(f"looked at {check.name}")
    missing = [check.name for check in checks if check.state == "missing"]
    if json:
        print_json({"ok": not missing, "checks": checks})
    else:
        _print(checks, missing)
    raise typer.Exit(FAILED if missing else 0)


def _checks(tell: Callable[[str], None]) -> Iterator[Check]:
    """Look at one thing after the other, when it is asked for; `tell` names what takes long."""
    yield check_python()
    yield from check_build_tools()
    yield from check_libraries()
    loaded, settings = load_or_default()
    loaded.export()
    yield settings
    yield from check_schemes()
    named = named_models(loaded.values)
    yield from check_model(named.own or "")
    yield from check_servers(named, loaded.values)
    yield check_load()
    tell(f"measuring the model's speed, {LIMIT_S:g} s at most")
    yield check_speed(named.own or "")
    yield check_confinement()
    yield from check_folders(loaded)
    yield check_sessions(loaded.values.logs or default_folder())
    yield from check_terminal()


def _print(checks: list[Check], missing: list[str]) -> None:
    """Print the checks as a table, into a pipe as lines that are as long as their paths."""
    table = Table(box=None, pad_edge=False, show_header=False)
    for check in checks:
        said = f"{check.found}\n→ {check.remedy}" if check.remedy else check.found
        if out.is_terminal:
            state = Text(check.state, STYLES[check.state])
            table.add_row(Text(check.name), state, Text(said, overflow="fold"))
        else:
            out.print_line(f"{check.name}: {check.state}: {said}")
    if out.is_terminal:
        out.print(table)
    for check in checks:
        if check.details:
            out.print_line(f"\n{check.name}")
            out.print(_details(check))
    warnings = sum(check.state == "warning" for check in checks)
    end = f"missing: {', '.join(missing)}" if missing else "nothing is missing"
    out.print_line(f"\n{end}; {count(warnings, 'warning')}")


def _details(check: Check) -> Table:
    """Return the table of a link's robots: what was found, and what will not work because of it."""
    table = Table(box=None, pad_edge=False)
    for title in ("asset", "message or parameter", "found", "should be", "consequence"):
        table.add_column(title, overflow="fold")
    for each in check.details:
        style = STYLES["warning"] if each.consequence else ""
        cells = (each.agent, each.what, each.found, each.wanted, each.consequence)
        table.add_row(*(Text(cell, style) for cell in cells))
    return table


SPEED = "model's speed"
LIMIT_S = 10.0
"""The longest measurement, seconds: `doctor` has to end soon."""

ENOUGH_S = 5.0
"""The time, seconds, within which a plan comes while the operator still looks at the screen."""

SPEED_MISSION = "Send a drone to look at the east gate."
SPEED_REMEDY = "close other programs, or choose a smaller model: pa-console models list"


def check_speed(name: str) -> Check:
    """Let the model `name` (empty: the default one) write one plan, if it is on this machine."""
    try:
        model = find_model(name or None)
    except ModelError as error:
        return Check(SPEED, "ok", f"not measured: {error}")
    try:
        return speed_words(model.name, asyncio.run(_one_plan(model)))
    except TimeoutError:
        found = f"{model.name} did not write a plan within {LIMIT_S:g} s: too slow to work with"
        return Check(SPEED, "warning", found, SPEED_REMEDY)
    except EngineError as error:
        return Check(SPEED, "warning", f"{model.name}: {error}", "see the checks of the model")


def speed_words(name: str, usage: Usage) -> Check:
    """Return the speed of this machine as the time of one plan of the model `name`."""
    read = usage.prompt_tokens - usage.cached_tokens
    found = (
        f"{name} reads {_rate(read, usage.first_token_s)} and writes "
        f"{_rate(usage.completion_tokens, usage.seconds - usage.first_token_s)} tokens/s: "
        f"a plan takes {usage.seconds:.1f} s"
    )
    if usage.seconds <= ENOUGH_S:
        return Check(SPEED, "ok", f"{found}, fast enough")
    return Check(SPEED, "warning", f"{found}, slow: expect to wait for it", SPEED_REMEDY)


def _rate(tokens: int, seconds: float) -> str:
    return f"{tokens / seconds:.0f}" if seconds > 0.0 else "?"


async def _one_plan(model: LocalModel) -> Usage:
    """Return what a plan costs; raises TimeoutError after LIMIT_S, and EngineError."""
    site = load_site("checkpoint", "checkpoint")
    engine = Engine(model)
    try:
        async with asyncio.timeout(LIMIT_S):
            fleet = SimulatedFleet(Checkpoint(site.world))
            services = Services.open(fleet, site.rulebook, engine, Variant())
            mission = Mission(id="doctor", text=SPEED_MISSION, created=datetime.now(UTC))
            hits = Retriever(site.rulebook.rules).retrieve(SPEED_MISSION)
            question = ask_for_plan(services, RetrievedRules(mission, hits))
            request = Request(
                "planner",
                question.prompt.system,
                question.prompt.user,
                question.grammar,
                services.prompt_format.plan_tokens,
                LIMIT_S,
            )
            async with aclosing(engine.generate(request)) as items:
                async for item in items:
                    if isinstance(item, GenerationEnd):
                        return item.usage
    finally:
        await engine.close()
    raise EngineError("the model's answer has no end")


SERVER = "model server"
SERVER_PROBLEM = "the model of this machine answers in its place"


def named_models(settings: Settings) -> SessionModels:
    """Return the models that the settings name; those of this machine alone where that is wrong."""
    try:
        return session_models(settings.model, settings.judge_server, settings.second_reader)
    except ModelError:
        return SessionModels(settings.model or None)


def check_servers(named: SessionModels, settings: Settings) -> Iterator[Check]:
    """Probe every server that is named; nothing is sent where none is."""
    if settings.judge_server and "judge" not in named.named:
        remedy = "pa-console settings set judge_server openai:BASE_URL#SERVER"
        yield Check(SERVER, "missing", f"judge_server: {settings.judge_server!r} is none", remedy)
    for use, name in named.named.items():
        yield check_server(use, name, plain=settings.plain_servers)


def check_server(use: ServerUse, name: str, *, plain: bool = False) -> Check:
    """Ask the server `name` which way of constraining an answer holds, and look for its key."""
    title = f"{SERVER}, {use}"
    try:
        engine = open_backend(name, BackendOptions(use, plain))
    except ModelError as error:
        return Check(title, "missing", str(error), "name another one, or none")
    if not isinstance(engine, ServerEngine):
        return Check(title, "ok", f"{engine.name}: the backend of another package, not asked")
    asyncio.run(_looked(engine))
    told = engine.report.told if engine.usable else engine.detail
    key = ServerKey.find(engine.address, KEY_VARIABLES[use])
    found = f"{engine.name}: {told}; key from {key.source}"
    match engine.state:
        case "ready":
            return Check(title, "ok", found)
        case "unconstrained":
            remedy = "use a server that holds answers to a JSON schema or a grammar"
            return Check(title, "warning", found, remedy)
        case _:
            remedy = (
                f"start it, and see its address and key ({KEY_VARIABLES[use]}); {SERVER_PROBLEM}"
            )
            return Check(title, "warning", found, remedy)


async def _looked(engine: ServerEngine) -> None:
    try:
        await engine.look()
    finally:
        await engine.close()
