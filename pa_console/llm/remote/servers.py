"""The models of a session: the local model, and models on servers, which are asked first."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from pa_console.llm.backend import Backend, BackendOptions, ModelError, names_backend, open_backend
from pa_console.llm.models.catalogue import NO_READER, Catalog
from pa_console.llm.remote.address import FORM
from pa_console.schema.events.event import ServerUse


@dataclass(frozen=True)
class Servers:
    """The backends of a session's models on servers, by use; by default there are none."""

    by_use: Mapping[ServerUse, Backend] = field(default_factory=dict[ServerUse, Backend])

    @classmethod
    def open(
        cls,
        named: Mapping[ServerUse, str],
        *,
        plain: bool = BackendOptions.plain,
        patience_s: float = BackendOptions.patience_s,
    ) -> "Servers":
        """Return backends for the `named` models, each `openai:BASE_URL#NAME` or ''.

        Nothing is sent yet. If planner and judge use the same model, they share a backend. Raises
        ModelError if a name is invalid, or if prompts would be sent in clear text and `plain` does
        not allow it.
        """
        backends: dict[ServerUse, Backend] = {}
        for use, name in named.items():
            if names_backend(name):
                backend = open_backend(name, BackendOptions(use, plain, patience_s))
                planner = backends.get("planner")
                shared = use == "judge" and planner is not None and planner.name == backend.name
                backends[use] = planner if shared and planner is not None else backend
        return cls(backends)

    @property
    def backends(self) -> dict[Backend, tuple[ServerUse, ...]]:
        """The backends, each with all of its uses."""
        uses: dict[Backend, tuple[ServerUse, ...]] = {}
        for use, backend in self.by_use.items():
            uses[backend] = (*uses.get(backend, ()), use)
        return uses

    @property
    def named(self) -> dict[ServerUse, str]:
        """The names of the models by use, as written to the log."""
        return {use: backend.name for use, backend in self.by_use.items()}


NO_SERVERS = Servers()
"""The value for a session without servers."""


@dataclass(frozen=True)
class SessionModels:
    """The models of a session by name: the local model, its second reader, and those on servers.

    `own` is the local model, which takes over if a server does not answer; None means the default
    of the catalogue. `named` has the models on servers by use.
    """

    own: str | None
    second_reader: str = NO_READER
    named: Mapping[ServerUse, str] = field(default_factory=dict[ServerUse, str])


def session_models(model: str | None, judge_server: str, second_reader: str) -> SessionModels:
    """Return the operator's choices as local models and models on servers.

    A name from the catalogue can refer to a model on a server. Raises ModelError if `judge_server`
    is not a model on a server.
    """
    if not (model or judge_server or second_reader):
        return SessionModels(None, "")
    addresses = {entry.name: entry.address for entry in Catalog.load().servers}
    chosen = addresses.get(model or "", model or "")
    judge = addresses.get(judge_server, judge_server)
    reader = addresses.get(second_reader, second_reader)
    if judge and not names_backend(judge):
        raise ModelError(f"judge_server: {judge!r} is not a model on a server: write {FORM}")
    uses: dict[ServerUse, str] = {"planner": chosen, "judge": judge, "second reader": reader}
    named: dict[ServerUse, str] = {use: name for use, name in uses.items() if names_backend(name)}
    return SessionModels(
        None if "planner" in named else chosen or None,
        NO_READER if "second reader" in named else reader,
        named,
    )
