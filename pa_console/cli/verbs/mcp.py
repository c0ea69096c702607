"""`pa-console mcp`: an agent connected to a console, or to a separate simulated session."""

from typing import Annotated

import typer

from pa_console.cli.options import (
    ModelOption,
    RulesOption,
    ScenarioOption,
    SeedOption,
    SessionOptions,
    WorldOption,
)
from pa_console.cli.settings_defaults import settings_of
from pa_console.resources import naming_what_is_missing


def mcp(
    context: typer.Context,
    join: Annotated[
        str,
        typer.Option(
            "--join",
            metavar="URL",
            help="Console to connect to: with --agents 8766 it is at http://127.0.0.1:8766/mcp. "
            "Set PA_CONSOLE_AGENT_TOKEN to the token.",
        ),
    ] = "",
    name: Annotated[
        str, typer.Option("--name", help="Name of the agent, without --join.")
    ] = "agent",
    world: WorldOption = "checkpoint",
    rules: RulesOption = "checkpoint",
    model: ModelOption = None,
    scenario: ScenarioOption = None,
    seed: SeedOption = 0,
) -> None:
    """Connect an agent to a running console over MCP (stdin and stdout); people decide.

    Without --join, the agent gets a separate simulated session: its proposals are read, checked,
    rehearsed and judged, but never carried out.
    """
    settings = settings_of(context, "world", "rules", "model")
    options = SessionOptions(
        world,
        rules,
        model,
        scenario,
        seed,
        alarms=False,
        require_sandbox=settings.values.require_sandbox,
    )
    with naming_what_is_missing("mcp"):
        from pa_console.cli.sessions.agents import join_agent, serve_agent  # noqa: PLC0415
    raise typer.Exit(join_agent(join) if join else serve_agent(options, settings, name))
