"""A log is found again at any of its events, whatever has become of the index that was kept."""

import os
import shutil
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.schema.events import event as ev
from pa_console.schema.finding import Finding
from pa_console.schema.incident import FailAsset, RestoreAsset, SpawnTrack
from pa_console.schema.mission import Alarm, Decision, DecisionKind, Mission
from pa_console.session.log.chain import LogError
from pa_console.session.recording import Player, Recording
from pa_console.session.state import SessionState
from pa_console.session.timeline import mark_of
from tests.schema.strategies import events
from tests.session.logs import folded, kept, write_log
from tests.session.story import PLAN, START, at, story, telemetry
from tests.session.tamper import write_signed


def long_story(missions: int = 6) -> list[ev.Event]:
    """Several missions one after the other, some events of which come after their end."""
    happened: list[ev.Event] = []
    for number in range(missions):
        name = f"M{number}"
        for event in story()[:-1]:
            data = event.data
            if isinstance(data, ev.MissionReceived):
                mission = Mission(id=name, text=f"mission {number}", created=START)
                data = ev.MissionReceived(mission=mission, position=0)
            moved = event.model_copy(
                update={
                    "t": event.t + timedelta(seconds=10 * number),
                    "tick": event.tick + 100 * number,
                    "mission": name if event.mission else None,
                    "data": data,
                }
            )
            happened.append(moved)
        happened.append(at(10.0 * number, ev.MissionReported(text="later"), "M0"))
    return kept(happened)


def write(path: Path, happened: list[ev.Event]) -> Path:
    return write_signed(path, events=happened)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("log") / "s.jsonl", long_story())


@given(st.lists(st.integers(0, len(long_story())), min_size=1, max_size=6), st.integers(1, 40))
@settings(max_examples=40, deadline=None)
def test_whatever_is_between_keyframes_a_seek_equals_folding_from_the_start(
    log: Path, targets: list[int], frame_events: int
) -> None:
    happened = long_story()
    player = Player(Recording.read(log, frame_events=frame_events))
    for target in targets:
        player.to_event(target - 1)
        assert player.index == target
        assert player.state == folded(happened[:target])
        assert player.state.current == folded(happened[:target]).current


@given(st.lists(events(), min_size=1, max_size=12), st.data())
@settings(max_examples=25, deadline=None)
def test_any_events_come_back_from_keyframes_as_they_were_folded(
    tmp_path_factory: pytest.TempPathFactory, happened: list[ev.Event], data: st.DataObject
) -> None:
    path = write_log(tmp_path_factory.mktemp("log") / "any.jsonl", happened)
    if not (logged := kept(happened)):
        return
    player = Player(Recording.read(path, frame_events=1))
    target = data.draw(st.integers(0, len(logged)))
    player.to_event(target - 1)
    assert player.state == folded(logged[:target])


def test_whoever_seeks_past_a_relief_sees_a_station_that_is_relieved(tmp_path: Path) -> None:
    relieved = "station 2 has command"
    happened = [at(0.0, ev.AuthorityChanged(refusal=relieved)), *long_story(1)]
    player = Player(Recording.read(write(tmp_path / "s.jsonl", happened), frame_events=1))
    player.seek(player.duration)
    assert player.state.relieved == relieved


def test_whoever_seeks_past_a_relief_sees_the_waiting_plan_blocked(tmp_path: Path) -> None:
    happened = long_story(1)
    asked = [event.data.kind for event in happened].index("approval_requested") + 1
    relief = at(20.0, ev.AuthorityChanged(refusal="station 2 has command"))
    noise = ev.Noticed(level="info", subject="x", text="so long that a keyframe follows" * 300)
    around = [at(10.0, noise)] * 2, [at(30.0, noise)] * 3
    told = [*happened[:asked], *around[0], relief, *around[1]]
    player = Player(Recording.read(write(tmp_path / "s.jsonl", told), frame_events=1))
    player.seek(player.duration)
    current = player.state.current
    assert current is not None
    assert current.approval is not None
    assert "station 2 has command" in current.approval.blocked_by
    assert player.state == folded(kept(told))


def test_a_kept_index_serves_until_the_log_changes_or_it_is_damaged(
    log: Path, tmp_path: Path
) -> None:
    path = tmp_path / "s.jsonl"
    shutil.copy(log, path)
    cache = tmp_path / "cache"
    read: list[int] = []

    def opened() -> Player:
        read.clear()
        recording = Recording.read(
            path, lambda done, _total: read.append(done), cache=cache, cached_from=0,
            frame_events=8,
        )  # fmt: skip
        player = Player(recording)
        player.seek(player.duration / 2)
        assert player.state == folded(long_story()[: player.index])
        return player

    opened()
    [kept] = cache.iterdir()
    assert read
    opened()
    assert not read, "the index was there"
    content = kept.read_bytes()
    for damaged in (content[:-1], b"", b"{}\n", content[:-9] + b"x" + content[-8:], b"\xff" * 90):
        kept.write_bytes(damaged)
        opened()
        assert read, "a damaged index is made again"
    os.utime(path, ns=(1, 1))
    opened()
    assert read, "the log has other times than the index knows"
    with path.open("ab") as file:
        file.write(b"rubbish\n")
    assert opened().recording.problem is not None
    assert read
    assert opened().recording.problem is not None
    assert not read, "what is wrong with the log is known without reading it"


