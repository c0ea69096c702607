"""`pa-console serve`: a session for programs, or the console in a browser."""

from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from pa_console.child_processes import python_command
from pa_console.cli.options import AttendedOptions, JsonOption
from pa_console.cli.settings_defaults import OBSERVED, given_words, settings_of
from pa_console.resources import naming_what_is_missing

PORT = 8765
OWN = frozenset(("port", "web", "make_token", "person", "tokens", "revoke_token", "json"))
"""The options of this verb that the verb `console` does not have."""
IN_FILES = {
    "world": ("", "world.yaml"),
    "rules": ("", "rules.yaml"),
    "scenario": ("",),
    "model": ("",),
}
"""The options that may be the path of a file ('') or of a folder with a file of this name."""
RoleName = Literal["observer", "proposer", "operator", "commander"]


def serve(
    context: typer.Context,
    options: AttendedOptions,
    port: Annotated[
        int, typer.Option(min=0, max=65_535, help="Local port to serve on; 0 picks a free one.")
    ] = PORT,
    web: Annotated[
        bool, typer.Option("--web", help="Serve the console for a browser instead of the API.")
    ] = False,
    make_token: Annotated[
        RoleName | None,
        typer.Option("--make-token", help="Create a token with this role, print it, and exit."),
    ] = None,
    person: Annotated[
        str | None,
        typer.Option(
            help="With --make-token: person or agent that the token is for. Default: the current "
            "user."
        ),
    ] = None,
    tokens: Annotated[bool, typer.Option("--tokens", help="List the tokens and exit.")] = False,
    revoke_token: Annotated[
        str | None, typer.Option(metavar="ID", help="Revoke the token with this id and exit.")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Serve a session on this machine: as an HTTP API (see /docs), or as the console in a browser.

    Other machines cannot connect.
    """
    from pa_console.cli.sessions import tokens as token_verbs  # noqa: PLC0415 - not needed for help

    if make_token is not None:
        token_verbs.make(make_token, person, json=json)
        return
    if tokens:
        token_verbs.show(json=json)
        return
    if revoke_token is not None:
        token_verbs.revoke(revoke_token, json=json)
        return
    settings = settings_of(context, "world", "rules", "model", "alarms", *OBSERVED)
    if options.agents:
        with naming_what_is_missing("mcp", "agents need"):
            import_module("pa_console.cli.sessions.agents")
    with naming_what_is_missing("serve"):
        if web:
            from pa_console.cli.sessions.web import serve_console  # noqa: PLC0415 - aiohttp

            code = serve_console(_console(context), port)
        else:
            from pa_console.cli.sessions.served import serve_session  # noqa: PLC0415 - FastAPI

            code = serve_session(options, settings, port)
    raise typer.Exit(code)


def _console(context: typer.Context) -> list[str]:
    """Return the command that opens the console with the options that were given to `context`.

    All paths are absolute, because the command runs in another folder.
    """
    words = [*python_command("-m", "pa_console")]
    words += [word for given in given_words(context) for word in ("--set", given)]
    words += ["console", "--new"]
    for name, value in context.params.items():
        source = context.get_parameter_source(name)
        whole = _whole(name, value)
        if name in OWN or source is None or (source.name != "COMMANDLINE" and whole == value):
            continue
        option = name.replace("_", "-")
        if value is True:
            words.append(f"--{option}")
        elif value is False:
            words += [f"--no-{option}"] if name in ("alarms", "tak_contacts") else []
        elif value not in (None, ""):
            words += [f"--{option}", str(whole)]
    return words


def _whole(name: str, value: Any) -> Any:
    """Return the `value` of the option `name`; a path is made absolute.

    World, rules, scenario and model may also be installed names, which remain unchanged.
    """
    if isinstance(value, Path):
        return value.expanduser().absolute()
    if name == "witness" and value:
        from pa_console.cli.sessions.log import witness_target  # noqa: PLC0415 - not needed for help

        return witness_target(value)
    if name in IN_FILES and value:
        path = Path(value).expanduser()
        if any((path / file).is_file() for file in IN_FILES[name]):
            return str(path.absolute())
    return value
