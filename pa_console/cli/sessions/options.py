"""The options of a session, and the models that its settings name."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # no help of a verb waits for the models
    from pa_console.llm.remote.servers import Servers, SessionModels
    from pa_console.settings.schema import Settings


@dataclass(frozen=True)
class SessionOptions:
    """The command-line options of a session."""

    world: str
    rules: str
    scenario: str | None
    seed: int
    alarms: bool | None
    """True if alarms become missions by themselves; None for only where a scenario is played."""
    unsigned: bool
    accept_rules: bool
    fleet: str
    certificates: Path | None
    witness: str
    readonly: bool = False
    resume: bool | None = False
    """True to go on with a session that was not closed; None where the operator is to be asked."""
    log: Path | None = None
    """The file of the log; a new one in the folder of logs otherwise."""
    stepped: bool = False
    """True for a script: the simulation waits for the mission, and no question is asked before."""


def chosen_models(model: str | None, settings: "Settings") -> "SessionModels":
    """Return the models that `model` (else the settings) and the settings name."""
    from pa_console.llm.remote.servers import session_models  # noqa: PLC0415

    return session_models(model, settings.judge_server, settings.second_reader)


def open_servers(chosen: "SessionModels", settings: "Settings") -> "Servers":
    """Return the engines of the servers that were named; nothing is sent yet.

    Raises ModelError for an address that is none, or that words may not be sent to.
    """
    from pa_console.llm.remote.servers import Servers  # noqa: PLC0415

    return Servers.open(
        chosen.named, plain=settings.plain_servers, patience_s=settings.server_patience_s
    )
