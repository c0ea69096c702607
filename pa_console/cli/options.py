"""The options that several verbs share, with their help; the options of a session are one value."""

from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import wraps
from inspect import Parameter, signature
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from pa_console.cli import completion

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
    list[str] | None,
    typer.Option(
        "--fleet",
        metavar="URL",
        help="Drive robots: on a message bus (mqtts://host:8883/site), or over a link "
        "(ros2:ADDRESS, mavlink:ADDRESS). Repeat it for a mixed team.",
    ),
]
CertificatesOption = Annotated[
    Path | None,
    typer.Option("--certificates", help="The folder of 'pa-console site init', to be let in with."),
]
AlertOption = Annotated[
    list[str] | None,
    typer.Option(
        "--alert",
        metavar="URL",
        envvar="PA_CONSOLE_ALERT",
        help="Alert people by mail, chat or push: an address of Apprise; repeatable. Better set "
        "where no list of processes shows it.",
    ),
]
AlertLaterOption = Annotated[
    list[str] | None,
    typer.Option(
        "--alert-later",
        metavar="URL",
        envvar="PA_CONSOLE_ALERT_LATER",
        help="Alert these people too when nobody acts.",
    ),
]
OriginOption = Annotated[
    str,
    typer.Option(
        metavar="LAT,LON[,BEARING[,ALTITUDE]]",
        help="Where on the earth the world's (0, 0) is, in place of what the world file says.",
    ),
]
MouseOption = Annotated[
    bool, typer.Option("--mouse/--no-mouse", help="Take the mouse, or leave it to the terminal.")
]
SessionWorldOption = Annotated[
    str | None, typer.Option("--world", help="The session's world, when it is a file.")
]
SessionRulesOption = Annotated[
    str | None, typer.Option("--rules", help="The session's rules, when they are a file.")
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
    """Raise ValueError if more than one of these options was given."""
    if sum(given.values()) > 1:
        names = [f"--{name}" for name in given]
        raise ValueError(f"give one of {', '.join(names[:-1])} and {names[-1]}")


@dataclass(frozen=True)
class SessionOptions:
    """The options of every verb that opens a session; subclasses add options of a verb."""

    world: WorldOption = "checkpoint"
    rules: RulesOption = "checkpoint"
    model: ModelOption = None
    scenario: ScenarioOption = None
    seed: SeedOption = 0
    fleet: FleetOption = None
    certificates: CertificatesOption = None
    alarms: Annotated[
        bool | None,
        typer.Option("--alarms/--no-alarms", help="Alarms become missions by themselves."),
    ] = True
    """None means that alarms become missions only in a scenario."""
    witness: Annotated[
        str,
        typer.Option(
            metavar="FILE|URL",
            help="Give the log's signed heads to a file on another disk, or to a web address.",
        ),
    ] = ""
    traces: Annotated[
        str,
        typer.Option(
            metavar="URL",
            help="Give every mission as a trace to this OpenTelemetry collector (OTLP over HTTP).",
        ),
    ] = ""
    metrics_port: Annotated[
        int,
        typer.Option(
            min=0,
            max=65_535,
            help="Give metrics as Prometheus text at this port of this machine; 0 for none.",
        ),
    ] = 0
    tak: Annotated[
        str,
        typer.Option(
            metavar="URL", help="Show the session on the maps of this TAK server: tls://HOST:8089."
        ),
    ] = ""
    tak_origin: OriginOption = ""
    tak_contacts: Annotated[
        bool | None,
        typer.Option(
            "--tak-contacts/--no-tak-contacts",
            help="Show what others on the TAK server report, as unverified contacts, or not; shown "
            "by default where the server is reached over TLS, or is on this machine.",
        ),
    ] = None
    unsigned: UnsignedOption = False
    accept_rules: Annotated[
        bool,
        typer.Option(
            "--accept-rules",
            help="Take rules that are less than those used before (not signed, signed by another, "
            "of a lower version); log and reports say so.",
        ),
    ] = False
    require_sandbox: Annotated[
        bool,
        typer.Option(
            "--require-sandbox",
            help="Refuse to start where the system does not confine the model's process.",
        ),
    ] = False
    alert: list[str] | None = None
    """The addresses for alerts; addresses in `alert_later` get only reminders."""
    alert_later: list[str] | None = None
    agents: int = 0
    """The port for agents; 0 for none."""
    readonly: bool = False
    resume: bool | None = False
    """True to continue a session that was not closed; None to ask the operator."""
    log: Path | None = None
    """The file of the log; by default, a new file in the folder of logs."""
    stepped: bool = False
    """True for a script: the simulation waits for the mission, and no questions are asked first."""


@dataclass(frozen=True)
class AttendedOptions(SessionOptions):
    """The options of a session with an operator, which can alert people and admit agents."""

    alert: AlertOption = None
    alert_later: AlertLaterOption = None
    agents: Annotated[
        int,
        typer.Option(
            metavar="PORT",
            min=0,
            max=65_535,
            help="Let agents propose missions over MCP at this port of this machine; 0 for none.",
        ),
    ] = 0


@dataclass(frozen=True)
class FollowOptions:
    """The options of a map that follows a session; either `join` or `replay` is given."""

    server: Annotated[
        str,
        typer.Option(metavar="URL", help="The TAK server: tls://HOST:8089, or tcp://HOST:8087."),
    ]
    join: Annotated[
        str,
        typer.Option(
            metavar="URL",
            help="Follow the session that a station shares on a message bus: "
            "mqtts://host:8883/site.",
        ),
    ] = ""
    certificates: CertificatesOption = None
    replay: Annotated[
        str,
        typer.Option(
            metavar="SESSION",
            help="Play a recorded session: its log, its id, or 'last'; marked as a replay.",
        ),
    ] = ""
    speed: Annotated[
        float, typer.Option(min=0.1, max=32.0, help="With --replay: how many times as fast.")
    ] = 1.0
    world: SessionWorldOption = None
    origin: OriginOption = ""
    name: Annotated[
        str | None,
        typer.Option(
            help="What this site is called in the ids on the map; default: the world's name."
        ),
    ] = None
    every: Annotated[
        float, typer.Option(min=0.1, max=60.0, help="Seconds between two pictures, at least.")
    ] = 1.0
    tls_cert: Annotated[
        Path | None, typer.Option(help="The client's certificate: PEM, or PKCS #12 (.p12).")
    ] = None
    tls_key: Annotated[
        Path | None, typer.Option(help="Its key (PEM), when it is not in that file.")
    ] = None
    tls_ca: Annotated[
        Path | None, typer.Option(help="The authority (PEM) that vouches for the server.")
    ] = None


def with_field_options(verb: Callable[..., Any]) -> Callable[..., Any]:
    """Return `verb` with an option for each `Annotated` field of its dataclass parameters.

    Typer supports only single options. The result collects them, and calls `verb` with instances of
    the dataclasses.
    """
    hints = get_type_hints(verb, include_extras=True)
    groups = {name: _field_options(kind) for name, kind in hints.items() if is_dataclass(kind)}

    @wraps(verb)
    def called(**given: Any) -> Any:
        for name, options in groups.items():
            given[name] = hints[name](**{option.name: given.pop(option.name) for option in options})
        return verb(**given)

    parameters = [
        option.replace(kind=Parameter.KEYWORD_ONLY)
        for parameter in signature(verb).parameters.values()
        for option in groups.get(parameter.name, [parameter])
    ]
    vars(called)["__signature__"] = signature(verb).replace(parameters=parameters)
    called.__annotations__ = {option.name: option.annotation for option in parameters}
    return called


def _field_options(kind: Any) -> list[Parameter]:
    hints = get_type_hints(kind, include_extras=True)
    return [
        Parameter(
            field.name,
            Parameter.KEYWORD_ONLY,
            default=Parameter.empty if field.default is MISSING else field.default,
            annotation=hints[field.name],
        )
        for field in fields(kind)
        if hasattr(hints[field.name], "__metadata__")
    ]
