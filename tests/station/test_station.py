"""The station as its operators use it: queue, cancel, stop, what-if, read-only."""

import asyncio
from contextlib import aclosing

import pytest

from pa_console.language.references.conversation import corrects
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.catalogue import Catalog
from pa_console.llm.models.fetching import pull
from pa_console.mission.approval import standing_approver
from pa_console.schema.events import event as ev
from pa_console.schema.incident import FailAsset
from pa_console.schema.mission import Decision
from pa_console.session.state import SessionState
from pa_console.station import intake
from pa_console.station.assembly import Site, open_station
from pa_console.station.clock import RealTimeClock, SteppedClock
from pa_console.station.headless import run_missions
from tests.rig import MISSION, Rig
from tests.scripted import ScriptedEngine, plan

SPARE = plan(("Drone_T04", "move_to EastGate"))


@pytest.mark.parametrize("text", ["", "   \n", "x" * 2001])
def test_a_mission_without_sense_is_refused_with_a_reason(rig: Rig, text: str) -> None:
    with pytest.raises(ValueError, match="mission"):
        rig.station(ScriptedEngine([SPARE])).submit(text)


def test_a_read_only_station_refuses_every_command(rig: Rig) -> None:
    station = open_station(
        rig.site, ScriptedEngine([SPARE]).engine(), SteppedClock(), readonly=True
    )
    for command in (
        lambda: station.submit(MISSION),
        lambda: station.decide(Decision(kind="approve")),
        station.cancel,
        station.stop_all,
        lambda: station.inject(FailAsset(asset="Drone_T01")),
    ):
        with pytest.raises(ValueError, match="read-only"):
            command()


def test_deciding_when_nothing_waits_is_an_error(rig: Rig) -> None:
    with pytest.raises(ValueError, match="no plan is waiting"):
        rig.station(ScriptedEngine([SPARE])).decide(Decision(kind="approve"))


def test_an_unknown_asset_cannot_fail(rig: Rig) -> None:
    with pytest.raises(ValueError, match="Drone_T99"):
        rig.station(ScriptedEngine([SPARE])).inject(FailAsset(asset="Drone_T99"))


async def test_missions_are_worked_on_one_at_a_time_in_order(rig: Rig) -> None:
    station = rig.station(ScriptedEngine([plan(("Drone_T04", "report"))]))
    state, order = SessionState(), list[tuple[str, str | None]]()
    station.submit("All drones report.")
    station.submit("All robots report.")
    async with aclosing(station.run()) as events:
        async for event in events:
            state.apply(event)
            if event.data.kind in ("mission_started", "mission_finished"):
                order.append((event.data.kind, event.mission))
            if isinstance(event.data, ev.ApprovalRequested):
                station.decide(Decision(kind="reject"))
            if len(order) == 4:
                break
    first, second = state.missions
    assert [state.missions[m].mission.text for m in (first, second)] == [
        "All drones report.",
        "All robots report.",
    ]
    assert order == [
        ("mission_started", first), ("mission_finished", first),
        ("mission_started", second), ("mission_finished", second),
    ]  # fmt: skip


async def test_cancelling_while_the_model_thinks_ends_the_mission_at_once(rig: Rig) -> None:
    station = rig.station(ScriptedEngine([None]))
    state = SessionState()
    station.submit(MISSION)
    async with aclosing(station.run()) as events:
        async for event in events:
            state.apply(event)
            if event.data.kind == "prompt_built":
                asyncio.get_running_loop().call_soon(station.cancel)
            if event.data.kind == "mission_finished":
                break
    assert state.current is not None
    assert state.current.status == "cancelled"


async def test_cancelling_under_way_makes_the_asset_hold(rig: Rig) -> None:
    station = open_station(rig.site, ScriptedEngine([SPARE]).engine(), SteppedClock())
    state = SessionState()
    station.submit(MISSION)
    verbs: list[str] = []
    async with aclosing(station.run()) as events:
        async for event in events:
            state.apply(event)
            match event.data:
                case ev.ApprovalRequested():
                    station.decide(Decision(kind="approve"))
                case ev.CommandReplied(reply=reply) if reply.status == "acknowledged":
                    station.cancel()
                case ev.CommandSent(command=command):
                    verbs.append(f"{command.agent} {command.verb}")
                case ev.MissionFinished():
                    break
                case _:
                    pass
    assert state.current is not None
    assert state.current.status == "cancelled"
    assert verbs == ["Drone_T04 move_to", "Drone_T04 hold"]


async def test_stop_holds_every_asset_and_voids_the_queue(rig: Rig) -> None:
    station = rig.station(ScriptedEngine([None]))
    state, held = SessionState(), set[str]()
    for text in ("All report.", "Drones, report.", "Robots, report."):
        station.submit(text)
    finished = 0
    async with aclosing(station.run()) as events:
        async for event in events:
            state.apply(event)
            match event.data:
                case ev.PromptBuilt():
                    asyncio.get_running_loop().call_soon(station.stop_all)
                case ev.CommandSent(command=command) if command.verb == "hold":
                    held.add(command.agent)
                case ev.MissionFinished():
                    finished += 1
                    if finished == 3:
                        break
                case _:
                    pass
    assert {trace.status for trace in state.missions.values()} == {"cancelled"}
    assert held == set(rig.site.world.assets)


