"""Runs a recorded session again and reports the result in one line."""

from pathlib import Path

from pa_console.evaluation.twin import resimulate
from pa_console.schema.text import count
from pa_console.session.log.chain import read_log, session_start
from pa_console.sim.worlds.scenario_file import open_scenario
from pa_console.station.assembly import SessionSites


def run_again(log: Path) -> tuple[bool, str]:
    """Return whether telemetry and rehearsals came out as recorded, and that in words.

    The rules are not tried again: `pa-console replay LOG --resimulate` does that too. Raises
    ValueError (DocumentError) when the log cannot be read, or its world or scenario is not here.
    """
    started, sites = session_start(next(read_log(log), None), log), SessionSites()
    world, file = sites.world_of(started, log), sites.world_file(started, log)
    scenario = None
    if started.scenario and file is not None:
        loaded = open_scenario(world, file, started.scenario)
        if started.scenario_sha256 not in ("", loaded.sha256):
            raise ValueError(f"its scenario “{started.scenario}” has changed since")
        scenario = loaded.scenario
    twin = resimulate(read_log(log), world, scenario)
    if twin.equal:
        told = f"{count(twin.pictures, 'picture')} and {count(twin.rehearsals, 'rehearsal')}"
        return True, f"{told} of plans came out equal"
    return False, f"it came out otherwise, first at {twin.first_difference or 'no picture'}"
