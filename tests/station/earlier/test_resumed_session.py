"""A session whose console was killed goes on: world, queue and alarms; nothing moves by that."""

import asyncio
import shutil
from collections.abc import Callable
from contextlib import aclosing
from pathlib import Path

import pytest

from pa_console.evaluation.twin import resimulate
from pa_console.mission.approval import standing_approver
from pa_console.policy.moments import Pursuits
from pa_console.policy.monitor import Monitor
from pa_console.schema.events import event as ev
from pa_console.schema.incident import SpawnTrack
from pa_console.schema.rehearsal import Moment, OrderMoment, TrackMoment
from pa_console.session.log.chain import read_log
from pa_console.session.log.verification import verify
from pa_console.session.log.writer import LogWriter
from pa_console.signing import KEY_VARIABLE, load_signer
from pa_console.station.assembly import Site, open_station
from pa_console.station.clock import SteppedClock
from pa_console.station.earlier.unclosed_session import (
    NotResumableError,
    UnclosedSession,
    find_unclosed,
    resume,
)
from pa_console.station.station import ControlStation
from tests.scripted import ScriptedEngine, plan
from tests.station.test_living import FILL, vehicle

SEND, AGAIN = "Move the drone to the east gate.", "Move the drone to the south gate."
SOUTH = plan(("Drone_T04", "move_to SouthGate"))
Step = Callable[[ev.Event, ControlStation], bool]


@pytest.fixture(autouse=True)
def _own_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:  # pyright: ignore[reportUnusedFunction]
    monkeypatch.setenv(KEY_VARIABLE, str(tmp_path / "key" / "key.pem"))


async def until(station: ControlStation, log: Path, step: Step) -> list[ev.Event]:
    """Run the station with its log until `step` says so; return what happened meanwhile."""
    happened: list[ev.Event] = []
    with LogWriter(log, station.session, signer=load_signer()) as writer:
        station.write_to(writer)
        async with aclosing(station.run()) as events:
            async for event in events:
                happened.append(event)
                if step(event, station):
                    writer.flush()
                    shutil.copytree(log.parent, log.parent.with_name("killed"))
                    break
        await asyncio.sleep(0)  # what the journal has put off is signed then
    return happened


async def killed(site: Site, tmp_path: Path, step: Step) -> UnclosedSession:
    """Return the session as a console that was killed at `step` has left it."""
    engine = ScriptedEngine([FILL, SOUTH])
    station = open_station(site, engine.engine(), SteppedClock())
    await until(station, tmp_path / "logs" / "a.jsonl", step)
    found = find_unclosed(tmp_path / "killed", site.world_sha256)
    assert found is not None
    return found


def approving(event: ev.Event, station: ControlStation) -> None:
    """Approve what asks for it."""
    if isinstance(event.data, ev.ApprovalRequested):
        station.decide(standing_approver("auto")(event.data))


def under_way(event: ev.Event, station: ControlStation) -> bool:
    """Give two missions and an incident, and stop once that has raised an alarm."""
    if event.data.kind == "session_started":
        station.inject(vehicle())
        station.submit(SEND)
        station.submit(AGAIN)
    approving(event, station)
    return isinstance(event.data, ev.AlarmRaised)


def open_again(site: Site, found: UnclosedSession, engine: ScriptedEngine) -> ControlStation:
    resumed = resume(found, site.world, None)
    return open_station(site, engine.engine(), SteppedClock(), resumed=resumed)


async def test_world_queue_and_alarms_are_as_they_were_and_nothing_is_dispatched(
    site: Site, tmp_path: Path
) -> None:
    found = await killed(site, tmp_path, under_way)
    assert [trace.mission.said for trace in found.interrupted] == [SEND]
    assert AGAIN in [entry.mission.said for entry in found.waiting]
    station = open_again(site, found, ScriptedEngine([SOUTH] * 9))
    happened = await _go_on(station, found.log, lambda e: e.data.kind == "approval_requested")
    kinds = [event.data.kind for event in happened]
    assert kinds[:2] == ["session_resumed", "telemetry"]
    assert "command_sent" not in kinds
    (first,) = found.interrupted
    alarms, told = set(found.state.open_alarms), found.state
    assert alarms
    for event in happened:
        told.apply(event)
    assert told.missions[first.mission.id].status == "held"
    assert set(told.open_alarms) >= alarms
    assert verify(found.log).intact
    whole = list(read_log(found.log))
    assert resimulate(whole, site.world).equal


async def _go_on(
    station: ControlStation, log: Path, done: Callable[[ev.Event], bool]
) -> list[ev.Event]:
    happened: list[ev.Event] = []
    with LogWriter(log, station.session, signer=load_signer()) as writer:
        station.write_to(writer)
        async with aclosing(station.run()) as events:
            async for event in events:
                happened.append(event)
                if done(event):
                    break
        await asyncio.sleep(0)
        await asyncio.sleep(0)  # what the journal has put off is signed then
    return happened


