"""`pa-console settings`: settings and their origins, shown, changed or reset."""

from typing import Annotated, Any

import typer
from rich.table import Table
from rich.text import Text

from pa_console.cli import completion
from pa_console.cli.options import JsonOption
from pa_console.cli.settings_defaults import given_words, read_assignments
from pa_console.settings.schema import describe_settings, value_text
from pa_console.settings.sources import (
    LoadedSettings,
    load_settings,
    reset_settings,
    save_setting,
    settings_file,
)
from pa_console.terminal.output import out, print_json

app = typer.Typer(
    no_args_is_help=True,
    help="Show, change and reset the settings. A setting is taken from the first source that has "
    "it: the command line (an option, or --set NAME=VALUE before the verb), the environment "
    "(PA_CONSOLE_...), the settings file, the defaults.",
)
NameArgument = Annotated[
    str,
    typer.Argument(
        help="Setting, or keys.ACTION; 'pa-console settings show' lists them.",
        autocompletion=completion.settings,
    ),
]


@app.command()
def show(context: typer.Context, json: JsonOption = False) -> None:
    """Show every setting with its value, the source of the value, and a description."""
    loaded = load_settings(read_assignments(given_words(context)))
    wrong = _problems(loaded)
    if json:
        print_json({"file": str(loaded.path), "settings": _rows(loaded), "problems": wrong})
        raise typer.Exit(2 if wrong else 0)
    table = Table("setting", "value", "source", "description", box=None, pad_edge=False)
    for name, about in describe_settings().items():
        origin, value = loaded.origin(name), getattr(loaded.values, name)
        if name == "keys":
            value = "\n".join(f"{key}: {keys}" for key, keys in value.items())
        place = origin.place.removeprefix(str(loaded.path)).removeprefix(":")
        place = f"file, line {place}" if origin.source == "file" else place or origin.source
        limits = f" {about.limits[0].upper()}{about.limits[1:]}." if about.limits else ""
        texts = (name, value_text(value), place, about.help + limits)
        table.add_row(*(Text(text, overflow="fold") for text in texts))
    out.print(table)
    there = "" if loaded.document is not None else " (does not exist yet)"
    out.print_line(f"\nfile: {loaded.path}{there}")
    for problem in wrong:
        out.print_line(f"problem: {problem}", style="bold red")
    raise typer.Exit(2 if wrong else 0)


def _rows(loaded: LoadedSettings) -> list[dict[str, Any]]:
    return [
        {
            "name": name,
            "title": about.title,
            "value": getattr(loaded.values, name),
            "default": about.default,
            "source": loaded.origin(name).source,
            "place": loaded.origin(name).place,
            "help": about.help,
            "limits": about.limits,
            "variable": about.variable,
            "needs_restart": about.restart,
        }
        for name, about in describe_settings().items()
    ]


def _problems(loaded: LoadedSettings) -> list[str]:
    from pa_console.tui.screens.settings import problems  # noqa: PLC0415 - the screen's libraries

    return [str(loaded.error(field, problem)) for field, problem in problems(loaded.values)]


@app.command()
def path() -> None:
    """Print the path of the settings file, which PA_CONSOLE_SETTINGS overrides."""
    out.print_line(str(settings_file()))


@app.command("set")
def set_(
    name: NameArgument,
    value: Annotated[str, typer.Argument(help="Value; an empty one restores the default.")],
) -> None:
    """Check a setting and write it to the file; comments in the file are kept."""
    _write(name, value)


@app.command()
def unset(name: NameArgument) -> None:
    """Remove a setting from the file, so that its default applies."""
    _write(name, "")


def _write(name: str, text: str) -> None:
    """Check and save one setting, as on the settings screen; raises ValueError, DocumentError."""
    from pa_console.tui.screens.settings import choices, to_write  # noqa: PLC0415

    name = name if name.startswith("keys.") else name.replace("-", "_")
    settings = {choice.id: choice for choice in choices()}
    if name not in settings:
        raise ValueError(f"unknown setting {name!r}; the settings are: {', '.join(settings)}")
    loaded = load_settings()
    try:
        field, value = to_write(loaded, settings[name], text)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error
    save_setting(loaded.path, field, value)
    done = f"{name} is now {text}" if text.strip() else f"{name} has its default value again"
    out.print_line(f"{loaded.path}: {done}")
    origin = load_settings().origin(field)
    if origin.source == "environment":
        out.print(f"note: the environment variable {origin.place} overrides the file")


@app.command()
def reset() -> None:
    """Restore all defaults; the old file is kept as a backup."""
    file = settings_file()
    backup = reset_settings(file)
    result = f"moved to {backup}" if backup is not None else "does not exist; the defaults apply"
    out.print_line(f"{file}: {result}")
