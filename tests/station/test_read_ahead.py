"""What is known before a mission is read by the model while nobody waits for it."""

import asyncio
from dataclasses import replace
from datetime import UTC, datetime

import pytest

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.language.canonical.reading import read_asked
from pa_console.llm.roles.role_model import PROMPT_FORMATS
from pa_console.mission.approval import standing_approver
from pa_console.mission.context import Services
from pa_console.schema.events.event import Event, Role
from pa_console.schema.incident import FailAsset, SpawnTrack
from pa_console.schema.mission import Mission
from pa_console.session.state import SessionState
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.world_generator import generate_world
from pa_console.station.assembly import Site, open_station
from pa_console.station.clock import SteppedClock
from pa_console.station.headless import run_missions
from pa_console.station.live_reading import ReadAhead
from tests.rig import MISSION, Rig
from tests.scripted import ScriptedEngine, plan


class SlowEngine(ScriptedEngine):
    """Reads ahead only when it may `go`."""

    def __init__(self, plans: list[str]) -> None:
        super().__init__(plans)
        self.go = asyncio.Event()

    async def warm(self, role: Role, system: str, user: str = "") -> None:
        """Note it at once, and take until `go`."""
        await super().warm(role, system, user)
        await self.go.wait()


def services(site: Site, engine: ScriptedEngine, sim: Checkpoint | None = None) -> Services:
    fleet = SimulatedFleet(sim or Checkpoint(site.world))
    return Services.open(
        fleet, site.rulebook, engine.engine(), prompt_format=PROMPT_FORMATS["compact"]
    )


async def typed(ahead: ReadAhead, text: str = "w") -> None:
    """Type `text` and let the model read what it wants to."""
    serving = asyncio.create_task(ahead.serve())
    ahead.typing(text)
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


async def test_what_is_not_to_be_read_unasked_is_read_when_it_is_asked_for(rig: Rig) -> None:
    engine = ScriptedEngine([])
    ahead = ReadAhead(services(rig.site, engine), unasked=False)
    await ahead.load()
    assert engine.warmed == []
    await ahead.read_now("an unknown vehicle is at the west")
    assert [role for role, _, _ in engine.warmed] == ["planner", "judge"]


async def test_a_picture_that_changed_is_read_while_somebody_types(rig: Rig) -> None:
    engine = ScriptedEngine([])
    sim = Checkpoint(rig.site.world)
    ahead = ReadAhead(services(rig.site, engine, sim))
    await ahead.load()
    sim.inject(FailAsset(asset=next(iter(rig.site.world.assets))))
    for _ in range(round(3 / rig.site.world.dt_s)):
        sim.step()
    await typed(ahead)
    again = engine.warmed[3:]
    assert [role for role, _, _ in again] == ["planner", "judge"]
    assert all("down" in user.lower() for _, _, user in again)


async def test_whole_words_are_read_with_their_rules_while_the_next_is_typed(rig: Rig) -> None:
    engine = ScriptedEngine([])
    made = services(rig.site, engine)
    ahead = ReadAhead(made)
    await ahead.load()
    await typed(ahead, "an unknown vehicle is at the we")
    await typed(ahead, "an unknown vehicle is at the west")
    read = engine.warmed[3:]
    assert [role for role, _, _ in read] == ["planner", "judge"]
    hits = made.retriever.retrieve("an unknown vehicle is at the", made.top_k)
    asked = [made.rulebook.get(hit.rule_id) for hit in hits]
    quoted = [rule.id for rule in asked if rule.priority != "critical"][:2]
    for _, _, user in read:
        assert user.endswith('\nMission: "an unknown vehicle is at the')
        assert quoted
        assert all(f"\n{rule}: " in user for rule in quoted)


async def test_the_second_reader_reads_what_is_typed_after_planner_and_judge(rig: Rig) -> None:
    engine, second = ScriptedEngine([]), ScriptedEngine([])
    second.model = replace(second.model, prompts="compact")
    engine.second_reader = second
    ahead = ReadAhead(services(rig.site, engine))
    await ahead.load()
    assert second.warmed == []
    await typed(ahead, "an unknown vehicle is at the we")
    assert second.warmed == [engine.warmed[-1]]
    assert [role for role, _, _ in second.warmed] == ["judge"]


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


async def test_whoever_waits_for_the_picture_waits_for_what_is_being_read(rig: Rig) -> None:
    engine = SlowEngine([])
    ahead = ReadAhead(services(rig.site, engine))
    loading = asyncio.create_task(ahead.load())
    await asyncio.sleep(0)
    waiting = asyncio.create_task(ahead.read_now())
    async with asyncio.timeout(10.0):
        while not engine.warmed:
            await asyncio.sleep(0)
    for _ in range(5):
        await asyncio.sleep(0)
    assert (len(engine.warmed), waiting.done()) == (1, False)
    engine.go.set()
    await waiting
    assert loading.done()
    assert [role for role, _, _ in engine.warmed] == ["planner", "judge", "outcome"]


async def test_missions_are_given_when_the_picture_was_read_if_that_is_wanted(rig: Rig) -> None:
    for wanted in (True, False):
        engine = SlowEngine([plan(("Drone_T04", "report"))])
        station = open_station(rig.site, engine.engine(), SteppedClock())
        read: list[int] = []

        def sink(
            event: Event, _: SessionState, engine: SlowEngine = engine, read: list[int] = read
        ) -> None:
            if event.data.kind == "mission_received":
                read.append(len(engine.warmed))
            engine.go.set()

        missions = ["say what you see", "say it again"]
        traces = await run_missions(
            station, missions, standing_approver("auto"), sink, read_ahead=wanted
        )
        assert [trace.status for trace in traces] == ["verified", "verified"]
        assert (read[0] >= 2) == wanted


async def test_while_a_contact_is_identified_the_picture_of_its_warning_is_read(rig: Rig) -> None:
    identify, warn = (plan(("Robot_T01", f"{verb} WestGate")) for verb in ("identify", "warn"))
    engine = ScriptedEngine([identify, warn])
    engine.model = replace(engine.model, prompts="compact")
    trace = await rig.run(
        engine, [SpawnTrack(gate="WestGate", distance_m=60.0)], text="Inspect the vehicle."
    )
    assert [each.command.verb for each in trace.commands.values()] == ["identify", "warn"]
    ahead = engine.warmed[-2:]
    assert [role for role, _, _ in ahead] == ["planner", "judge"]
    for role, system, user in ahead:
        asked = next(r for r in reversed(engine.requests) if r.role == role)
        assert asked.system == system
        assert asked.user.startswith(user.partition("\nTrack_01: ")[0])
        assert "Robot_T01: free robot at WestGate" in user


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
