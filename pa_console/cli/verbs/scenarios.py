"""`pa-console scenarios`: the situations of a world."""

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from pa_console.cli import completion
from pa_console.cli.options import JsonOption, WorldOption
from pa_console.schema.incident import After, AssetIs, AssetReach, IncidentCondition, TrackIs
from pa_console.schema.text import count
from pa_console.sim.worlds.scenario_file import list_scenarios, open_scenario
from pa_console.sim.worlds.world_file import open_world
from pa_console.terminal.output import out, print_json
from pa_console.views.event_words import incident_truth_in_words

ASSET_STATES: dict[AssetReach, str] = {
    "moving": "is moving",
    "arrived": "has arrived",
    "low_battery": "is low on battery",
    "failed": "has failed",
    "charging": "is charging",
    "silent": "is silent",
}

app = typer.Typer(no_args_is_help=True, help="List, show and check the situations of a world.")


@app.command("list")
def list_(world: WorldOption = "checkpoint", json: JsonOption = False) -> None:
    """List the situations of a world."""
    _, path = open_world(world)
    situations = list_scenarios(path)
    if json:
        print_json([{"name": name, "title": title} for name, title in situations])
        return
    table = Table("Name", "What happens", box=None, pad_edge=False)
    for name, title in situations:
        table.add_row(name, title)
    out.print(table)


@app.command()
def show(
    name: Annotated[
        str,
        typer.Argument(help="Situation: a name or a file.", autocompletion=completion.scenarios),
    ],
    world: WorldOption = "checkpoint",
    json: JsonOption = False,
) -> None:
    """Show what happens in a situation and when."""
    loaded, path = open_world(world)
    scenario = open_scenario(loaded, path, name).scenario
    if json:
        print_json(scenario)
        return
    head = f"{scenario.title} ({scenario.duration_s:g} s)\n{scenario.about.strip()}\n"
    out.print(head)
    table = Table(box=None, show_header=False, padding=(0, 2))
    table.add_column(no_wrap=True)
    table.add_column()
    for event in scenario.events:
        when = f"{event.at_s:g} s" if event.at_s is not None else _condition(event.when)
        delay = f" + {event.delay_s:g} s" if event.delay_s else ""
        table.add_row(when + delay, incident_truth_in_words(event.do))
    for drawn in scenario.random:
        for incident in drawn.do:
            when = f"at random, {drawn.mean_s:g} s apart on average"
            table.add_row(when, incident_truth_in_words(incident))
    out.print(table)


@app.command("check")
def check_scenario(
    file: Annotated[Path, typer.Argument(help="Scenario file.")],
    world: WorldOption = "checkpoint",
) -> None:
    """Check a scenario file against a world; errors name the line and the field."""
    loaded, path = open_world(world)
    scenario = open_scenario(loaded, path, str(file)).scenario
    out.print_line(
        f"{file}: ok, {count(len(scenario.events), 'event')}, "
        f"{count(len(scenario.random), 'kind')} of random event"
    )


def _condition(condition: IncidentCondition | None) -> str:
    match condition:
        case TrackIs(track=track, state=state):
            return f"when {track} is {state}"
        case AssetIs(asset=asset, state=state, at=at):
            return f"when {asset} {ASSET_STATES[state]}{f' at {at}' if at else ''}"
        case After(event=event):
            return f"after {event}"
        case None:
            return ""
