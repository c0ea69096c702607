"""The check of a model on a server: it is probed as a session does it."""

import asyncio
from collections.abc import Iterator

from pa_console.cli.doctor.checks import Check
from pa_console.llm.errors import ModelError
from pa_console.llm.servers.address import ServerAddress, ServerKey
from pa_console.llm.servers.engine import ServerEngine
from pa_console.llm.servers.servers import VARIABLES
from pa_console.llm.servers.session_models import SessionModels, session_models
from pa_console.schema.events.event import ServerUse
from pa_console.settings.schema import Settings

NAME = "model server"
PROBLEM = "the model of this machine answers in its place"


def named_models(settings: Settings) -> SessionModels:
    """Return the models that the settings name; those of this machine alone where that is wrong."""
    try:
        return session_models(settings.model, settings.judge_server, settings.second_reader)
    except ModelError:
        return SessionModels(settings.model or None)


def check_servers(named: SessionModels, settings: Settings) -> Iterator[Check]:
    """Probe every server that is named; nothing is sent where none is."""
    if settings.judge_server and "judge" not in named.named:
        remedy = "pa-console settings set judge_server openai:BASE_URL#NAME"
        yield Check(NAME, "missing", f"judge_server: {settings.judge_server!r} is none", remedy)
    for use, name in named.named.items():
        yield check_server(use, name, plain=settings.plain_servers)


def check_server(use: ServerUse, name: str, *, plain: bool = False) -> Check:
    """Ask the server `name` which way of constraining an answer holds, and look for its key."""
    title = f"{NAME}, {use}"
    try:
        address = ServerAddress.parse(name)
        address.allow(plain=plain)
    except ModelError as error:
        return Check(title, "missing", str(error), "name another one, or none")
    key = ServerKey.find(address, VARIABLES[use])
    engine = ServerEngine(address, key)
    asyncio.run(_looked(engine))
    told = engine.report.told if engine.usable else engine.detail
    found = f"{address}: {told}; key from {key.source}"
    match engine.state:
        case "ready":
            return Check(title, "ok", found)
        case "unconstrained":
            remedy = "use a server that holds answers to a JSON schema or a grammar"
            return Check(title, "warning", found, remedy)
        case _:
            remedy = f"start it, and see its address and key ({VARIABLES[use]}); {PROBLEM}"
            return Check(title, "warning", found, remedy)


async def _looked(engine: ServerEngine) -> None:
    try:
        await engine.look()
    finally:
        await engine.close()
