"""The schema of all settings; the file, the settings screen and the help are based on it."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import urlsplit

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from pa_console.schema.base import AlarmPriority

ENV_PREFIX = "PA_CONSOLE_"


def _whole(path: Path) -> Path:
    """Return `path` with `~` expanded.

    Raises ValueError for a relative path, because its meaning would depend on the working folder.
    """
    path = path.expanduser()
    if not path.is_absolute():
        raise ValueError("give an absolute path, or one that begins with ~")
    return path


def _witness(target: str) -> str:
    """Return the address or the file of a witness, with `~` expanded; raises ValueError."""
    if not target or target.startswith(("http://", "https://")):
        return target
    if "://" in target:
        raise ValueError("give a file, or an address with http:// or https://")
    return str(_whole(Path(target)))


def _collector(address: str) -> str:
    """Return the address of a collector; raises ValueError if it is not valid."""
    if address and not (address.startswith(("http://", "https://")) and urlsplit(address).netloc):
        raise ValueError("give an address with http:// or https://, such as http://127.0.0.1:4318")
    return address


def _tak_server(address: str) -> str:
    """Return the address of a TAK server; raises ValueError if it is not valid."""
    if address and not (address.startswith(("tcp://", "tls://")) and urlsplit(address).netloc):
        raise ValueError("give an address with tls:// or tcp://, such as tls://tak.example:8089")
    return address


WholePath = Annotated[Path, AfterValidator(_whole)]
WitnessTarget = Annotated[str, AfterValidator(_witness)]
CollectorAddress = Annotated[str, AfterValidator(_collector)]
TakAddress = Annotated[str, AfterValidator(_tak_server)]


KEYS_FORM = (
    "`keys: {stop: f11}` in the file, `--set keys.stop=f11` on the command line, "
    """`PA_CONSOLE_KEYS='{"stop": "f11"}'` in the environment"""
)


def _shown(group: str, title: str, *, restart: bool = True, form: str = "", **limits: Any) -> Any:
    """Return a field's properties for the screen; the string that follows them is the field's help.

    `restart` is True if a change takes effect only after a restart. `form` shows the form of a
    value that is more than one word or number. `limits` are passed to pydantic's Field.
    """
    extra: dict[str, Any] = {"group": group, "restart": restart, "form": form}
    return Field(title=title, json_schema_extra=extra, **limits)


class Settings(BaseModel):
    """The settings in force; the module `sources` merges them and keeps the origin of each."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    model: Annotated[
        str,
        _shown("Session", "Model"),
        "The model that plans and judges: a name in the catalogue, or the path of a GGUF file. "
        "Empty means the catalogue's default. With a model on a server, openai:BASE_URL#NAME, the "
        "server plans; the default model judges, and replaces an unreachable server.",
    ] = ""
    second_reader: Annotated[
        str,
        _shown("Session", "Second reader"),
        "The model, here or on a server, that reads an order again if the first model is unsure. "
        "Empty means the first model's companion, if it is downloaded; off means none.",
    ] = ""
    judge_server: Annotated[
        str,
        _shown("Session", "Judge's server"),
        "A model on a server that judges, openai:BASE_URL#NAME. If empty, the local model judges.",
    ] = ""
    server_patience_s: Annotated[
        float,
        _shown("Session", "Patience with a server", ge=1.0, le=50.0),
        "Seconds to wait for a model on a server before the local model takes over.",
    ] = 20.0
    plain_servers: Annotated[
        bool,
        _shown("Session", "Unencrypted servers"),
        "Whether orders and the picture may be sent to a server on another machine without https.",
    ] = False
    require_sandbox: Annotated[
        bool,
        _shown("Session", "Confined model only"),
        "Whether to refuse a session on a system that cannot confine the model's process; "
        "`doctor` tests whether it can.",
    ] = False
    live_reading: Annotated[
        bool,
        _shown("Session", "Live reading", restart=False),
        "Whether an order is read while you type it, and its reading shown under the mission "
        "field. Nothing is sent or logged before Enter.",
    ] = True
    world: Annotated[
        str,
        _shown("Session", "World", min_length=1),
        "The world that the console opens: an installed name, a folder or a file.",
    ] = "checkpoint"
    rules: Annotated[
        str,
        _shown("Session", "Rules", min_length=1),
        "The rule set in force: an installed name, or the path of a file.",
    ] = "checkpoint"
    speed: Annotated[
        float,
        _shown("Session", "Speed", ge=1.0, le=8.0),
        "Simulated seconds per second when the console opens.",
    ] = 1.0
    alarms: Annotated[
        bool,
        _shown("Approval and alarms", "Alarms become missions"),
        "Whether an alarm queues a mission by itself. Every plan still waits for you.",
    ] = True
    approval_delay_s: Annotated[
        float,
        _shown("Approval and alarms", "Approval hold delay", restart=False, ge=0.2, le=10.0),
        "Quiet seconds before the approval panel takes a key, so that no stray key approves a "
        "plan.",
    ] = 0.6
    alert_from: Annotated[
        AlarmPriority,
        _shown("Approval and alarms", "Alert from", form="emergency, high, medium or low"),
        "The lowest priority of alarms that `--alert` sends at once.",
    ] = "high"
    alert_after_min: Annotated[
        float,
        _shown("Approval and alarms", "Alert again after", ge=0.0, le=240.0),
        "Minutes without a response after which an alarm or a waiting plan is sent again, also to "
        "`--alert-later`; the interval then doubles each time. 0 means never.",
    ] = 5.0
    check_deadline_ms: Annotated[
        float,
        _shown("Approval and alarms", "Deadline of a check", ge=1.0, le=1000.0),
        "Milliseconds of processor time for one check of a rule. A slower check gives no result, "
        "which blocks the plan.",
    ] = 10.0
    standing_confidence: Annotated[
        float,
        _shown("Approval and alarms", "Standing instruction needs", restart=False, ge=0.0, le=1.0),
        "The confidence, 0 to 1, that `--approve auto` needs to approve a plan. An order whose "
        "reading ignores some of its words is never approved automatically.",
    ] = 0.9
    moment_grace_s: Annotated[
        float,
        _shown("Approval and alarms", "A timed order may be late", ge=1.0, le=3600.0),
        "Seconds by which a timed order may start late. If it would be later, for example because "
        "the machine slept, it does not start, and an event reports this.",
    ] = 60.0
    shortest_interval_s: Annotated[
        float,
        _shown("Approval and alarms", "Shortest interval", ge=1.0, le=3600.0),
        "The shortest interval of a repeated order, in seconds.",
    ] = 60.0
    patrol_stay_s: Annotated[
        float,
        _shown("Approval and alarms", "Stay at each place of a patrol", ge=0.0, le=3600.0),
        "Seconds that an asset stays at each place of a patrol, unless the order gives a time.",
    ] = 10.0
    patrol_laps: Annotated[
        int,
        _shown("Approval and alarms", "Most laps of a patrol", ge=1, le=50),
        "The most laps of a patrol. For more laps, or a patrol without an end, the console asks.",
    ] = 10
    stale_after_s: Annotated[
        float,
        _shown("Approval and alarms", "Telemetry is stale after", restart=False, ge=2.0, le=120.0),
        "Seconds without telemetry after which the top line warns.",
    ] = 5.0
    bell: Annotated[
        bool,
        _shown("Screen", "Bell", restart=False),
        "Whether the terminal's bell rings when a plan or an urgent alarm needs you.",
    ] = True
    desktop_notices: Annotated[
        bool,
        _shown("Screen", "Desktop notices", restart=False),
        "Whether the terminal also shows a desktop notice (OSC 9 and OSC 777).",
    ] = True
    window_title: Annotated[
        bool,
        _shown("Screen", "Window title", restart=False),
        "Whether the title of the terminal's window shows the plan or alarm that needs you.",
    ] = True
    theme: Annotated[
        str,
        _shown("Screen", "Theme", restart=False, min_length=1),
        "The colours of the console.",
    ] = "pa-console"
    mouse: Annotated[
        bool,
        _shown("Screen", "Mouse"),
        "Whether the console uses the mouse; off leaves it to the terminal, to select text.",
    ] = True
    history_kept: Annotated[
        int,
        _shown("Screen", "Missions remembered", ge=0, le=10_000),
        "The number of typed missions that the arrow keys recall in the mission field.",
    ] = 200
    logs: Annotated[
        WholePath | None,
        _shown("Files", "Session logs"),
        "The folder for session logs. Empty means the user's state folder.",
    ] = None
    cache: Annotated[
        WholePath | None,
        _shown("Files", "Models and cache"),
        "The folder for downloaded models and other cached files. Empty means the user's cache "
        "folder.",
    ] = None
    signing_key: Annotated[
        WholePath | None,
        _shown("Files", "Signing key"),
        "The file of the key that signs session logs; it is made on first use. Empty means a file "
        "in the user's config folder.",
    ] = None
    witness: Annotated[
        WitnessTarget,
        _shown("Files", "Witness of session logs"),
        "A file on another disk, or an address with http:// or https://, that receives the signed "
        "heads of the session log every 10 s and at every decision. Empty means none.",
    ] = ""
    traces: Annotated[
        CollectorAddress,
        _shown("Observability", "Traces"),
        "The address of an OpenTelemetry collector, such as http://127.0.0.1:4318, that receives "
        "every mission as a trace. Empty means none.",
    ] = ""
    trace_words: Annotated[
        bool,
        _shown("Observability", "Words in traces"),
        "Whether traces include the texts of operators and models, and who decided.",
    ] = False
    metrics_port: Annotated[
        int,
        _shown("Observability", "Port of metrics", ge=0, le=65_535),
        "The local port on which a session serves its metrics as Prometheus text. 0 means none.",
    ] = 0
    tak: Annotated[
        TakAddress,
        _shown("TAK maps", "TAK server"),
        "The TAK server that shows every session, such as tls://tak.example:8089. Empty means "
        "none.",
    ] = ""
    tak_origin: Annotated[
        str,
        _shown("TAK maps", "Origin on the earth"),
        "The position of a world's point (0, 0): LATITUDE,LONGITUDE[,BEARING[,ALTITUDE]]. Empty "
        "means the origin in the world's file.",
    ] = ""
    tak_contacts: Annotated[
        bool | None,
        _shown("TAK maps", "Contacts from TAK", form="on or off"),
        "Whether reports by others on the TAK server are shown as unverified contacts. Empty means "
        "only if the server is reached over TLS or is on this machine.",
    ] = None
    tak_certificate: Annotated[
        WholePath | None,
        _shown("TAK maps", "Certificate for TAK"),
        "The client certificate for a TAK server: PEM, or PKCS #12 (.p12).",
    ] = None
    tak_key: Annotated[
        WholePath | None,
        _shown("TAK maps", "Key for TAK"),
        "The key of the client certificate (PEM). Empty means that it is in the same file.",
    ] = None
    tak_authority: Annotated[
        WholePath | None,
        _shown("TAK maps", "Authority for TAK"),
        "The certificate (PEM) of the authority that signed the TAK server's certificate.",
    ] = None
    keys: Annotated[
        dict[str, str],
        _shown("Keys", "Keys", restart=False, form=KEYS_FORM),
        "Other keys for the console's actions: an action's name and its keys, separated by commas.",
    ] = {}


