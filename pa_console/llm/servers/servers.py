"""The models on servers that a session asks before its own, each with its uses."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from pa_console.llm.servers.address import (
    JUDGE_KEY_VARIABLE,
    KEY_VARIABLE,
    READER_KEY_VARIABLE,
    ServerAddress,
    ServerKey,
    names_server,
)
from pa_console.llm.servers.engine import PATIENCE_S, ServerEngine
from pa_console.schema.events.event import ServerUse

VARIABLES: dict[ServerUse, str] = {
    "planner": KEY_VARIABLE,
    "judge": JUDGE_KEY_VARIABLE,
    "second reader": READER_KEY_VARIABLE,
}
"""The variable of the environment that holds the key of each."""


@dataclass(frozen=True)
class Servers:
    """The engines of a session's servers, by what they are asked to be; none unless named."""

    by_use: Mapping[ServerUse, ServerEngine] = field(default_factory=dict[ServerUse, ServerEngine])

    @classmethod
    def open(
        cls,
        named: Mapping[ServerUse, str],
        *,
        plain: bool = False,
        patience_s: float = PATIENCE_S,
    ) -> "Servers":
        """Return engines for the models that are `named`, `openai:BASE_URL#NAME` each or ''.

        Nothing is sent yet. Planner and judge at one address share an engine. Raises ModelError for
        a name that is none, and for one to which words would go in clear, unless `plain` allows it.
        """
        engines: dict[ServerUse, ServerEngine] = {}
        for use, address in addresses(named, plain=plain).items():
            before = engines.get("planner")
            if use == "judge" and before is not None and before.address == address:
                engines[use] = before
                continue
            key = ServerKey.find(address, VARIABLES[use])
            engines[use] = ServerEngine(
                address, key, patience_s=patience_s, chances=use == "second reader"
            )
        return cls(engines)

    @property
    def engines(self) -> dict[ServerEngine, tuple[ServerUse, ...]]:
        """Every engine once, with its uses."""
        found: dict[ServerEngine, tuple[ServerUse, ...]] = {}
        for use, engine in self.by_use.items():
            found[engine] = (*found.get(engine, ()), use)
        return found

    @property
    def named(self) -> dict[ServerUse, str]:
        """The models by what they are asked to be, as a log names them."""
        return {use: str(engine.address) for use, engine in self.by_use.items()}


def addresses(
    named: Mapping[ServerUse, str], *, plain: bool = False
) -> dict[ServerUse, ServerAddress]:
    """Return the addresses of those of `named` that are servers; raises ModelError as `open`."""
    found: dict[ServerUse, ServerAddress] = {}
    for use, name in named.items():
        if names_server(name):
            found[use] = ServerAddress.parse(name)
            found[use].allow(plain=plain)
    return found


NO_SERVERS = Servers()
"""The servers of a session without any."""
