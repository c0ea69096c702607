"""A console with a scripted model that serves one agent on stdio, in a process of its own.

Its operator approves every plan that may be approved, as a person does who has looked at it. The
process writes its id to the file that it is given.
"""

import asyncio
import os
import sys
from contextlib import suppress
from pathlib import Path

from pa_console.mcp.server import make_server, serve_stdio
from pa_console.schema.events import event as ev
from pa_console.station.assembly import load_site
from tests.mcp.conftest import Beside, beside


async def serve() -> None:
    """Serve until the agent closes stdin."""

    def admit(running: Beside, event: ev.Event) -> None:
        running.agents.take(event)
        if isinstance(event.data, ev.ApprovalRequested):
            asyncio.get_running_loop().call_soon(approve, running, event.data)

    def approve(running: Beside, request: ev.ApprovalRequested) -> None:
        with suppress(ValueError):
            running.approve(request)

    async with beside(load_site("checkpoint", "checkpoint")) as running:
        running.take = lambda event: admit(running, event)
        await serve_stdio(make_server(running.agents, "planner-7"))


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(str(os.getpid()), "utf-8")
    asyncio.run(serve())
