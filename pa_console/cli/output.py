"""What every verb shares: streams, the two consoles, JSON output, exit codes, common options."""

import json
import os
import sys
from pathlib import Path
from typing import IO, TYPE_CHECKING, Annotated, Any

import typer

from pa_console.schema.text import visible, visible_json
from pa_console.tui.plain_output import PlainConsole

if TYPE_CHECKING:
    from pa_console.schema.rule import RulesSeal


DRIVER = "TEXTUAL_DRIVER"
"""The variable with the name of another driver than a terminal's, such as that of a browser."""


def open_closed_streams() -> None:
    """Let every standard stream that was closed read nothing, or lead nowhere.

    Otherwise the next file that is opened becomes standard input or output, and whoever reads or
    writes there meets it.
    """
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        if getattr(sys, name) is None:
            stream = _open_on_nothing(number, mode)
            setattr(sys, name, stream)
            setattr(sys, f"__{name}__", stream)


def require_keys(instead: str) -> None:
    """Raise ValueError, with what to do instead, where no key of an operator can arrive.

    Textual's own drivers, such as that of a browser, bring keys without a terminal.
    """
    if DRIVER not in os.environ and not sys.stdin.isatty():
        raise ValueError(f"standard input is no terminal, no key would arrive; {instead}")


def _open_on_nothing(number: int, mode: str) -> IO[Any]:
    """Return a stream on the null device: as descriptor `number`, unless a file is there by now."""
    opened = os.open(os.devnull, os.O_RDONLY if mode == "r" else os.O_WRONLY)
    os.set_inheritable(opened, opened == number)
    return os.fdopen(opened, mode, encoding="utf-8", closefd=False)


FAILED = 1
BAD_INPUT = 2

out = PlainConsole()
errors = PlainConsole(stderr=True)

WorldOption = Annotated[
    str, typer.Option("--world", help="A world: an installed name, a folder or a file.")
]
RulesOption = Annotated[
    str, typer.Option("--rules", help="A rule file: an installed name or path.")
]
UnsignedOption = Annotated[
    bool,
    typer.Option(
        "--unsigned", help="Take rules that were altered since they were signed; the log says so."
    ),
]
AcceptRulesOption = Annotated[
    bool,
    typer.Option(
        "--accept-rules",
        help="Take rules that are less than those used before (not signed, signed by another, "
        "of a lower version); log and reports say so.",
    ),
]
ModelOption = Annotated[
    str | None,
    typer.Option(
        "--model",
        help="A model of the catalogue, the path of a GGUF file, or, in console and mission, a "
        "model on a server: openai:BASE_URL#NAME.",
    ),
]
ScenarioOption = Annotated[
    str | None,
    typer.Option("--scenario", help="A situation to play; see 'pa-console scenarios list'."),
]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Seed of the simulation.")]
FleetOption = Annotated[
    str,
    typer.Option(
        "--fleet",
        metavar="URL",
        help="Drive the robots of a site on a message bus: mqtts://host:8883/site.",
    ),
]
CertificatesOption = Annotated[
    Path | None,
    typer.Option("--certificates", help="The folder of 'pa-console site init', to be let in with."),
]
WitnessOption = Annotated[
    str,
    typer.Option(
        "--witness",
        metavar="FILE|URL",
        help="Give the log's signed heads to a file on another disk, or to a web address.",
    ),
]
MetricsPortOption = Annotated[
    int,
    typer.Option(
        "--metrics-port",
        min=0,
        max=65_535,
        help="Give metrics as Prometheus text at this port of this machine; 0 for none.",
    ),
]
TracesOption = Annotated[
    str,
    typer.Option(
        "--traces",
        metavar="URL",
        help="Give every mission as a trace to this OpenTelemetry collector (OTLP over HTTP).",
    ),
]
TakOption = Annotated[
    str,
    typer.Option(
        "--tak",
        metavar="URL",
        help="Show the session on the maps of this TAK server: tls://HOST:8089.",
    ),
]
TakOriginOption = Annotated[
    str,
    typer.Option(
        "--tak-origin",
        metavar="LAT,LON[,BEARING[,ALTITUDE]]",
        help="Where on the earth the world's (0, 0) is, in place of what the world file says.",
    ),
]
TakContactsOption = Annotated[
    bool | None,
    typer.Option(
        "--tak-contacts/--no-tak-contacts",
        help="Show what others on the TAK server report, as unverified contacts, or not; shown by "
        "default where the server is reached over TLS, or is on this machine.",
    ),
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print one JSON document on stdout and nothing else there.")
]


def warn_of_altered(rules: str, seal: "RulesSeal") -> None:
    """Report on stderr the warnings about the rules in force."""
    altered = (f"{seal.words}: {seal.problem}",) if seal.altered else ()
    for warning in (*altered, *seal.warnings):
        errors.print(
            f"warning: the rules {rules!r}: {warning}",
            style="bold red",
            markup=False,
            soft_wrap=True,
        )


def print_json(value: Any) -> None:
    """Print `value`, dataclasses and pydantic models included, as one indented JSON document."""
    from pydantic import TypeAdapter  # noqa: PLC0415 - only when it is asked for

    plain = TypeAdapter(Any).dump_python(value, mode="json")
    sys.stdout.write(visible_json(json.dumps(plain, indent=2, ensure_ascii=False)) + "\n")


def print_document(text: str) -> None:
    """Print a text that has its own lines, such as Markdown, and nothing after it."""
    sys.stdout.write(visible(text))
