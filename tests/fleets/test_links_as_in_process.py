"""What a station sees and does over links is what it sees and does in one process."""

from pathlib import Path
from unittest.mock import patch

import pytest

from pa_console.evaluation import runner
from pa_console.evaluation.jobs import (
    Job,
    find_variant,
    load_set,
    mission_file,
    plan_jobs,
)
from pa_console.evaluation.memo_engine import MemoEngine
from pa_console.evaluation.run_record import RunRecord
from pa_console.evaluation.score import idle_run
from pa_console.fleets.fleet import Simulated
from pa_console.fleets.simulated import SimulatedFleet
from pa_console.schema.incident import GpsDrift, SensorFault, SetWeather
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from pa_console.station.assembly import load_site
from tests.evaluation.witness_play import plans, written
from tests.fleets.simulated_link import SimulatedLinkFleet
from tests.fleets.test_site_as_in_process import SCRIPTS, Script, play
from tests.scripted import ScriptedEngine, plan

NOT_ON_A_LINK = (SetWeather, GpsDrift)
"""No link reports the weather, nor where an asset was posted that is seen between frames."""


@pytest.mark.parametrize("name", SCRIPTS)
def test_replies_and_picture_are_the_same(name: str, world: World) -> None:
    camera = next(iter(world.cameras))
    script: Script = {
        tick: SensorFault(sensor=camera) if isinstance(entry, SensorFault) else entry
        for tick, entry in SCRIPTS[name].items()
        if not isinstance(entry, NOT_ON_A_LINK)
    }
    twin, fleet = SimulatedFleet.start(world, seed=1), SimulatedLinkFleet(Checkpoint(world, 1))
    assert isinstance(fleet, Simulated)
    assert play(fleet, script) == play(twin, script)
    assert fleet.picture().model_copy(update={"links": {}}) == twin.picture()


async def made(job: Job) -> RunRecord:
    """Return the run of a mission with the plan that was written for it by hand."""
    (todo,) = plans(written("paper.yaml")[job.case.id])
    scripted = ScriptedEngine([plan(*((a.agent, a.command) for a in todo.actions))])
    engine = MemoEngine(scripted.engine(), reuse=False)
    rules = runner.enforced_rules(job.site.rulebook)
    return await runner.make_run(
        job, engine, lambda: idle_run(job.case, job.site.world, job.seed, rules), None
    )


@pytest.mark.parametrize("mission", written("paper.yaml"))
async def test_a_mission_of_the_paper_has_the_same_strict_outcome(
    mission: str, tmp_path: Path
) -> None:
    site = load_site("checkpoint", "checkpoint")
    path = mission_file("paper", site.world_path)
    loaded = load_set(path, "checkpoint", site.rulebook, tmp_path)
    jobs = plan_jobs([loaded], ["scripted"], [find_variant("one-plan")], [0])
    (job,) = (job for job in jobs if job.case.id == mission)
    inside = await made(job)
    with patch.object(runner, "SimulatedFleet", SimulatedLinkFleet):
        over_links = await made(job)
    for told in (inside, over_links):
        assert told.strict, told.failed
    assert outcome(over_links) == outcome(inside)


def outcome(run: RunRecord) -> tuple[object, ...]:
    return run.status, run.verification, run.plan, run.broken
