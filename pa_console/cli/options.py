"""The options that several verbs share, with their help; a session's options form a dataclass."""

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
        help="World to use: an installed name, a folder or a file.",
        autocompletion=completion.worlds,
    ),
]
RulesOption = Annotated[
    str,
    typer.Option(
        "--rules",
        help="Rules to use: an installed name or a file.",
        autocompletion=completion.rule_files,
    ),
]
UnsignedOption = Annotated[
    bool,
    typer.Option(
        "--unsigned", help="Accept rules that were changed after signing; the log records this."
    ),
]
ModelOption = Annotated[
    str | None,
    typer.Option(
        "--model",
        help="Model to use: a name from the catalogue or a GGUF file. The verbs console and "
        "mission also accept a model on a server: openai:BASE_URL#NAME.",
        autocompletion=completion.models,
    ),
]
ScenarioOption = Annotated[
    str | None,
    typer.Option(
        "--scenario",
        help="Situation to play; 'pa-console scenarios list' shows them.",
        autocompletion=completion.scenarios,
    ),
]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Seed of the simulation.")]
FleetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--fleet",
        metavar="URL",
        help="Command robots on a message bus (mqtts://host:8883/site) or over a link "
        "(ros2:ADDRESS, mavlink:ADDRESS). Repeat the option for a mixed team.",
    ),
]
CertificatesOption = Annotated[
    Path | None,
    typer.Option(
        "--certificates", help="Folder of certificates for the bus, from 'pa-console site init'."
    ),
]
AlertOption = Annotated[
    list[str] | None,
    typer.Option(
        "--alert",
        metavar="URL",
        envvar="PA_CONSOLE_ALERT",
        help="Send alerts to this Apprise address (mail, chat or push). Repeatable. Prefer the "
        "environment variable, because other users can see command lines.",
    ),
]
AlertLaterOption = Annotated[
    list[str] | None,
    typer.Option(
        "--alert-later",
        metavar="URL",
        envvar="PA_CONSOLE_ALERT_LATER",
        help="Also send alerts to this address if nobody acts. Repeatable.",
    ),
]
OriginOption = Annotated[
    str,
    typer.Option(
        metavar="LAT,LON[,BEARING[,ALTITUDE]]",
        help="Geographic position of the world's (0, 0); overrides the world file.",
    ),
]
MouseOption = Annotated[
    bool, typer.Option("--mouse/--no-mouse", help="Use the mouse, or leave it to the terminal.")
]
SessionWorldOption = Annotated[
    str | None,
    typer.Option("--world", help="World file of the session, if its world is not installed."),
]
SessionRulesOption = Annotated[
    str | None,
    typer.Option("--rules", help="Rule file of the session, if its rules are not installed."),
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print the result as one JSON document on stdout.")
]
WorkersOption = Annotated[
    int, typer.Option(min=0, help="Distribute the work over this many local processes (Dask).")
]
SchedulerOption = Annotated[
    str, typer.Option(help="Distribute the work over this Dask scheduler: tcp://HOST:PORT.")
]


def one_of(**given: bool) -> None:
    """Raise ValueError if more than one of the options in `given` is True."""
    if sum(given.values()) > 1:
        names = [f"--{name}" for name in given]
        raise ValueError(f"give only one of {', '.join(names[:-1])} and {names[-1]}")


@dataclass(frozen=True)
class SessionOptions:
    """The options of every verb that opens a session; subclasses add those of single verbs."""

    world: WorldOption = "checkpoint"
    rules: RulesOption = "checkpoint"
    model: ModelOption = None
    scenario: ScenarioOption = None
    seed: SeedOption = 0
    fleet: FleetOption = None
    certificates: CertificatesOption = None
    alarms: Annotated[
        bool | None,
        typer.Option("--alarms/--no-alarms", help="Queue a mission for each alarm automatically."),
    ] = True
    """None means that alarms become missions only in a scenario."""
    witness: Annotated[
        str,
        typer.Option(
            metavar="FILE|URL",
            help="Send the log's signed heads to a file on another disk or to a web address.",
        ),
    ] = ""
    traces: Annotated[
        str,
        typer.Option(
            metavar="URL",
            help="Send a trace of every mission to this OpenTelemetry collector (OTLP over HTTP).",
        ),
    ] = ""
    metrics_port: Annotated[
        int,
        typer.Option(
            min=0,
            max=65_535,
            help="Serve Prometheus metrics on this local port; 0 disables them.",
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
            help="Show reports from others on the TAK server as unverified contacts. Default: only "
            "if the server uses TLS or is on this machine.",
        ),
    ] = None
    unsigned: UnsignedOption = False
    accept_rules: Annotated[
        bool,
        typer.Option(
            "--accept-rules",
            help="Accept rules that are less trusted than those used before: unsigned, signed with "
            "another key, or of a lower version. The log and reports record this.",
        ),
    ] = False
    require_sandbox: Annotated[
        bool,
        typer.Option(
            "--require-sandbox",
            help="Refuse to start if the system cannot confine the model's process.",
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
            help="Let agents propose missions over MCP on this local port; 0 disables it.",
        ),
    ] = 0


@dataclass(frozen=True)
class FollowOptions:
    """The options of a map that follows a session; either `join` or `replay` is given."""

    server: Annotated[
        str,
        typer.Option(metavar="URL", help="TAK server: tls://HOST:8089 or tcp://HOST:8087."),
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
            help="Replay a recorded session: a log file, a session id or 'last'. The map marks it "
            "as a replay.",
        ),
    ] = ""
    speed: Annotated[
        float, typer.Option(min=0.1, max=32.0, help="With --replay: the speed factor.")
    ] = 1.0
    world: SessionWorldOption = None
    origin: OriginOption = ""
    name: Annotated[
        str | None,
        typer.Option(help="Name of this site in the ids on the map. Default: the world's name."),
    ] = None
    every: Annotated[
        float, typer.Option(min=0.1, max=60.0, help="Least number of seconds between two updates.")
    ] = 1.0
    tls_cert: Annotated[
        Path | None, typer.Option(help="Client certificate: PEM or PKCS #12 (.p12).")
    ] = None
    tls_key: Annotated[
        Path | None, typer.Option(help="Key of that certificate (PEM), if it is in another file.")
    ] = None
    tls_ca: Annotated[
        Path | None, typer.Option(help="Certificate authority of the server (PEM).")
    ] = None


def with_field_options(verb: Callable[..., Any]) -> Callable[..., Any]:
    """Return `verb` with an option for each `Annotated` field of its dataclass parameters.

    Typer supports only individual options, so the returned function collects them and calls `verb`
    with instances of the dataclasses.
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
