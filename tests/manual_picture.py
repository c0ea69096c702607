"""Makes the picture of the manual anew, from a real session with the default model.

`python -m tests.manual_picture` plays a scenario, approves the plans of the first two phases, and
draws the screen while the plan of the third waits. It takes about two minutes.
"""

import asyncio
import tempfile
from collections.abc import Callable
from pathlib import Path

from pa_console.llm.local.engine import Engine
from pa_console.llm.models.catalogue import find_model
from pa_console.schema.mission import Decision
from pa_console.settings.sources import default_settings
from pa_console.sim.worlds.scenario_file import open_scenario
from pa_console.station.assembly import load_site, open_station
from pa_console.station.clock import RealTimeClock
from pa_console.tui.app import ConsoleApp
from pa_console.tui.approval.panel import ApprovalPanel

PICTURE = Path(__file__).parent.parent / "pa_console" / "manual" / "screen.svg"
SCENARIO = "situation-1-unauthorized"
SIZE = (120, 36)
PHASE = 2
"""The phase whose plan waits in the picture: warn, after recon and identify."""

LIMIT_S = 300.0


async def make() -> str:
    """Return the picture as SVG; raises TimeoutError when the plan does not come."""
    site = load_site("checkpoint", "checkpoint")
    played = open_scenario(site.world, site.world_path, SCENARIO)
    engine = Engine(find_model(None))
    await engine.start()
    station = open_station(site, engine, RealTimeClock(), scenario=played, respond=True)
    station.rate = 4.0
    with tempfile.TemporaryDirectory() as folder:
        app = ConsoleApp(
            site.world,
            station,
            site.rulebook,
            station.retriever,
            history=Path(folder) / "history.txt",
            favourites=Path(folder) / "favourites.yaml",
            copies=Path(folder),
            settings=default_settings(),
        )
        async with app.run_test(size=SIZE):
            for _ in range(PHASE):
                await _until(lambda: _waits(app))
                station.decide(Decision(kind="approve"))
                await _until(lambda: not _waits(app))
            await _until(lambda: _waits(app))
            app.controllers.commands.set_rate(1.0)
            panel = app.screen.query_one(ApprovalPanel)
            await _until(lambda: panel.armed)
            await asyncio.sleep(1.0)  # the frame after it
            panel.refresh_state()
            await asyncio.sleep(0.2)
            picture = app.export_screenshot(title="PA Console")
            await station.close()
    return picture.replace("<svg ", '<svg xml:space="preserve" ', 1)


def _waits(app: ConsoleApp) -> bool:
    current = app.session.state.current
    return current is not None and current.approval is not None


async def _until(done: Callable[[], bool]) -> None:
    async with asyncio.timeout(LIMIT_S):
        while not done():
            await asyncio.sleep(0.1)


if __name__ == "__main__":
    PICTURE.write_text(asyncio.run(make()), encoding="utf-8")
