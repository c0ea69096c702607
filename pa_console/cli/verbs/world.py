"""`pa-console world`: worlds, generated, built from robots, or checked."""

from pathlib import Path
from typing import Annotated

import typer

from pa_console.cli import completion
from pa_console.cli.options import WorldOption
from pa_console.cli.sessions.fleet import open_listener
from pa_console.cli.settings_defaults import settings_of
from pa_console.fleets.link import FoundRobot
from pa_console.schema.text import count
from pa_console.schema.world import World
from pa_console.session.log.writer import refuse_audit_file
from pa_console.sim.worlds.world_file import open_world
from pa_console.sim.worlds.world_generator import generate_world, world_yaml
from pa_console.terminal.output import errors, out, print_document

app = typer.Typer(
    no_args_is_help=True, help="Generate a world, build one from robots, or check one."
)
OutOption = Annotated[
    Path | None, typer.Option("--out", "-o", help="File to write. Default: stdout.")
]
ForceOption = Annotated[bool, typer.Option("--force", help="Overwrite an existing file.")]


@app.command()
def generate(
    gates: Annotated[int, typer.Option("--gates", help="Number of gates.")] = 4,
    assets: Annotated[int, typer.Option("--assets", help="Number of assets.")] = 8,
    seed: Annotated[int, typer.Option("--seed", help="Seed; equal seeds give equal worlds.")] = 0,
    output: OutOption = None,
    force: ForceOption = False,
) -> None:
    """Generate a valid world, whose gates, shapes and team depend on the seed."""
    _refuse_existing(output, force=force)
    with errors.status(f"placing {count(gates, 'gate')} and {count(assets, 'asset')}"):
        made = generate_world(gates, assets, seed)
    _write(made, output, "")


@app.command("from")
def from_robots(
    context: typer.Context,
    fleet: Annotated[
        list[str],
        typer.Option(
            "--fleet",
            metavar="URL",
            help="Link to robots, such as ros2:ADDRESS. Repeatable. No command is sent.",
        ),
    ],
    world: WorldOption = "checkpoint",
    place: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=X,Y[,KIND]",
            help="Place in metres, which replaces the places of --world. Repeatable. KIND is gate, "
            "post or base; one base and at least one gate are needed.",
        ),
    ] = None,
    map_file: Annotated[
        Path | None,
        typer.Option(
            "--map",
            metavar="FILE",
            help="Background: map.yaml of a robot's occupancy map (ROS map server, PGM).",
        ),
    ] = None,
    output: OutOption = None,
    force: ForceOption = False,
) -> None:
    """Build a world from the robots on these links, with their map as the background."""
    from pa_console.fleets import newcomers  # noqa: PLC0415
    from pa_console.fleets.newcomers import survey  # noqa: PLC0415 - only with robots
    from pa_console.sim.worlds.occupancy_map import read_occupancy_map  # noqa: PLC0415

    _refuse_existing(output, force=force)
    base, _ = open_world(world)
    background = read_occupancy_map(map_file) if map_file is not None else None
    if place:
        places = newcomers.places_of(place)
        base = newcomers.around_places(base, "World of robots", places, background)
    elif background is not None:
        base = base.model_copy(update={"background": background})
    present: set[str] = set()
    robots: dict[str, FoundRobot] = {}
    for url in fleet:
        with errors.status(f"looking for robots at {url}"):
            seen = survey(open_listener(url, None, base, settings_of(context).values))
        errors.print_line(seen.in_words())
        present |= seen.reports.keys()
        robots |= {robot.name: robot for robot in seen.found}
    made, notices = newcomers.world_of_robots(base, present | robots.keys(), robots.values())
    for line in notices:
        errors.print_line(line)
    options = " ".join(f"--fleet {url}" for url in fleet)
    _write(made, output, f" {options}")


def _refuse_existing(output: Path | None, *, force: bool) -> None:
    """Raise ValueError if the file exists and may not be overwritten."""
    if output is not None and output.exists() and not force:
        raise ValueError(f"{output} exists; choose another name, or overwrite it with --force")


def _write(world: World, output: Path | None, options: str) -> None:
    """Write a world to `output`, by default stdout, and print how to open it with `options`."""
    text = world_yaml(world)
    if output is None:
        print_document(text)
        return
    refuse_audit_file(output)
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_text(text, encoding="utf-8")
    out.print_line(
        f"{output}: {count(len(world.gates), 'gate')}, {count(len(world.assets), 'asset')}; "
        f"open it with: pa-console console --world {output}{options}"
    )


@app.command()
def check(
    world: Annotated[
        str,
        typer.Argument(
            help="World: an installed name, a folder or a file.", autocompletion=completion.worlds
        ),
    ],
) -> None:
    """Check a world file; errors name the line and the field."""
    from pa_console.sim.checkpoint import Checkpoint  # noqa: PLC0415 - scenarios need no pymunk

    loaded, path = open_world(world)
    with errors.status("placing the assets"):
        picture = Checkpoint(loaded).picture()
    bare = [gate for gate, cover in picture.gates.items() if not cover.covered]
    out.print_line(
        f"{path}: ok, {count(len(loaded.gates), 'gate')}, {count(len(loaded.assets), 'asset')}, "
        f"{count(len(loaded.cameras), 'camera')}"
    )
    if bare:
        out.print(f"gates not covered at the start: {', '.join(bare)}")