@dataclass(frozen=True)
class Setting:
    """The description of one setting; `limits` is empty if every value of the type is valid."""

    name: str
    title: str
    help: str
    group: str
    restart: bool
    default: object
    limits: str
    boolean: bool

    @property
    def variable(self) -> str:
        """The environment variable of the setting."""
        return f"{ENV_PREFIX}{self.name.upper()}"


@cache
def describe_settings() -> Mapping[str, Setting]:
    """Return the descriptions of all settings by name, in the order of the schema."""
    properties: Mapping[str, Mapping[str, Any]] = Settings.model_json_schema()["properties"]
    return {
        name: Setting(
            name,
            about["title"],
            next(text for text in Settings.model_fields[name].metadata if isinstance(text, str)),
            about["group"],
            about["restart"],
            Settings.model_fields[name].default,
            _limits(about),
            about.get("type") == "boolean",
        )
        for name, about in properties.items()
    }


def _limits(about: Mapping[str, Any]) -> str:
    match about:
        case {"type": "boolean"}:
            return "on or off"
        case {"minimum": least, "maximum": most, "type": kind}:
            return f"a {'whole ' if kind == 'integer' else ''}number from {least:g} to {most:g}"
        case _:
            return about["form"]


def value_text(value: object) -> str:
    """Return a value as a user types it; '' for None."""
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, float):
        return f"{value:g}"
    return "" if value is None else str(value)
