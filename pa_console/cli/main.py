"""The program `pa-console`; it reports a verb's failure in one line and with an exit code."""

import contextlib
import errno
import gc
import os
import sys
import tempfile
import traceback
from typing import Annotated, NoReturn

import typer

from pa_console import __version__
from pa_console.child_processes import keep_search_path
from pa_console.cli.verbs import Verbs, load_verb
from pa_console.terminal.output import BAD_INPUT, FAILED, errors, open_closed_streams

INTERRUPTED = 130
COLLECTED_AFTER = (20_000, 10, 5)
"""The thresholds of garbage collection.

With Python's default of 700 allocations, collections during the imports take a tenth of the start.
A console that runs for days still needs collections, because they remove closed screens.
"""

REMEDIES = {
    errno.ENOSPC: "; free some space on that disk",
    errno.EDQUOT: "; free some space on that disk",
    errno.EROFS: "; set XDG_STATE_HOME and XDG_CONFIG_HOME to writable folders",
}
"""The remedies for errors of the file system, which are the same in all verbs."""

app = typer.Typer(
    name="pa-console",
    cls=Verbs,
    help="Command a team of robots in plain language, safely, with a local LLM.",
    epilog="Exit codes: 0 success, 1 failure, 2 bad input, 3 refused, rejected, held or cancelled, "
    "4 executed but not verified, 5 question to answer, 130 interrupted.\n\n"
    "\b\nInstall shell completion: pa-console --install-completion\n"
    "Check this machine:       pa-console doctor\n\n"
    "\b\nExample:\n  pa-console --set theme=pa-console-light console --scenario situation-2",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.callback(invoke_without_command=True)
def _default(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Show the version and exit.")] = False,
    json: Annotated[
        bool,
        typer.Option("--json", help="With --version: print JSON that includes library versions."),
    ] = False,
    assignments: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="NAME=VALUE", help="Override a setting for this run. Repeatable."
        ),
    ] = None,
) -> None:
    """Open the console when no verb is given."""
    if version:
        _print_version(json)
        raise typer.Exit
    if json:
        raise ValueError("give --json together with --version, or after a verb")
    from pa_console.cli.settings_defaults import set_defaults  # noqa: PLC0415 - not needed for --version

    set_defaults(context, assignments or ())
    if context.invoked_subcommand is None:
        console = load_verb("console")
        with console.make_context("console", [], parent=context) as below:
            console.invoke(below)


def _print_version(json: bool) -> None:
    """Print the program's version; with `json`, also the other versions that a bug report needs."""
    if not json:
        typer.echo(f"pa-console {__version__}")
        return
    from importlib.metadata import version  # noqa: PLC0415 - only a report needs it
    from platform import platform, python_version  # noqa: PLC0415

    from pa_console.terminal.output import print_json  # noqa: PLC0415

    libraries = ("llama-cpp-python", "llguidance", "pydantic", "pymunk", "textual")
    print_json(
        {
            "pa-console": __version__,
            "python": python_version(),
            "platform": platform(),
            "libraries": {name: version(name) for name in libraries},
        }
    )


def main() -> None:
    """Run the command line of the console."""
    run(app, "pa-console")


def run(commands: typer.Typer, name: str) -> NoReturn:
    """Run `commands` as the program `name` and exit; the user never sees a traceback."""
    gc.set_threshold(*COLLECTED_AFTER)
    open_closed_streams()
    keep_search_path()
    try:
        code = commands(prog_name=name, standalone_mode=False)
        if code == INTERRUPTED:
            raise KeyboardInterrupt
    except (KeyboardInterrupt, typer.Abort):
        code = _fail("interrupted", INTERRUPTED)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = FAILED
    except Exception as error:
        code = _explain(error)
    sys.exit(code if isinstance(code, int) else 0)


def _explain(error: Exception) -> int:
    """Report an error in the input or an internal error; return the exit code."""
    from pa_console.llm.backend import EngineError, ModelError  # noqa: PLC0415 - only after a failure
    from pa_console.schema.document import DocumentError  # noqa: PLC0415

    match error:
        case typer.TyperException():
            return _misused(error)
        case DocumentError() | ModelError() | ValueError():
            return _fail(str(error), BAD_INPUT)
        case EngineError():
            return _fail(str(error), FAILED)
        case OSError():
            place = error.filename or "input/output"
            remedy = REMEDIES.get(error.errno or 0, "")
            return _fail(f"{place}: {error.strerror or error}{remedy}", FAILED)
        case _:
            return _fail(f"internal error: {error}; {_keep_traceback(error)}", FAILED)


def _misused(error: typer.TyperException) -> int:
    """Report an error in the command line, and how to show help; return the exit code.

    A group without a command shows its help instead.
    """
    context: typer.Context | None = getattr(error, "ctx", None)
    message = error.format_message()
    if context is not None and message == context.get_help():
        errors.print_line(message)
        return BAD_INPUT
    command = context.command_path if context is not None else "pa-console"
    problem = message.replace(": Value error, ", ": ").removesuffix(".")
    end = "" if problem.endswith("?") else "."
    return _fail(f"{problem}{end} See '{command} --help'.", BAD_INPUT)


def _fail(text: str, code: int) -> int:
    errors.print_line(f"error: {text}", style="bold red")
    return code


def _keep_traceback(error: Exception) -> str:
    """Write the traceback of `error` to a file; return a request to report it with that file."""
    with contextlib.suppress(OSError):
        handle, path = tempfile.mkstemp(prefix="pa-console-", suffix=".txt")
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write("".join(traceback.format_exception(error)))
        return f"please report it, and attach {path}"
    return "please report it"
