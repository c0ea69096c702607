"""`pa-console models`: the catalogue of models, and downloads."""

from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer
from rich.box import SIMPLE_HEAD
from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from pa_console.cli import completion
from pa_console.cli.options import JsonOption
from pa_console.llm.models.catalogue import Catalog, ModelEntry
from pa_console.llm.models.fetching import pull as fetch
from pa_console.terminal.output import errors, out, print_json

app = typer.Typer(help="List and download language models.", no_args_is_help=True)


@app.command("list")
def list_models(json: JsonOption = False) -> None:
    """List the models in the catalogue and whether they are on this machine."""
    catalog = Catalog.load()
    if json:
        print_json([_row(catalog, entry) for entry in catalog.models])
        return
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("model", no_wrap=True)
    table.add_column("size", no_wrap=True, justify="right")
    table.add_column("here", min_width=8)
    table.add_column("description", ratio=1)
    for entry in catalog.models:
        name = f"{entry.name}\n(default)" if entry.name == catalog.default else entry.name
        about = f"{entry.title}, {entry.quantisation}, {entry.licence}. {entry.notes}".strip()
        table.add_row(name, f"{entry.size_mb} MB", _here(entry), about)
    for server in catalog.servers:
        table.add_row(server.name, "", "on a server", f"{server.title}: {server.address}")
    out.print(table)


def _here(entry: ModelEntry) -> str:
    """Return the state of the model on this machine, including its prepared weights, in words."""
    if entry.local_file is None:
        return "no"
    if entry.how is None:
        return "yes"
    made = "prepared" if entry.prepared_file is not None else "not prepared yet"
    return f"yes, {entry.how} {made}"


def _row(catalog: Catalog, entry: ModelEntry) -> dict[str, Any]:
    local, prepared = entry.local_file, entry.prepared_file
    return entry.model_dump(mode="json") | {
        "default": entry.name == catalog.default,
        "path": None if local is None else str(local),
        "prepared_path": None if prepared is None else str(prepared),
    }


@app.command()
def pull(
    name: Annotated[
        str | None,
        typer.Argument(
            help="Model in the catalogue. Default: the console's default model.",
            autocompletion=completion.models,
        ),
    ] = None,
    with_reader: Annotated[
        bool,
        typer.Option(
            "--with-second-reader",
            help="Also download the model that reads an order again if this model is unsure.",
        ),
    ] = False,
    fetch_only: Annotated[
        bool,
        typer.Option(
            "--fetch-only",
            help="Do not convert the weights; the next pull or the console converts them.",
        ),
    ] = False,
    json: JsonOption = False,
) -> None:
    """Download a model to the user's cache, verify its hash, and convert its weights if needed.

    An interrupted download continues where it stopped.
    """
    catalog = Catalog.load()
    entry = catalog.get(name or catalog.default)
    if with_reader and not entry.second_reader:
        raise ValueError(f"{entry.name} has no second reader; omit --with-second-reader")
    entries = [entry, catalog.get(entry.second_reader)] if with_reader else [entry]
    fetched = [_fetch(model, prepare=not fetch_only) for model in entries]
    if json:
        print_json(
            fetched[0].document if len(fetched) == 1 else [model.document for model in fetched]
        )
        return
    for model in fetched:
        out.print_line(str(model.path))
        if model.note:
            errors.print(model.note)


class _ReadyModel(NamedTuple):
    """A model that is ready for use, and notices about it."""

    path: Path
    note: str
    document: dict[str, Any]


def _fetch(entry: ModelEntry, *, prepare: bool) -> _ReadyModel:
    """Fetch `entry` and, with `prepare`, prepare its weights; a bar shows the progress."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        DownloadColumn(),
        TimeRemainingColumn(),
    )
    note = ""
    with Progress(*columns, console=errors) as bar:
        task = bar.add_task(entry.name, total=entry.size_mb * 1_000_000)

        def progress(done: int, total: int, text: str) -> None:
            nonlocal note
            note = text
            bar.update(task, completed=done, total=total, description=f"{entry.name}: {text}")

        fetched = fetch(entry, progress)
        hash_note = note if entry.sha256 is None else ""
        path, sha256 = fetched, entry.sha256
        if prepare:
            path, sha256 = entry.ready_file(fetched, progress)
        size = path.stat().st_size
        bar.update(task, completed=size, total=size, description=f"{entry.name} is ready")
    pinned = {"source_path": str(fetched), "source_sha256": entry.sha256}
    return _ReadyModel(
        path, hash_note, {"model": entry.name, "path": str(path), "sha256": sha256, **pinned}
    )
