"""Options that several verbs share, and their help."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pa_console.cli import completion

if TYPE_CHECKING:
    from pa_console.evaluation.dask_sweep import Workers


WorldOption = Annotated[
    str,
    typer.Option(
        "--world",
        help="A world: an installed name, a folder or a file.",
        autocompletion=completion.worlds,
    ),
]
RulesOption = Annotated[
    str,
    typer.Option(
        "--rules",
        help="A rule file: an installed name or path.",
        autocompletion=completion.rule_files,
    ),
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
        autocompletion=completion.models,
    ),
]
ScenarioOption = Annotated[
    str | None,
    typer.Option(
        "--scenario",
        help="A situation to play; see 'pa-console scenarios list'.",
        autocompletion=completion.scenarios,
    ),
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


WorkersOption = Annotated[
    int, typer.Option(min=0, help="Make them in so many processes of this machine (Dask).")
]
SchedulerOption = Annotated[
    str, typer.Option(help="Make them on the workers of this Dask scheduler: tcp://HOST:PORT.")
]


def one_of(**given: bool) -> None:
    """Raise ValueError where more than one of these options was given."""
    if sum(given.values()) > 1:
        names = [f"--{name}" for name in given]
        raise ValueError(f"give one of {', '.join(names[:-1])} and {names[-1]}")


def dask_workers(where: int | str) -> "Workers":
    """Return that many processes of this machine, or the workers of the scheduler at that address.

    Raises ValueError without Dask.
    """
    try:
        from pa_console.evaluation.dask_sweep import Workers  # noqa: PLC0415
    except ImportError as error:
        raise ValueError("a sweep needs Dask: pip install 'pa-console[sweep]'") from error
    return Workers(count=where) if isinstance(where, int) else Workers(scheduler=where)
