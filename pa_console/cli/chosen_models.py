"""The models of a session as its settings name them: the own one, and those on servers."""

from pa_console.llm.remote.servers import Servers, SessionModels, session_models
from pa_console.settings.schema import Settings


def chosen_models(model: str | None, settings: Settings) -> SessionModels:
    """Return the models that `model` (else the settings) and the settings name."""
    return session_models(model, settings.judge_server, settings.second_reader)


def open_servers(chosen: SessionModels, settings: Settings) -> Servers:
    """Return the engines of the servers that were named; nothing is sent yet.

    Raises ModelError for an address that is none, or that words may not be sent to.
    """
    return Servers.open(
        chosen.named, plain=settings.plain_servers, patience_s=settings.server_patience_s
    )
