"""`pa-console doctor`: the checks of this machine, with remedies."""

from collections.abc import Callable, Iterator
from dataclasses import astuple
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table
from rich.text import Text

from pa_console.cli.options import JsonOption
from pa_console.cli.verbs.doctor import checks as machine
from pa_console.cli.verbs.doctor import models
from pa_console.cli.verbs.doctor.checks import Check
from pa_console.fleets.newcomers import LOOK_S
from pa_console.schema.text import count
from pa_console.session.log.writer import default_folder
from pa_console.terminal.output import FAILED, errors, out, print_json

STYLES = {"ok": "green", "warning": "yellow", "missing": "bold red"}


def doctor(
    certificates: Annotated[
        Path | None,
        typer.Option(
            "--certificates",
            help="Also check the broker's configuration in this folder, which "
            "'pa-console site init' created.",
        ),
    ] = None,
    fleet: Annotated[
        list[str] | None,
        typer.Option(
            "--fleet",
            metavar="URL",
            help="Also check the robots on this link, such as ros2:ADDRESS. No command is sent.",
        ),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Check this machine for everything that the console needs.

    Exits with 1 if something is missing.
    """
    with errors.status("checking") as status:
        checks = [machine.check_broker(certificates)] if certificates is not None else []
        values = machine.load_or_default()[0].values
        for url in fleet or ():
            status.update(f"checking {url}, at most {LOOK_S:g} s")
            checks.append(machine.check_link(url, values, certificates))
        for check in _checks(status.update):
            checks.append(check)
            status.update(f"checked {check.name}")
    missing = [check.name for check in checks if check.state == "missing"]
    if json:
        print_json({"ok": not missing, "checks": checks})
    else:
        _print(checks, missing)
    raise typer.Exit(FAILED if missing else 0)


def _checks(tell: Callable[[str], None]) -> Iterator[Check]:
    """Yield the checks one by one; `tell` is called with a line before each slow check."""
    yield machine.check_python()
    yield from machine.check_build_tools()
    yield from machine.check_libraries()
    loaded, settings = machine.load_or_default()
    loaded.export()
    yield settings
    yield from machine.check_schemes()
    named = models.named_models(loaded.values)
    yield from models.check_model(named.own or "")
    yield from models.check_servers(named, loaded.values)
    yield models.check_load()
    tell(f"measuring the speed of the model, at most {models.LIMIT_S:g} s")
    yield models.check_speed(named.own or "")
    yield models.check_confinement()
    yield from machine.check_folders(loaded)
    yield machine.check_sessions(loaded.values.logs or default_folder())
    yield from machine.check_terminal()


def _print(checks: list[Check], missing: list[str]) -> None:
    """Print the checks as a table on a terminal, and as unwrapped lines elsewhere."""
    table = Table(box=None, pad_edge=False, show_header=False)
    for check in checks:
        text = f"{check.found}\n→ {check.remedy}" if check.remedy else check.found
        if out.is_terminal:
            state = Text(check.state, STYLES[check.state])
            table.add_row(Text(check.name), state, Text(text, overflow="fold"))
        else:
            out.print_line(f"{check.name}: {check.state}: {text}")
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
    """Return the table of findings about a link's robots, with their consequences."""
    table = Table(box=None, pad_edge=False)
    for title in ("asset", "message or parameter", "found", "should be", "consequence"):
        table.add_column(title, overflow="fold")
    for finding in check.details:
        style = STYLES["warning"] if finding.consequence else ""
        table.add_row(*(Text(cell, style) for cell in astuple(finding)))
    return table