async def test_a_stop_stays_latched_and_the_next_one_is_heeded(site: Site, tmp_path: Path) -> None:
    def stop(event: ev.Event, station: ControlStation) -> bool:
        if event.data.kind == "session_started":
            station.stop_all()
        return isinstance(event.data, ev.CommandReplied)

    found = await killed(site, tmp_path, stop)
    station = open_again(site, found, ScriptedEngine([]))
    assert station.stopped
    again: list[str] = []

    def step(event: ev.Event) -> bool:
        if event.data.kind == "session_resumed":
            station.release()
            station.stop_all()
        if isinstance(event.data, ev.CommandReplied) and event.data.reply.status == "done":
            again.append(event.data.reply.command_id)
        return len(again) == len(site.world.assets)

    await _go_on(station, found.log, step)
    # A killed console may have sent stop2 before its log had it: a vehicle would not heed it twice.
    assert {name.partition(".")[0] for name in again} == {"stop3"}


async def test_a_new_mission_has_an_id_of_its_own(site: Site, tmp_path: Path) -> None:
    found = await killed(site, tmp_path, under_way)
    station = open_again(site, found, ScriptedEngine([SOUTH] * 9))
    given = station.submit(SEND).id
    assert given not in found.state.missions


async def test_a_session_that_was_closed_or_is_of_another_world_is_not_offered(
    site: Site, tmp_path: Path
) -> None:
    found = await killed(site, tmp_path, under_way)
    assert find_unclosed(tmp_path / "logs", site.world_sha256) is None
    assert find_unclosed(found.log.parent, "0" * 64) is None
    assert find_unclosed(tmp_path / "nowhere", site.world_sha256) is None
    with LogWriter(found.log, found.started.session, signer=load_signer()):
        assert find_unclosed(found.log.parent, site.world_sha256) is None, "it is running"


async def test_a_world_that_does_not_come_out_as_it_was_is_refused(
    site: Site, tmp_path: Path
) -> None:
    found = await killed(site, tmp_path, under_way)
    assert found.state.started is not None
    found.state.started = found.state.started.model_copy(update={"seed": 99})
    with pytest.raises(NotResumableError, match="differs from the log"):
        resume(found, site.world, None)


async def test_who_drives_an_asset_by_hand_and_what_awaits_it_go_on(
    site: Site, tmp_path: Path
) -> None:
    def until_it_awaits(event: ev.Event, station: ControlStation) -> bool:
        if event.data.kind == "session_started":
            station.submit("Send Drone_T04 to the south gate.")
        if event.data.kind == "command_sent":
            station.submit("Take over Drone_T04")
        approving(event, station)
        return event.data.kind == "mission_awaits_assets"

    station = open_station(site, ScriptedEngine([SOUTH]).engine(), SteppedClock())
    await until(station, tmp_path / "logs" / "a.jsonl", until_it_awaits)
    found = find_unclosed(tmp_path / "killed", site.world_sha256)
    assert found is not None
    assert found.unfinished
    assert [*found.manual] == [("Drone_T04", "operator")]
    ((mission, assets),) = found.awaiting
    assert (mission.text, assets) == ("Send Drone_T04 to the south gate.", ("Drone_T04",))

    again = open_again(site, found, ScriptedEngine([SOUTH] * 9))
    given = list[str]()

    def gives_back(event: ev.Event) -> bool:
        if event.data.kind == "telemetry" and not given:
            assert isinstance(event.data, ev.TelemetryReceived)
            assert event.data.picture.assets["Drone_T04"].manual
            given.append(again.submit("Give Drone_T04 back").id)
        return event.data.kind == "approval_requested"

    happened = await _go_on(again, found.log, gives_back)
    kinds = [event.data.kind for event in happened]
    assert "command_sent" not in kinds
    assert "manual_control_ended" in kinds
    received = [e.data.mission.text for e in happened if isinstance(e.data, ev.MissionReceived)]
    assert "Send Drone_T04 to the south gate." in received
    assert verify(found.log).intact
    assert resimulate(list(read_log(found.log)), site.world).equal


def a_person(time_s: float, gate: str, track: str) -> Moment:
    """Return a moment in which a drone is on its way to the gate at which a person is."""
    person = TrackMoment(
        gate=gate,
        kind="person",
        identity="unknown",
        intent="unknown",
        status="approaching",
        observed=True,
        warned=False,
    )
    order = OrderMoment(agent="Drone_T04", kind="uav", verb="observe", target=gate)
    return Moment(time_s=time_s, tracks={track: person}, covered={gate: True}, orders=(order,))


async def test_a_person_that_was_followed_before_a_crash_is_not_followed_on_after_it(
    site: Site, tmp_path: Path
) -> None:
    seen = set[str]()

    def sent_after_it(event: ev.Event, station: ControlStation) -> bool:
        if event.data.kind == "session_started":
            person = SpawnTrack(gate="EastGate", track="person", distance_m=30.0, speed_mps=0.5)
            station.inject(person)
            station.submit(SEND)
        approving(event, station)
        seen.add(event.data.kind)
        return "command_sent" in seen and event.data.kind == "telemetry"

    found = await killed(site, tmp_path, sent_after_it)
    picture = found.state.picture
    assert picture is not None
    (track,) = picture.tracks.values()
    assert (track.kind, track.gate) == ("person", "EastGate")
    resumed = resume(found, site.world, None)
    broken = list[set[str]]()
    for pursuits in (Pursuits(), resumed.pursuits):
        monitor = Monitor(site.rulebook, site.world, pursuits=pursuits)
        later = (
            a_person(picture.time_s + 9.0, gate, track.id) for gate in ("SouthGate", "WestGate")
        )
        broken.append({new.rule_id for now in later for new in monitor.observe(now)})
    assert "ROE-14" not in broken[0]
    assert "ROE-14" in broken[1], "the east gate, where it was before the crash, counts"
