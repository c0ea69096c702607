"""What another reading of an order would lead to is rehearsed before anybody chooses it."""

from datetime import UTC, datetime

import pytest

from pa_console.language.canonical.reading import read_asked
from pa_console.schema.mission import Mission
from tests.rig import MISSION, Rig
from tests.scripted import ScriptedEngine

TASK = Mission(id="M-001", text=MISSION, created=datetime(2026, 1, 1, tzinfo=UTC))


@pytest.mark.parametrize(
    ("asked", "command"),
    [("asked: 1 drone to EastGate", "move_to EastGate"), ("asked: hold", "hold")],
)
async def test_a_reading_is_rehearsed_without_a_model_and_without_a_word_in_the_log(
    rig: Rig, asked: str, command: str
) -> None:
    engine = ScriptedEngine([])
    station = rig.station(engine)
    found = await station.look_at(TASK, asked)
    assert found is not None
    assert {action.command for action in found.plan.actions} == {command}
    assert not found.faults
    assert set(found.rehearsal.timeline.assets) == set(found.plan.agents)
    assert engine.requests == []
    assert not station.awaits_decision


async def test_nobody_has_two_commands_in_a_reading(rig: Rig) -> None:
    found = await rig.station(ScriptedEngine([])).look_at(TASK, "asked: all free to EastGate")
    assert found is not None
    assert len(found.plan.agents) == len(set(found.plan.agents)) > 1


async def test_what_cannot_be_read_is_not_rehearsed(rig: Rig) -> None:
    asked = "asked: dance at EastGate tonight"
    reading = read_asked(asked)
    assert reading is None or not reading.readable
    assert await rig.station(ScriptedEngine([])).look_at(TASK, asked) is None


async def test_other_ways_give_the_same_commands_to_others_without_a_model(rig: Rig) -> None:
    engine = ScriptedEngine([])
    station, asked = rig.station(engine), "asked: 1 drone to EastGate"
    first = await station.look_at(TASK, asked)
    assert first is not None
    ways = [way async for way in station.other_ways(TASK, asked, first.plan)]
    given = [{(a.agent, a.command) for a in way.plan.actions} for way in (first, *ways)]
    assert all(other not in given[:at] for at, other in enumerate(given)), "each is another plan"
    assert all("move_to EastGate" in {command for _, command in each} for each in given)
    assert all(not way.faults for way in ways)
    assert engine.requests == engine.several == []
    unreadable = station.other_ways(TASK, "asked: dance at EastGate tonight", first.plan)
    assert [way async for way in unreadable] == []
