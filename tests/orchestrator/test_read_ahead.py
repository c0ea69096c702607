"""What is known before a mission is read by the model while nobody waits for it."""

import asyncio

from pa_console.llm.dialect import DIALECTS
from pa_console.llm.judge import Judge
from pa_console.llm.planner import Planner
from pa_console.orchestrator.compose import Site
from pa_console.orchestrator.read_ahead import ReadAhead
from pa_console.orchestrator.services import Services
from pa_console.policy.retriever import Retriever
from pa_console.schema.incident import FailAsset
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.world_generator import generate_world
from tests.orchestrator.conftest import Rig
from tests.scripted import ScriptedEngine


def services(site: Site, engine: ScriptedEngine, sim: Checkpoint | None = None) -> Services:
    return Services(
        sim=sim or Checkpoint(site.world),
        rulebook=site.rulebook,
        retriever=Retriever(site.rulebook.rules),
        engine=engine.engine(),
        planner=Planner(engine.engine()),
        judge=Judge(engine.engine()),
        dialect=DIALECTS["compact"],
    )


async def typed(ahead: ReadAhead) -> None:
    """Type a letter and let the model read what it wants to."""
    serving = asyncio.create_task(ahead.serve())
    ahead.typing()
    for _ in range(5):
        await asyncio.sleep(0)
    serving.cancel()


async def test_every_role_reads_its_beginning_and_typing_reads_nothing_twice(rig: Rig) -> None:
    engine = ScriptedEngine([])
    ahead = ReadAhead(services(rig.site, engine))
    await ahead.load()
    assert [role for role, _, _ in engine.warmed] == ["planner", "judge", "outcome"]
    await typed(ahead)
    assert len(engine.warmed) == 3


async def test_a_picture_that_changed_is_read_while_somebody_types(rig: Rig) -> None:
    engine = ScriptedEngine([])
    made = services(rig.site, engine)
    ahead = ReadAhead(made)
    await ahead.load()
    made.sim.inject(FailAsset(asset=next(iter(rig.site.world.assets))))
    for _ in range(round(3 / rig.site.world.dt_s)):
        made.sim.step()
    await typed(ahead)
    again = engine.warmed[3:]
    assert [role for role, _, _ in again] == ["planner", "judge"]
    assert all("Down: " in user for _, _, user in again)


async def test_while_the_model_answers_it_is_left_alone(rig: Rig) -> None:
    engine = ScriptedEngine([])
    ahead = ReadAhead(services(rig.site, engine))
    engine.busy = True
    await typed(ahead)
    assert engine.warmed == []
    engine.busy = False
    await typed(ahead)
    assert [role for role, _, _ in engine.warmed] == ["planner", "judge"]


async def test_of_a_large_world_only_what_never_changes_is_read(rig: Rig) -> None:
    engine = ScriptedEngine([])
    large = Checkpoint(generate_world(20, 60, 3))
    ahead = ReadAhead(services(rig.site, engine, large))
    await ahead.load()
    assert all(user == "" for _, _, user in engine.warmed)
