"""Agents that connect to a port of a console, or through stdin and stdout."""

import asyncio
import os
from asyncio import Runner
from collections.abc import Generator
from contextlib import aclosing, contextmanager

from pa_console.cli.options import SessionOptions
from pa_console.cli.sessions.live import LiveSession, open_live
from pa_console.cli.sessions.tokens import token_book
from pa_console.end_signals import EndableRun, exit_code_of
from pa_console.http.connections import listen
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.catalogue import find_model
from pa_console.llm.remote.servers import Servers, session_models
from pa_console.mcp.agents_session import AgentsSession
from pa_console.mcp.server import AgentsPort, bridge, make_server, serve_stdio
from pa_console.observability import Observer
from pa_console.schema.events import event as ev
from pa_console.schema.mission import STANDING, Decision
from pa_console.settings.sources import LoadedSettings
from pa_console.terminal.output import errors

TOKEN_VARIABLE = "PA_CONSOLE_AGENT_TOKEN"
NOBODY = "this session has no operator: it examines proposals but carries none out"


@contextmanager
def admit_agents(opened: LiveSession, observer: Observer) -> Generator[Observer]:
    """Admit agents at the session's port while the context lasts, and yield an observer.

    The observer passes events to the agents and to `observer`. Raises ValueError if the port cannot
    be used.
    """
    problems: list[str] = []

    def failed(error: Exception) -> None:
        problems.append(f"an agent's request failed: {type(error).__name__}: {error}")

    try:
        listening = listen(opened.options.agents)
    except ValueError as error:
        raise ValueError(str(error).replace("--port", "--agents", 1)) from error
    with listening:
        trust = opened.authority.trust if opened.authority else None
        agents = AgentsPort(AgentsSession(opened.station), token_book(trust), listening, failed)

        def take(event: ev.Event) -> None:
            agents.take(event)
            observer(event)

        yield take
    for problem in dict.fromkeys(problems):
        errors.print_line(f"warning: {problem}", style="yellow")


def join_agent(url: str) -> int:
    """Connect the agent on stdin and stdout to a running console; return the exit code.

    Raises ValueError if there is no token.
    """
    token = os.environ.get(TOKEN_VARIABLE, "")
    if not token:
        raise ValueError(
            f"{TOKEN_VARIABLE} is not set; make a token with 'pa-console serve --make-token "
            "proposer --person NAME'"
        )
    asyncio.run(bridge(url, token))
    return 0


def serve_agent(options: SessionOptions, settings: LoadedSettings, name: str) -> int:
    """Serve one agent on stdin and stdout in a separate session; return the exit code.

    Every proposal is rejected after its examination, because there is no operator.
    """
    values = settings.values
    with Runner() as loop:
        chosen = session_models(options.model, values.judge_server, values.second_reader)
        servers = Servers.open(
            chosen.named, plain=values.plain_servers, patience_s=values.server_patience_s
        )
        model = find_model(chosen.own, second_reader=chosen.second_reader)
        engine = Engine(model, require_sandbox=options.require_sandbox)
        try:
            opened = open_live(options, values, lambda: engine, servers)
            writer = opened.open_log()
        except BaseException:
            loop.run(engine.close())
            raise
        endable = EndableRun()
        with opened.logged(writer, endable.end):
            endable.run(_serve(opened, name), loop)
    errors.print_line(f"session log: {writer.path}")
    return exit_code_of(endable.ended_by) if endable.ended_by else 0


async def _serve(opened: LiveSession, name: str) -> None:
    station, session = opened.station, AgentsSession(opened.station)
    server = make_server(session, name)
    agent: asyncio.Task[None] | None = None

    async def until_it_leaves() -> None:
        await serve_stdio(server)
        await station.close("the agent has left")

    try:
        async with aclosing(station.run()) as events:
            async for event in events:
                session.take(event)
                if agent is None:
                    agent = asyncio.create_task(until_it_leaves())
                if isinstance(event.data, ev.ApprovalRequested) and station.awaits_decision:
                    by = f"{STANDING}: {NOBODY}"
                    request = event.data.request_id
                    decision = Decision(kind="reject", request_id=request, by=by, reason=NOBODY)
                    station.decide(decision)
    finally:
        if agent is not None:
            agent.cancel()
