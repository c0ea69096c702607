"""The schema of all settings, from which file, screen and help are made."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import urlsplit

from pydantic import AfterValidator, Field
from pydantic_settings import BaseSettings, PydanticBaseSettingsSource, SettingsConfigDict

ENV_PREFIX = "PA_CONSOLE_"


def _whole(path: Path) -> Path:
    """Return `path` with `~` resolved; a relative path would depend on the working folder."""
    path = path.expanduser()
    if not path.is_absolute():
        raise ValueError("give the whole path, or one that begins with ~")
    return path


def _witness(target: str) -> str:
    """Return the file or the address of a witness, `~` resolved."""
    if not target or target.startswith(("http://", "https://")):
        return target
    if "://" in target:
        raise ValueError("give a file, or an address with http:// or https://")
    return str(_whole(Path(target)))


def _collector(address: str) -> str:
    """Return the address of a collector."""
    if address and not (address.startswith(("http://", "https://")) and urlsplit(address).netloc):
        raise ValueError("give an address with http:// or https://, such as http://127.0.0.1:4318")
    return address


def _tak_server(address: str) -> str:
    """Return the address of a TAK server."""
    if address and not (address.startswith(("tcp://", "tls://")) and urlsplit(address).netloc):
        raise ValueError("give an address with tls:// or tcp://, such as tls://tak.example:8089")
    return address


WholePath = Annotated[Path, AfterValidator(_whole)]
WitnessTarget = Annotated[str, AfterValidator(_witness)]
CollectorAddress = Annotated[str, AfterValidator(_collector)]
TakAddress = Annotated[str, AfterValidator(_tak_server)]


def _about(group: str, *, restart: bool = True, form: str = "") -> dict[str, Any]:
    """Return a field's further properties: its group, and True if a change needs a restart.

    `form` shows the form of a value that is more than one word or number.
    """
    return {"group": group, "restart": restart, "form": form}


class Settings(BaseSettings):
    """The settings in force; `sources` merges their origins, so that each can be named."""

    model_config = SettingsConfigDict(
        env_prefix=ENV_PREFIX, env_ignore_empty=True, extra="forbid", frozen=True
    )

    model: str = Field(
        default="",
        title="Model",
        description="The model that plans and judges: a name of the catalogue, or the path of a "
        "GGUF file. Empty is the catalogue's default. A model on a server plans, "
        "openai:BASE_URL#NAME; the default judges, and takes over when the server does not answer.",
        json_schema_extra=_about("Session"),
    )
    second_reader: str = Field(
        default="",
        title="Second reader",
        description="The model that reads an order again of which the first is unsure. Empty is "
        "the one that goes with the model, if it was pulled; off is none. It may be on a server.",
        json_schema_extra=_about("Session"),
    )
    judge_server: str = Field(
        default="",
        title="Judge's server",
        description="A model on a server that judges, openai:BASE_URL#NAME. Empty: the model of "
        "this machine judges.",
        json_schema_extra=_about("Session"),
    )
    server_patience_s: float = Field(
        default=20.0,
        ge=1.0,
        le=50.0,
        title="Patience with a server",
        description="Seconds that a model on a server may take for an answer, before the model of "
        "this machine is asked.",
        json_schema_extra=_about("Session"),
    )
    plain_servers: bool = Field(
        default=False,
        title="Unencrypted servers",
        description="Whether the operator's words and the picture may go to a server on another "
        "machine without https.",
        json_schema_extra=_about("Session"),
    )
    world: str = Field(
        default="checkpoint",
        min_length=1,
        title="World",
        description="The world that the console opens: an installed name, a folder or a file.",
        json_schema_extra=_about("Session"),
    )
    rules: str = Field(
        default="checkpoint",
        min_length=1,
        title="Rules",
        description="The rule set in force: an installed name, or the path of a file.",
        json_schema_extra=_about("Session"),
    )
    speed: float = Field(
        default=1.0,
        ge=1.0,
        le=8.0,
        title="Speed",
        description="Simulated seconds per second when the console opens.",
        json_schema_extra=_about("Session"),
    )
    alarms: bool = Field(
        default=True,
        title="Alarms become missions",
        description="Whether an alarm queues a mission by itself. Every plan still waits for you.",
        json_schema_extra=_about("Approval and alarms"),
    )
    approval_delay_s: float = Field(
        default=0.6,
        ge=0.2,
        le=10.0,
        title="Approval hold delay",
        description="Quiet seconds before the approval panel takes a key, so that no stray key "
        "approves a plan.",
        json_schema_extra=_about("Approval and alarms", restart=False),
    )
    check_deadline_ms: float = Field(
        default=10.0,
        ge=1.0,
        le=1000.0,
        title="Deadline of a check",
        description="Milliseconds of processor time that one check of a rule may take. One that "
        "takes longer decides nothing, which blocks the plan.",
        json_schema_extra=_about("Approval and alarms"),
    )
    standing_confidence: float = Field(
        default=0.9,
        ge=0.0,
        le=1.0,
        title="Standing approval needs",
        description="How sure the console has to be of what was asked, 0 to 1, for "
        "`--approve auto` to approve a plan. An order whose words its reading does not account for "
        "is never approved so.",
        json_schema_extra=_about("Approval and alarms", restart=False),
    )
    stale_after_s: float = Field(
        default=5.0,
        ge=2.0,
        le=120.0,
        title="Telemetry is stale after",
        description="Seconds without telemetry after which the top line warns.",
        json_schema_extra=_about("Approval and alarms", restart=False),
    )
    bell: bool = Field(
        default=True,
        title="Bell",
        description="Whether the terminal's bell rings when a plan or an urgent alarm begins to "
        "wait for you.",
        json_schema_extra=_about("Screen", restart=False),
    )
    desktop_notices: bool = Field(
        default=True,
        title="Desktop notices",
        description="Whether the terminal is asked for a notice of the desktop then (OSC 9 and "
        "OSC 777).",
        json_schema_extra=_about("Screen", restart=False),
    )
    window_title: bool = Field(
        default=True,
        title="Window title",
        description="Whether the title of the terminal's window says what waits for you.",
        json_schema_extra=_about("Screen", restart=False),
    )
    theme: str = Field(
        default="pa-console",
        min_length=1,
        title="Theme",
        description="The colours of the console.",
        json_schema_extra=_about("Screen", restart=False),
    )
    mouse: bool = Field(
        default=True,
        title="Mouse",
        description="Whether the console takes the mouse; off leaves it to the terminal, to "
        "select text.",
        json_schema_extra=_about("Screen"),
    )
    history_kept: int = Field(
        default=200,
        ge=0,
        le=10_000,
        title="Missions remembered",
        description="How many typed missions the arrow keys bring back in the mission field.",
        json_schema_extra=_about("Screen"),
    )
    logs: WholePath | None = Field(
        default=None,
        title="Session logs",
        description="The folder that session logs are written to. Empty is the user's state "
        "folder.",
        json_schema_extra=_about("Files"),
    )
    cache: WholePath | None = Field(
        default=None,
        title="Models and cache",
        description="The folder of fetched models and of everything else that can be made again. "
        "Empty is the user's cache folder.",
        json_schema_extra=_about("Files"),
    )
    signing_key: WholePath | None = Field(
        default=None,
        title="Signing key",
        description="The file of the key that signs session logs; it is made on first use. Empty "
        "is the user's config folder.",
        json_schema_extra=_about("Files"),
    )
    witness: WitnessTarget = Field(
        default="",
        title="Witness of session logs",
        description="A file on another disk, or an address with http:// or https://, that is given "
        "the signed heads of the session log every 10 s and at every decision. Empty is none.",
        json_schema_extra=_about("Files"),
    )
    traces: CollectorAddress = Field(
        default="",
        title="Traces",
        description="The address of an OpenTelemetry collector, such as http://127.0.0.1:4318, "
        "that is given every mission as a trace. Empty is none.",
        json_schema_extra=_about("Observability"),
    )
    trace_words: bool = Field(
        default=False,
        title="Words in traces",
        description="Whether traces have what operators typed and models wrote, and who decided.",
        json_schema_extra=_about("Observability"),
    )
    metrics_port: int = Field(
        default=0,
        ge=0,
        le=65_535,
        title="Port of metrics",
        description="The port of this machine at which a session gives its metrics as Prometheus "
        "text. 0 is none.",
        json_schema_extra=_about("Observability"),
    )
    tak: TakAddress = Field(
        default="",
        title="TAK server",
        description="The TAK server that is shown every session, such as tls://tak.example:8089. "
        "Empty is none.",
        json_schema_extra=_about("TAK maps"),
    )
    tak_origin: str = Field(
        default="",
        title="Origin on the earth",
        description="Where (0, 0) of a world is: LATITUDE,LONGITUDE[,BEARING[,ALTITUDE]]. Empty is "
        "what the world's file says.",
        json_schema_extra=_about("TAK maps"),
    )
    tak_contacts: bool | None = Field(
        default=None,
        title="Contacts from TAK",
        description="Whether what others on the TAK server report is shown as unverified contacts. "
        "Empty: where the server is reached over TLS, or is on this machine.",
        json_schema_extra=_about("TAK maps", form="on or off"),
    )
    tak_certificate: WholePath | None = Field(
        default=None,
        title="Certificate for TAK",
        description="The certificate that is shown to a TAK server: PEM, or PKCS #12 (.p12).",
        json_schema_extra=_about("TAK maps"),
    )
    tak_key: WholePath | None = Field(
        default=None,
        title="Key for TAK",
        description="The key of that certificate (PEM). Empty is the same file.",
        json_schema_extra=_about("TAK maps"),
    )
    tak_authority: WholePath | None = Field(
        default=None,
        title="Authority for TAK",
        description="The certificate (PEM) of the authority that vouches for the TAK server.",
        json_schema_extra=_about("TAK maps"),
    )
    keys: dict[str, str] = Field(
        default={},
        title="Keys",
        description="Other keys for the console's actions: an action's name and its keys, "
        "separated by commas.",
        json_schema_extra=_about(
            "Keys",
            restart=False,
            form="`keys: {stop: f11}` in the file, `--set keys.stop=f11` on the command line, "
            """`PA_CONSOLE_KEYS='{"stop": "f11"}'` in the environment""",
        ),
    )

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],  # noqa: ARG003 - the library's signature
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,  # noqa: ARG003
        dotenv_settings: PydanticBaseSettingsSource,  # noqa: ARG003
        file_secret_settings: PydanticBaseSettingsSource,  # noqa: ARG003
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Use the given values only: `sources` merges the others and keeps their origins."""
        return (init_settings,)


@dataclass(frozen=True)
class Setting:
    """One setting for its user; `limits` is empty if every value of the type is valid."""

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


def describe_settings() -> dict[str, Setting]:
    """Return every field of the schema by name, in the schema's order."""
    properties: Mapping[str, Mapping[str, Any]] = Settings.model_json_schema()["properties"]
    return {
        name: Setting(
            name,
            about["title"],
            about["description"],
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
    """Return a value as a user types it; empty for None."""
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, float):
        return f"{value:g}"
    return "" if value is None else str(value)
