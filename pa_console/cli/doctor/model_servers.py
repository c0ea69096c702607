"""The check of a model on a server: it is probed as a session does it."""

import asyncio
from collections.abc import Iterator

from pa_console.cli.doctor.checks import Check
from pa_console.llm.backend import BackendOptions, ModelError, open_backend
from pa_console.llm.remote.address import KEY_VARIABLES, ServerKey
from pa_console.llm.remote.engine import ServerEngine
from pa_console.llm.remote.servers import SessionModels, session_models
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
        engine = open_backend(name, BackendOptions(use, plain))
    except ModelError as error:
        return Check(title, "missing", str(error), "name another one, or none")
    if not isinstance(engine, ServerEngine):
        return Check(title, "ok", f"{engine.name}: the backend of another package, not asked")
    asyncio.run(_looked(engine))
    told = engine.report.told if engine.usable else engine.detail
    key = ServerKey.find(engine.address, KEY_VARIABLES[use])
    found = f"{engine.name}: {told}; key from {key.source}"
    match engine.state:
        case "ready":
            return Check(title, "ok", found)
        case "unconstrained":
            remedy = "use a server that holds answers to a JSON schema or a grammar"
            return Check(title, "warning", found, remedy)
        case _:
            remedy = f"start it, and see its address and key ({KEY_VARIABLES[use]}); {PROBLEM}"
            return Check(title, "warning", found, remedy)


async def _looked(engine: ServerEngine) -> None:
    try:
        await engine.look()
    finally:
        await engine.close()