def test_a_log_is_replayed_where_nothing_can_be_written(log: Path, tmp_path: Path) -> None:
    nowhere = tmp_path / "file"
    nowhere.write_text("no folder")
    player = Player(Recording.read(log, cache=nowhere, cached_from=0))
    player.seek(player.duration)
    assert player.state == folded(long_story())


def test_a_log_that_is_edited_while_it_is_open_is_told(log: Path, tmp_path: Path) -> None:
    path = tmp_path / "s.jsonl"
    shutil.copy(log, path)
    player = Player(Recording.read(path))
    path.write_bytes(b"x" * path.stat().st_size)
    with pytest.raises(LogError, match="has changed since the log was opened"):
        player.seek(player.duration)
    assert (player.index, player.state) == (0, SessionState())


def test_what_does_not_change_any_more_stays_on_the_disk_between_seeks(log: Path) -> None:
    player = Player(Recording.read(log, frame_events=8))
    player.seek(player.duration)
    loaded = getattr(player.state.missions, "_loaded")  # noqa: B009 - what is in memory
    assert len(player.state.missions) == 6
    assert len(loaded) < 6


def test_a_line_of_telemetry_that_cannot_be_read_ends_the_recording(
    log: Path, tmp_path: Path
) -> None:
    path, lines = tmp_path / "s.jsonl", log.read_bytes().splitlines(keepends=True)
    number = next(n for n, line in enumerate(lines) if b'"kind":"telemetry"' in line)
    changes: tuple[Callable[[bytes], bytes], ...] = (
        lambda line: line.replace(b'"gates":', b'"gaets":'),
        lambda line: line.replace(b'"time_s":', b'"time_s":-'),
        lambda line: line.replace(b'"covered":', b'"covered":"x'),
        lambda line: line[:60] + b"\n",
    )
    for change in changes:
        path.write_bytes(b"".join([*lines[:number], change(lines[number]), *lines[number + 1 :]]))
        recording = Recording.read(path)
        assert recording.problem is not None
        assert recording.problem.line == number + 1


def decided(kind: DecisionKind, **fields: object) -> ev.DecisionMade:
    given = Decision.model_validate({"kind": kind, **fields})
    return ev.DecisionMade(attempt=1, decision=given, accepted=True)


@pytest.mark.parametrize(
    ("data", "kind"),
    [
        (ev.IncidentHappened(incident=FailAsset(asset="Uav_1")), "fault"),
        (ev.IncidentHappened(incident=RestoreAsset(asset="Uav_1")), None),
        (ev.IncidentHappened(incident=SpawnTrack(gate="GateA")), None),
        (ev.AllStopped(by="operator"), "fault"),
        (ev.PlanHalted(attempt=1, reasons=("x",)), "fault"),
        (ev.WorkerChanged(state="dead"), "fault"),
        (ev.WorkerChanged(state="ready"), None),
        (ev.ApprovalRequested(attempt=1, plan=PLAN, blocked_by=("WF-03",)), "refusal"),
        (ev.ApprovalRequested(attempt=1, plan=PLAN), None),
        (ev.DecisionMade(attempt=1, decision=Decision(kind="reject"), accepted=True), "refusal"),
        (ev.DecisionMade(attempt=1, decision=Decision(kind="approve"), accepted=False), "refusal"),
        (ev.DecisionMade(attempt=1, decision=Decision(kind="approve"), accepted=True), None),
        (decided("modify", plan=PLAN), "finding"),
        (decided("approve", override_judge=True, reason="seen by eye"), "finding"),
        (decided("approve", acknowledged=("WF-05",)), "finding"),
        (ev.PlanJudged(attempt=1, verdict=None, error="late"), "finding"),
        (telemetry(1.0).data, None),
    ],
)  # fmt: skip
def test_what_is_worth_a_jump_is_marked(data: ev.EventPayload, kind: str | None) -> None:
    assert mark_of(at(1.0, data), SessionState()) == kind


def test_findings_are_marked_if_one_is_broken_and_alarms_once() -> None:
    def checked(status: str) -> ev.Event:
        finding = Finding.model_validate({"rule_id": "R", "priority": "high", "status": status})
        return at(1.0, ev.PlanChecked(attempt=1, findings=(finding,), seconds=0.1))

    assert mark_of(checked("violates"), SessionState()) == "finding"
    assert mark_of(checked("complies"), SessionState()) is None
    alarm = Alarm(
        id="a", kind="asset_failed", priority="medium", subject="Uav_1", text="x", raised_s=1.0
    )
    raised = at(1.0, ev.AlarmRaised(alarm=alarm))
    assert mark_of(raised, SessionState()) == "alarm"
    assert mark_of(raised, folded([raised])) is None
    worse = at(2.0, ev.AlarmRaised(alarm=alarm.model_copy(update={"priority": "high"})))
    assert mark_of(worse, folded([raised])) == "alarm"
