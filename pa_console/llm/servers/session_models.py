"""The models of a session: its own, and those on servers that are asked before it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from pa_console.llm.errors import ModelError
from pa_console.llm.models.catalogue import NO_READER, Catalog
from pa_console.llm.servers.address import FORM, names_server
from pa_console.schema.events.event import ServerUse


@dataclass(frozen=True)
class SessionModels:
    """The `own` model and its second reader by name, and the models on servers by their use.

    `own` None is the catalogue's default: it takes over where a server does not answer.
    """

    own: str | None
    second_reader: str = NO_READER
    named: Mapping[ServerUse, str] = field(default_factory=dict[ServerUse, str])


def session_models(model: str | None, judge_server: str, second_reader: str) -> SessionModels:
    """Sort what an operator has chosen; a name of the catalogue may be that of a server.

    Raises ModelError for a judge's server that is none.
    """
    if not (model or judge_server or second_reader):
        return SessionModels(None, "")
    addresses = {entry.name: entry.address for entry in Catalog.load().servers}
    chosen = addresses.get(model or "", model or "")
    judge = addresses.get(judge_server, judge_server)
    reader = addresses.get(second_reader, second_reader)
    if judge and not names_server(judge):
        raise ModelError(f"judge_server: {judge!r} is no model on a server: write {FORM}")
    uses: dict[ServerUse, str] = {"planner": chosen, "judge": judge, "second reader": reader}
    named: dict[ServerUse, str] = {use: name for use, name in uses.items() if names_server(name)}
    return SessionModels(
        None if "planner" in named else chosen or None,
        NO_READER if "second reader" in named else reader,
        named,
    )
