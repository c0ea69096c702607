"""Wires the verbs together and turns every failure into one clear line and an exit code."""

import contextlib
import os
import sys
import tempfile
import traceback
from typing import Annotated

import typer
from typer.core import TyperGroup

from pa_console import __version__
from pa_console.cli import (
    bench,
    console,
    doctor,
    evaluate,
    export,
    mission,
    models,
    replay,
    rules,
    scenarios,
    settings,
    train,
    world,
)
from pa_console.cli.chosen import choose
from pa_console.cli.examples import EXAMPLES, add_examples
from pa_console.cli.output import BAD_INPUT, FAILED, errors
from pa_console.llm.errors import EngineError, ModelError
from pa_console.schema.document import DocumentError
from pa_console.session.chain import LogError

INTERRUPTED = 130

app = typer.Typer(
    name="pa-console",
    help="Command a team of robots in plain language, safely, with a local LLM.",
    epilog="Exit codes: 0 done and verified, 2 bad input, 3 refused or rejected, "
    "4 executed but not verified, 1 anything else.\n\n"
    "\b\nCompletion in your shell: pa-console --install-completion\n"
    "What this machine lacks:  pa-console doctor\n\n"
    "\b\nExample:\n  pa-console --set theme=pa-console-light console --scenario situation-2",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("console")(console.console)
app.command("mission")(mission.mission)
app.command("replay")(replay.replay)
app.command("doctor")(doctor.doctor)
app.add_typer(export.app, name="export")
app.add_typer(rules.app, name="rules")
app.add_typer(models.app, name="models")
app.add_typer(evaluate.app, name="eval")
app.add_typer(bench.app, name="bench")
app.add_typer(scenarios.app, name="scenarios")
app.add_typer(world.app, name="world")
app.add_typer(train.app, name="train")
app.add_typer(settings.app, name="settings")
add_examples(app, EXAMPLES)


@app.callback(invoke_without_command=True)
def _default(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", help="Show the version and leave.", is_eager=True)
    ] = False,
    assignments: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="NAME=VALUE", help="A setting for this run only; repeatable."
        ),
    ] = None,
) -> None:
    """Open the console when no verb is given."""
    if version:
        typer.echo(f"pa-console {__version__}")
        raise typer.Exit
    choose(context, assignments or ())
    if context.invoked_subcommand is None:
        assert isinstance(context.command, TyperGroup)
        opened = context.command.commands["console"]
        with opened.make_context("console", [], parent=context) as below:
            opened.invoke(below)


def main() -> None:
    """Run the command line; never lets a traceback reach the user."""
    try:
        code = app(prog_name="pa-console", standalone_mode=False)
        if code == INTERRUPTED:
            raise KeyboardInterrupt
    except (DocumentError, ModelError, LogError, ValueError) as error:
        code = _fail(str(error), BAD_INPUT)
    except EngineError as error:
        code = _fail(str(error), FAILED)
    except typer.TyperException as error:
        code = _fail(f"{error.format_message()} See pa-console --help.", BAD_INPUT)
    except (KeyboardInterrupt, typer.Abort):
        code = _fail("interrupted", INTERRUPTED)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = FAILED
    except OSError as error:
        code = _fail(f"{error.filename or 'input/output'}: {error.strerror or error}", FAILED)
    except Exception as error:
        code = _fail(f"internal error: {error}; {_keep_traceback()}", FAILED)
    sys.exit(code if isinstance(code, int) else 0)


def _fail(text: str, code: int) -> int:
    errors.print(f"error: {text}", style="bold red", markup=False, highlight=False, soft_wrap=True)
    return code


def _keep_traceback() -> str:
    """Write the traceback to a file for a bug report and say where it is."""
    with contextlib.suppress(OSError):
        handle, path = tempfile.mkstemp(prefix="pa-console-", suffix=".txt")
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(traceback.format_exc())
        return f"please report it with {path}"
    return "please report it"
