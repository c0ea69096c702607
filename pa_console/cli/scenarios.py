"""`pa-console scenarios`: list, show and check the scripted situations of a world."""

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from pa_console.cli.output import JsonOption, WorldOption, out, print_json
from pa_console.orchestrator.compose import open_scenario, open_world
from pa_console.schema.scenario import After, AssetIs, Condition, TrackIs
from pa_console.session.wording import in_words
from pa_console.sim.scenario_file import list_scenarios

app = typer.Typer(no_args_is_help=True, help="List, show and check the situations of a world.")


@app.command("list")
def list_(world: WorldOption = "checkpoint", json: JsonOption = False) -> None:
    """List the situations that lie beside the world file."""
    _, path = open_world(world)
    found = list_scenarios(path)
    if json:
        print_json([{"name": name, "title": title} for name, title in found])
        return
    table = Table("Name", "What happens", box=None, pad_edge=False)
    for name, title in found:
        table.add_row(escape(name), escape(title))
    out.print(table)


@app.command()
def show(
    name: Annotated[str, typer.Argument(help="Name of a situation, or a file.")],
    world: WorldOption = "checkpoint",
    json: JsonOption = False,
) -> None:
    """Show what happens in a situation, and when."""
    found, path = open_world(world)
    scenario = open_scenario(found, path, name).scenario
    if json:
        print_json(scenario)
        return
    head = f"{scenario.title} ({scenario.duration_s:g} s)\n{scenario.about.strip()}\n"
    out.print(head, markup=False)
    for event in scenario.events:
        when = f"{event.at_s:g} s" if event.at_s is not None else _condition(event.when)
        delay = f" + {event.delay_s:g} s" if event.delay_s else ""
        out.print(f"  {when + delay:<34} {in_words(event.do)}", markup=False, highlight=False)
    for drawn in scenario.random:
        for incident in drawn.do:
            when = f"now and then, {drawn.mean_s:g} s apart"
            out.print(f"  {when:<34} {in_words(incident)}", markup=False, highlight=False)


@app.command()
def check(
    file: Annotated[Path, typer.Argument(help="A scenario file.")],
    world: WorldOption = "checkpoint",
) -> None:
    """Check a scenario file against a world; errors name line and field."""
    found, path = open_world(world)
    scenario = open_scenario(found, path, str(file)).scenario
    out.print(
        f"{file}: ok, {len(scenario.events)} events, {len(scenario.random)} random kinds",
        markup=False,
        soft_wrap=True,
    )


def _condition(condition: Condition | None) -> str:
    match condition:
        case TrackIs(track=track, state=state):
            return f"when {track} is {state}"
        case AssetIs(asset=asset, state=state, at=at):
            return f"when {asset} is {state.replace('_', ' ')}{f' at {at}' if at else ''}"
        case After(event=event):
            return f"after {event}"
        case None:
            return ""