async def test_the_world_moves_by_itself_in_real_time(rig: Rig) -> None:
    clock = RealTimeClock(rate=50.0)
    station = open_station(rig.site, ScriptedEngine([SPARE]).engine(), clock)
    state = SessionState()
    async with aclosing(station.run()) as events:
        async for event in events:
            state.apply(event)
            if state.picture is not None and state.picture.time_s >= 5.0:
                break
    assert state.tick >= 50


async def test_closing_ends_the_stream_with_a_last_event(rig: Rig) -> None:
    station = rig.station(ScriptedEngine([SPARE]))
    kinds: list[str] = []
    async for event in station.run():
        kinds.append(event.data.kind)
        await station.close("done here")
    assert kinds[0] == "session_started"
    assert kinds[-1] == "session_ended"
    assert kinds.count("session_ended") == 1


def test_a_text_is_read_once_though_it_might_have_been_a_question(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[str] = []

    def read_words(text: str, *_: object) -> str:
        read.append(text)
        return text

    monkeypatch.setattr(intake, "read_words", read_words)
    station = rig.station(ScriptedEngine([SPARE]))
    assert station.question_in(MISSION) is None
    assert station.submit(MISSION).text == MISSION
    assert read == [MISSION]


async def test_a_correction_replaces_the_plan_that_waits(rig: Rig) -> None:
    scripted = ScriptedEngine([SPARE, plan(("Drone_T04", "move_to WestGate"))])
    station, state, corrected = rig.station(scripted), SessionState(), False
    station.submit(MISSION)
    async with aclosing(station.run()) as events:
        async for event in events:
            state.apply(event)
            if isinstance(event.data, ev.ApprovalRequested) and not corrected:
                corrected = True
                station.submit("No, the west gate.")
            elif isinstance(event.data, ev.ApprovalRequested):
                break
    first, second = state.missions.values()
    assert (first.status, second.mission.said) == ("rejected", "No, the west gate.")
    assert "WestGate" in second.mission.text
    assert not any(isinstance(e.data, ev.CommandSent) for e in rig.events)


async def test_never_mind_withdraws_the_plan_that_waits(rig: Rig) -> None:
    station, state = rig.station(ScriptedEngine([SPARE])), SessionState()
    station.submit(MISSION)
    async with aclosing(station.run()) as events:
        async for event in events:
            state.apply(event)
            if isinstance(event.data, ev.ApprovalRequested):
                station.submit("Never mind.")
            both = len(state.missions) == 2
            if both and all(one.status for one in state.missions.values()):
                break
    assert [one.status for one in state.missions.values()] == ["rejected", "verified"]


@pytest.mark.parametrize(
    ("text", "how"),
    [
        ("No, the other gate.", "replaces"),
        ("Sorry, I meant Robot_T02.", "replaces"),
        ("Never mind.", "takes back"),
        ("Cancel that.", "takes back"),
        ("Send Robot_T02 to the north gate instead of waiting.", ""),
        ("No drone is at the east gate, which is odd; have a robot look after it, and bring one "
         "of the vehicles back from there to the base.", ""),
    ],
)  # fmt: skip
def test_what_corrects_an_order_begins_as_a_correction(text: str, how: str) -> None:
    assert corrects(text) == how


@pytest.mark.parametrize("events", [1, 2, 3])
async def test_leaving_while_the_model_starts_leaves_no_process_behind(
    site: Site, events: int
) -> None:
    catalog = Catalog.load()
    pull(catalog.get("smollm2-135m"))
    engine = Engine(catalog.locate("smollm2-135m"))
    station = open_station(site, engine, SteppedClock())
    seen = 0
    async with asyncio.timeout(300), aclosing(station.run()) as stream:
        async for _ in stream:
            seen += 1
            if seen == events:
                break
    assert engine.pid is None


@pytest.mark.parametrize("decided", [False, True])
async def test_a_session_is_watched_no_longer_where_nothing_matters_any_more(
    rig: Rig, decided: bool
) -> None:
    """A refused mission ends at once; the rest of the time is for whoever wants to see it."""
    ended: list[int] = []

    def sink(event: ev.Event, _: SessionState) -> None:
        if isinstance(event.data, ev.SessionEnded):
            ended.append(event.tick)

    never = standing_approver("never")
    station = rig.station(ScriptedEngine([plan(("Drone_T04", "report"))]))
    await run_missions(station, [MISSION], never, sink, duration_s=20.0, decided=lambda: decided)
    [tick] = ended
    assert (tick * station.world.dt_s < 20.0) == decided
