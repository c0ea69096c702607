"""`pa-console doctor`: says what is missing on this machine, and how to mend it."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table
from rich.text import Text

from pa_console.cli.doctor.checks import (
    Check,
    check_broker,
    check_build_tools,
    check_confinement,
    check_folders,
    check_libraries,
    check_load,
    check_model,
    check_python,
    check_sessions,
    check_terminal,
    load_or_default,
)
from pa_console.cli.doctor.model_servers import check_servers, named_models
from pa_console.cli.doctor.speed import LIMIT_S, check_speed
from pa_console.cli.output import FAILED, JsonOption, errors, out, print_json
from pa_console.schema.text import count
from pa_console.session.log.writer import default_folder

STYLES = {"ok": "green", "warning": "yellow", "missing": "bold red"}


def doctor(
    certificates: Annotated[
        Path | None,
        typer.Option(
            "--certificates",
            help="Look at the broker's configuration in this folder of 'pa-console site init' too.",
        ),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Look for everything that the console needs; exit code 0 when nothing is missing."""
    with errors.status("looking") as status:
        checks = [check_broker(certificates)] if certificates is not None else []
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
    table = Table(box=None, pad_edge=False, show_header=False)
    for check in checks:
        said = f"{check.found}\n→ {check.remedy}" if check.remedy else check.found
        table.add_row(
            Text(check.name), Text(check.state, STYLES[check.state]), Text(said, overflow="fold")
        )
    out.print(table)
    warnings = sum(check.state == "warning" for check in checks)
    end = f"missing: {', '.join(missing)}" if missing else "nothing is missing"
    out.print(f"\n{end}; {count(warnings, 'warning')}", markup=False, soft_wrap=True)
