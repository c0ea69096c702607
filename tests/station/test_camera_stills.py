"""Stills of tracks while a plan waits: kept and logged, and without any effect on the plan."""

import hashlib
from collections.abc import Sequence
from contextlib import aclosing
from pathlib import Path

import pytest

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.schema.events import event as ev
from pa_console.schema.incident import Incident, SensorFault
from pa_console.schema.plan import Plan
from pa_console.session.state import SessionState
from pa_console.session.stills import read_still, stills_folder
from pa_console.station import camera_stills
from pa_console.station.assembly import Site, open_station
from pa_console.station.clock import SteppedClock
from tests.fleets.test_snapshot import camera, hangs
from tests.scripted import ScriptedEngine, plan
from tests.stills import CAMERA, VEHICLE

LOOK = plan(("Drone_T04", "observe NorthGate"))


class Watched:
    """A mission at the north gate whose plan waits until `enough` stills were told of."""

    def __init__(self, site: Site, log: Path, enough: int = 1) -> None:
        self.site, self.log, self.enough = site, log, enough
        self.engine = ScriptedEngine([LOOK])
        self.seen: list[ev.Event] = []

    async def run(
        self, setup: Sequence[Incident], url: str | None = None, *, taken: bool = True
    ) -> SessionState:
        """Run the mission; `url` is the north camera's address."""
        world = self.site.world
        if url is not None:
            pytest.importorskip("httpx2", reason="cameras with addresses need the extra `camera`")
            cameras = dict(world.cameras)
            cameras[CAMERA] = cameras[CAMERA].model_copy(update={"snapshot": url})
            world = world.model_copy(update={"cameras": cameras})
        fleet = SimulatedFleet.start(world, 7)
        station = open_station(self.site, self.engine.engine(), SteppedClock(), fleet=fleet)
        if taken:
            station.take_stills(self.log)
        asked: ev.ApprovalRequested | None = None
        state = SessionState()
        async with aclosing(station.run()) as events:
            async for event in events:
                self.seen.append(event)
                state.apply(event)
                match event.data:
                    case ev.TelemetryReceived() if len(self.seen) < 3:
                        for incident in setup:
                            station.inject(incident)
                        await station.advance(6.0)
                        station.submit("Look at the north gate.")
                    case ev.ApprovalRequested():
                        asked = event.data
                    case ev.MissionFinished():
                        await station.close("over")
                    case _:
                        pass
                if asked is not None and (not taken or len(self.stills) >= self.enough):
                    station.decide(asked.approved())
                    asked = None
        return state

    @property
    def stills(self) -> list[ev.CameraStill]:
        """The stills that were told of."""
        return [event.data for event in self.seen if isinstance(event.data, ev.CameraStill)]

    @property
    def plans(self) -> list[Plan | None]:
        """The plans that were proposed."""
        told = (event.data for event in self.seen)
        return [data.plan for data in told if isinstance(data, ev.PlanProposed)]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """The log beside which stills are kept."""
    return tmp_path / "session.jsonl"


async def test_it_is_kept_beside_the_log_with_its_hash_in_an_event(site: Site, log: Path) -> None:
    watched = Watched(site, log)
    state = await watched.run([VEHICLE])
    (still,) = watched.stills
    content = (stills_folder(log) / still.file_name).read_bytes()
    assert (still.camera, still.track, still.problem) == (CAMERA, "Track_01", "")
    assert hashlib.sha256(content).hexdigest() == still.sha256
    assert read_still(log, still) == content
    kinds = [event.data.kind for event in watched.seen]
    asked, told = kinds.index("approval_requested"), kinds.index("camera_still")
    assert asked < told < kinds.index("decision_made")
    (trace,) = state.missions.values()
    assert trace.stills == {1: still}


async def test_no_plan_is_another_one_for_it(site: Site, log: Path) -> None:
    without, with_one = Watched(site, log), Watched(site, log)
    await without.run([VEHICLE], taken=False)
    await with_one.run([VEHICLE])
    assert with_one.stills
    asked = [
        [(each.system, each.user) for each in watched.engine.requests]
        for watched in (without, with_one)
    ]
    assert asked[0] == asked[1]
    assert without.plans == with_one.plans != []


async def test_it_is_taken_again_while_the_plan_waits(
    site: Site, log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(camera_stills, "RETAKE_S", 0.0)
    monkeypatch.setattr(camera_stills, "MOST_TAKEN", 3)
    watched = Watched(site, log, enough=3)
    await watched.run([VEHICLE])
    assert len(watched.stills) == 3


@pytest.mark.parametrize("setup", [[], [VEHICLE, SensorFault(sensor=CAMERA)]])
async def test_where_no_camera_sees_a_track_there_is_none(
    site: Site, log: Path, setup: list[Incident]
) -> None:
    watched = Watched(site, log, enough=0)
    await watched.run(setup)
    assert not watched.stills
    assert not stills_folder(log).exists()


async def test_a_camera_that_does_not_answer_holds_nothing_up(site: Site, log: Path) -> None:
    watched = Watched(site, log, enough=0)
    async with camera(hangs) as url:
        state = await watched.run([VEHICLE], url)
    assert not watched.stills
    (trace,) = state.missions.values()
    assert trace.commands
    assert state.ended == "over"


async def test_what_goes_wrong_is_told_once_in_the_event_list(
    site: Site, log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(camera_stills, "RETAKE_S", 0.0)
    watched = Watched(site, log, enough=2)
    state = await watched.run([VEHICLE], "http://127.0.0.1:1/snapshot.jpg")
    assert {still.problem for still in watched.stills} == {"cannot be reached (ConnectError)"}
    lines = [notice.text for notice in state.notices if notice.subject == CAMERA]
    assert lines == ["no still of Track_01: cannot be reached (ConnectError)"]


async def test_a_picture_that_cannot_be_kept_is_not_shown(site: Site, log: Path) -> None:
    stills_folder(log).write_text("in the way")
    watched = Watched(site, log)
    await watched.run([VEHICLE])
    assert watched.stills[0].sha256 is None
    assert "cannot be stored" in watched.stills[0].problem


async def test_a_defect_of_the_drawing_does_not_end_the_session(
    site: Site, log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> bytes:
        raise ZeroDivisionError

    def still(*_: object) -> object:
        return broken

    monkeypatch.setattr(SimulatedFleet, "still", still)
    watched = Watched(site, log)
    state = await watched.run([VEHICLE])
    assert watched.stills[0].problem == "its still cannot be made: ZeroDivisionError"
    assert state.ended == "over"
