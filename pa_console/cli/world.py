"""`pa-console world`: generate a world, check one."""

from pathlib import Path
from typing import Annotated

import typer

from pa_console.cli.output import errors, out, print_document
from pa_console.schema.text import count
from pa_console.session.log.writer import refuse_audit_file
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.world_file import open_world
from pa_console.sim.worlds.world_generator import generate_world, world_yaml

app = typer.Typer(no_args_is_help=True, help="Generate a checkpoint world, or check one.")


@app.command()
def generate(
    gates: Annotated[int, typer.Option("--gates", help="Number of gates.")] = 4,
    assets: Annotated[int, typer.Option("--assets", help="Number of assets.")] = 8,
    seed: Annotated[int, typer.Option("--seed", help="Equal seeds give equal worlds.")] = 0,
    output: Annotated[
        Path | None, typer.Option("--out", "-o", help="File to write; stdout when left out.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Write over an existing file.")] = False,
) -> None:
    """Generate a valid world: other gates, shapes and teams for every seed."""
    if output is not None and output.exists() and not force:
        raise ValueError(f"{output} exists; give another name, or --force to write over it")
    with errors.status(f"laying out {count(gates, 'gate')} and {count(assets, 'asset')}"):
        text = world_yaml(generate_world(gates, assets, seed))
    if output is None:
        print_document(text)
        return
    refuse_audit_file(output)
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_text(text, encoding="utf-8")
    out.print(
        f"{output}: {count(gates, 'gate')}, {count(assets, 'asset')}; "
        f"open it with: pa-console console --world {output}",
        markup=False,
        soft_wrap=True,
    )


@app.command()
def check(
    world: Annotated[str, typer.Argument(help="A world: an installed name, a folder or a file.")],
) -> None:
    """Check a world file; errors name line and field."""
    loaded, path = open_world(world)
    with errors.status("placing the assets"):
        picture = Checkpoint(loaded).picture()
    bare = [gate for gate, cover in picture.gates.items() if not cover.covered]
    out.print(
        f"{path}: ok, {count(len(loaded.gates), 'gate')}, {count(len(loaded.assets), 'asset')}, "
        f"{count(len(loaded.cameras), 'camera')}",
        markup=False,
        soft_wrap=True,
    )
    if bare:
        out.print(f"gates that nobody covers at the start: {', '.join(bare)}", markup=False)
