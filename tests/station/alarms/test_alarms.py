"""Alarms: raised once for one cause, with the mission that answers it, and quiet under noise."""

from collections.abc import Iterable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.resources import find_data
from pa_console.schema.base import ALARM_PRIORITIES
from pa_console.schema.events.event import AlarmCleared, AlarmRaised
from pa_console.schema.mission import Alarm
from pa_console.schema.telemetry import AssetTelemetry, CameraReport, GateCover, Picture, Track
from pa_console.sim.worlds.world_file import load_world
from pa_console.station.alarms.alarm_book import (
    MOST_ALIKE,
    MOST_IDS,
    MOST_MINOR,
    AlarmBook,
    AlarmChange,
)
from tests.mission.pictures import GATES, asset, track

WORLD = load_world(find_data("worlds", "checkpoint", "world.yaml"))
TEAM = {
    "NorthGate": asset("Drone_T02", "uav", "NorthGate"),
    "EastGate": asset("Ugv_T01", "ugv", "EastGate"),
    "SouthGate": asset("Drone_T03", "uav", "SouthGate"),
    "WestGate": asset("Drone_T01", "uav", "WestGate"),
    "spare": asset("Drone_T04", "uav", "Checkpoint"),
}


def scene(
    time_s: float,
    *tracks: Track,
    cameras: dict[str, CameraReport] | None = None,
    **changes: dict[str, Any],
) -> Picture:
    """Return the home team at `time_s`, with `changes` to the asset of a gate or the spare."""
    team: list[AssetTelemetry] = []
    for place, member in TEAM.items():
        update = {"stamp_s": time_s} | changes.get(place, {})
        team.append(member.model_copy(update=update))
    gates: dict[str, GateCover] = {}
    for gate in GATES:
        here = [a for a in team if a.at == a.post == gate]
        by = tuple(a.id for a in here if a.available)
        unsure = tuple(a.id for a in here if not a.available and a.status != "failed")
        gates[gate] = GateCover(covered=bool(by), by=by, unsure=unsure)
    return Picture(
        tick=round(time_s * 10), time_s=time_s, assets={a.id: a for a in team},
        tracks={t.id: t for t in tracks}, gates=gates, cameras=cameras or {},
    )  # fmt: skip


def play(book: AlarmBook, scenes: Iterable[Picture]) -> list[AlarmChange]:
    return [change for picture in scenes for change in book.look(picture)]


def every(seconds: float, *tracks: Track, start: float = 0.0, **changes: Any) -> list[Picture]:
    """Return the same scene for so long, two pictures a second."""
    steps = range(round(seconds * 2) + 1)
    return [scene(start + step / 2, *tracks, **changes) for step in steps]


def raised(changes: Iterable[AlarmChange]) -> list[Alarm]:
    return [change.alarm for change in changes if isinstance(change, AlarmRaised)]


FAILED: dict[str, Any] = {"status": "failed", "available": False}
SILENT: dict[str, Any] = {"comms": "lost", "available": False, "stale": True, "stamp_s": 0.0}
LOW: dict[str, Any] = {"low_battery": True, "battery_pct": 20.0}


def test_a_quiet_site_raises_nothing() -> None:
    assert play(AlarmBook(WORLD), every(60)) == []


def test_an_unknown_vehicle_raises_one_alarm_with_its_mission() -> None:
    book = AlarmBook(WORLD)
    [alarm] = raised(play(book, every(30, track("Track_01", "WestGate"))))
    assert (alarm.id, alarm.kind, alarm.priority) == ("A001", "unknown_track", "high")
    assert (alarm.subject, alarm.gate, alarm.distance_m) == ("Track_01", "WestGate", 40.0)
    assert alarm.command == "An unknown vehicle is approaching WestGate."
    assert book.open == (alarm,)


@pytest.mark.parametrize(
    "changes",
    [
        {"identity": "authorized"},
        {"identity": "authorized", "intent": "benign"},
        {"status": "leaving"},
    ],
)
def test_a_harmless_track_raises_no_alarm(changes: dict[str, str]) -> None:
    assert play(AlarmBook(WORLD), every(20, track("T1", "EastGate", **changes))) == []


@pytest.mark.parametrize("identity", ["unknown", "unauthorized"])
def test_a_benign_intent_makes_an_alarm_less_urgent_but_does_not_let_a_vehicle_in(
    identity: str,
) -> None:
    seen = track("T1", "EastGate", identity=identity, intent="benign")
    [alarm] = raised(play(AlarmBook(WORLD), every(5, seen)))
    assert (alarm.priority, bool(alarm.command)) == ("medium", True)


@pytest.mark.parametrize(
    ("changes", "kind", "command"),
    [
        ({"intent": "hostile"}, "hostile_track", "A hostile vehicle is approaching EastGate."),
        (
            {"intent": "hostile", "warned": True, "status": "stopped"},
            "hostile_track",
            "A hostile vehicle has stopped at EastGate. Block it.",
        ),
        (
            {"defiant": True, "warned": True, "identity": "unauthorized"},
            "defiant_track",
            "An unauthorized vehicle is approaching EastGate in spite of a warning."
            " Observe it and keep the gate covered.",
        ),
        (
            {"intent": "hostile", "noncombatants": True},
            "hostile_track",
            "A hostile vehicle is approaching EastGate."
            " Noncombatants are suspected: only observe and report.",
        ),
    ],
)
def test_a_threat_is_an_emergency_at_once(changes: dict[str, Any], kind: str, command: str) -> None:
    [alarm] = raised(AlarmBook(WORLD).look(scene(0.0, track("T1", "EastGate", **changes))))
    assert (alarm.kind, alarm.priority, alarm.command) == (kind, "emergency", command)


def test_an_identified_vehicle_keeps_its_alarm_and_asks_for_a_warning_until_it_has_one() -> None:
    book = AlarmBook(WORLD)
    play(book, every(5, track("T1", "EastGate")))
    [known] = raised(
        play(book, every(5, track("T1", "EastGate", identity="unauthorized"), start=6))
    )
    assert (known.id, known.kind) == ("A001", "unauthorized_track")
    assert known.command == "An unauthorized vehicle is approaching EastGate. Warn it to turn back."
    warned = track("T1", "EastGate", identity="unauthorized", warned=True, status="stopped")
    assert play(book, every(30, warned, start=12)) == []


def test_a_track_that_turns_hostile_supersedes_its_alarm() -> None:
    book = AlarmBook(WORLD)
    play(book, every(5, track("T1", "EastGate")))
    hostile = track("T1", "EastGate", intent="hostile")
    cleared, new = book.look(scene(6.0, hostile))
    assert cleared == AlarmCleared(alarm_id="A001", reason="superseded by A002")
    assert isinstance(new, AlarmRaised)
    assert (new.alarm.id, new.alarm.priority) == ("A002", "emergency")
    assert play(book, every(30, hostile, start=6.5)) == []


def test_a_flickering_track_is_one_alarm_and_a_lost_one_clears_it() -> None:
    book = AlarmBook(WORLD)
    seen = track("T1", "WestGate")
    flicker = [scene(step / 2, *([seen] if step % 3 else [])) for step in range(120)]
    assert [alarm.id for alarm in raised(play(book, flicker))] == ["A001"]
    [gone] = play(book, every(20, start=60))
    assert gone == AlarmCleared(
        alarm_id="A001", reason="the track is gone, leaves or is known to be harmless"
    )
    [back] = raised(play(book, every(5, seen, start=90)))
    assert back.id == "A001"


def test_a_single_false_detection_raises_nothing() -> None:
    book = AlarmBook(WORLD)
    scenes = [scene(s / 2, *([track("T1", "WestGate")] if s % 20 == 5 else [])) for s in range(100)]
    assert play(book, scenes) == []


def test_a_failed_sole_cover_gives_one_response_that_names_it() -> None:
    book = AlarmBook(WORLD)
    play(book, every(2))
    alarms = raised(play(book, every(30, start=3, WestGate=FAILED)))
    assert {a.kind: (a.priority, a.subject, a.command) for a in alarms} == {
        "asset_failed": ("high", "Drone_T01", ""),
        "coverage_lost": (
            "emergency",
            "WestGate",
            "Drone_T01 has failed: fill the gap at WestGate.",
        ),
    }
    cleared = play(book, every(10, start=40))
    assert [change.kind for change in cleared] == ["alarm_cleared"] * 2
    assert book.open == ()


def test_a_failed_spare_needs_only_an_eye() -> None:
    [alarm] = raised(play(AlarmBook(WORLD), every(20, spare=FAILED)))
    assert (alarm.kind, alarm.priority, alarm.command) == ("asset_failed", "medium", "")


def test_a_hand_over_within_half_the_grace_raises_nothing() -> None:
    book = AlarmBook(WORLD)
    away: dict[str, Any] = {"at": None, "post": "NorthGate"}
    changes = play(book, [*every(3), *every(8, start=4, WestGate=away), *every(9, start=13)])
    assert changes == []
    [alarm] = raised(play(book, every(30, start=30, WestGate=away)))
    assert alarm.command == "WestGate has no guard: fill the gap at WestGate."


def test_a_silent_guard_leaves_its_gate_unknown() -> None:
    book = AlarmBook(WORLD)
    play(book, every(2))
    alarms = raised(play(book, every(20, start=7, WestGate=SILENT)))
    assert [(a.kind, a.priority, a.subject, bool(a.command)) for a in alarms] == [
        ("link_lost", "high", "Drone_T01", False),
        ("coverage_unknown", "high", "WestGate", True),
    ]
    assert "Drone_T01 silent for" in alarms[1].text


@pytest.mark.parametrize(
    ("place", "priority", "command"),
    [
        (
            "NorthGate",
            "medium",
            "Drone_T02 has a low battery, so NorthGate needs a second guard: "
            "send one asset to NorthGate.",
        ),
        ("spare", "low", "Drone_T04 has a low battery and must return to base."),
    ],
)
def test_a_low_battery_asks_for_a_return_and_a_guard_for_a_replacement(
    place: str, priority: str, command: str
) -> None:
    book = AlarmBook(WORLD)
    low: dict[str, Any] = {place: LOW}
    home: dict[str, Any] = {place: LOW | {"task": "returning"}}
    [alarm] = raised(play(book, every(20, **low)))
    assert (alarm.priority, alarm.command) == (priority, command)
    [cleared] = play(book, every(20, start=30, **home))
    assert cleared.kind == "alarm_cleared"


@given(st.lists(st.floats(23.0, 27.0), min_size=20, max_size=60))
def test_a_battery_that_flickers_around_its_limit_raises_at_most_once(levels: list[float]) -> None:
    book = AlarmBook(WORLD)
    scenes = [
        scene(step / 2, spare={"battery_pct": level, "low_battery": level < 25.0})
        for step, level in enumerate(levels)
    ]
    assert len(play(book, scenes)) <= 1


def test_suspect_telemetry_and_a_dead_camera_need_an_eye() -> None:
    suspect: dict[str, Any] = {"integrity": "suspect", "available": False}
    camera = {"NorthCam": CameraReport(gate="NorthGate", works=False, stamp_s=0.0)}
    alarms = raised(play(AlarmBook(WORLD), every(5, spare=suspect, cameras=camera)))
    assert [(a.kind, a.priority, a.subject, a.command) for a in alarms] == [
        ("camera_lost", "low", "NorthCam", ""),
        ("suspect_telemetry", "medium", "Drone_T04", ""),
    ]


def test_two_alarms_in_one_tick_come_in_a_fixed_order_whatever_the_order_of_the_picture() -> None:
    far = track("T1", "NorthGate", intent="hostile", distance_m=80.0)
    near = track("T2", "WestGate", intent="hostile", distance_m=20.0)
    for tracks in ((far, near), (near, far)):
        alarms = raised(AlarmBook(WORLD).look(scene(0.0, *tracks)))
        assert [(a.id, a.subject) for a in alarms] == [("A001", "T2"), ("A002", "T1")]


def test_the_open_alarms_follow_their_tracks() -> None:
    book = AlarmBook(WORLD)
    both = (track("T1", "NorthGate", distance_m=30.0), track("T2", "EastGate", distance_m=50.0))
    play(book, every(3, *both))
    assert [alarm.subject for alarm in book.open] == ["T1", "T2"]
    play(book, every(3, both[0], both[1].model_copy(update={"distance_m": 10.0}), start=4))
    assert [alarm.subject for alarm in book.open] == ["T2", "T1"]


def test_acknowledging_is_for_open_alarms_only() -> None:
    book = AlarmBook(WORLD)
    with pytest.raises(ValueError, match="open: none"):
        book.acknowledge("A001", "operator")
    play(book, every(3, track("T1", "NorthGate")))
    assert book.acknowledge("A001", "operator").alarm_id == "A001"
    assert book.acknowledged == {"A001"}


def test_a_thousand_silent_assets_do_not_flood_the_operator() -> None:
    book = AlarmBook(WORLD)
    crowd = {f"Drone_{n}": asset(f"Drone_{n}", "uav", "Checkpoint", **SILENT) for n in range(1000)}
    picture = scene(10.0)
    alarms = raised(book.look(picture.model_copy(update={"assets": picture.assets | crowd})))
    assert len(alarms) == MOST_MINOR


def crowd(number: int, *sensors: str, first: int = 1, **changes: Any) -> list[Track]:
    """Return tracks that the same sensors report."""
    names = (f"T{first + n:03d}" for n in range(number))
    return [track(name, "EastGate", seen_by=sensors, **changes) for name in names]


def test_a_crowd_of_one_sensor_is_some_alarms_and_one_that_counts_the_rest() -> None:
    book = AlarmBook(WORLD)
    lies = crowd(30, "Drone_T03")
    alarms = raised(play(book, every(3, *lies)))
    assert len([a for a in alarms if a.kind == "unknown_track"]) == MOST_ALIKE
    (summary,) = (a for a in alarms if a.kind == "many_contacts")
    assert (summary.subject, summary.priority, summary.command) == ("Drone_T03", "high", "")
    assert summary.text == (
        f"Drone_T03 alone reports 30 contacts that need a response: {MOST_ALIKE} have an alarm "
        "each, the rest is set aside"
    )
    true = track("T900", "NorthGate", seen_by=("NorthCamera",), distance_m=80.0)
    (alarm,) = raised(play(book, every(3, true, *lies, start=4)))
    assert alarm.subject == "T900"
    few = play(book, every(10, true, *lies[:MOST_ALIKE], start=8))
    gone = [change.alarm_id for change in few if isinstance(change, AlarmCleared)]
    assert summary.id in gone
    assert raised(few) == []


def test_what_gets_worse_counts_where_it_then_belongs() -> None:
    """No order of growing worse opens more alarms of a kind than one sensor is given."""
    book, worse = AlarmBook(WORLD), list[Track]()
    steps: tuple[dict[str, Any], ...] = (
        {"intent": "benign"}, {}, {"identity": "unauthorized"}, {"defiant": True},
    )  # fmt: skip
    for number in range(20):
        crowds = zip(steps, range(1, 200, 40), strict=False)
        worse = [
            each
            for changes, first in crowds
            for each in crowd(number, "Drone_T03", first=first + number % 3, **changes)
        ]
        play(book, every(2, *worse, start=3.0 * number))
        urgent = [a.kind for a in book.open if a.priority in ("emergency", "high")]
        assert max(urgent.count(kind) for kind in {*urgent, "many_contacts"}) <= MOST_ALIKE
    assert {"unknown_track", "unauthorized_track", "defiant_track"} <= {a.kind for a in book.open}


def test_contacts_come_and_go_for_ever_and_no_two_share_an_id() -> None:
    book, ids = AlarmBook(WORLD), list[str]()
    subjects = [f"T{number}" for number in range(MOST_IDS + 200)]
    for number, name in enumerate((*subjects, subjects[-1])):
        here = track(name, "EastGate", intent="hostile", hostile_by=("A", "B"))
        (alarm,) = raised(book.look(scene(20.0 * number, here)))
        ids.append(alarm.id)
        book.look(scene(20.0 * number + 10.0))
        assert book.open == ()
    assert len(set(ids)) == len(subjects)
    assert ids[-1] == ids[-2], "one that comes back is the same alarm"


changes_of_an_asset = st.sampled_from(
    [{}, FAILED, SILENT, LOW, {"integrity": "suspect", "available": False}, {"task": "returning"}]
)
tracks = st.lists(
    st.builds(
        track,
        name=st.sampled_from(["T1", "T2"]),
        gate=st.sampled_from(GATES),
        identity=st.sampled_from(["unknown", "authorized", "unauthorized"]),
        intent=st.sampled_from(["unknown", "benign", "hostile"]),
        status=st.sampled_from(["approaching", "stopped", "leaving"]),
        defiant=st.booleans(),
        distance_m=st.floats(0.0, 90.0),
    ),
    unique_by=lambda t: t.id,
    max_size=2,
)
moments = st.lists(
    st.tuples(tracks, st.dictionaries(st.sampled_from([*GATES, "spare"]), changes_of_an_asset)),
    max_size=25,
)


@given(moments)
def test_whatever_happens_the_book_and_its_events_agree(
    story: list[tuple[list[Track], dict[str, dict[str, Any]]]],
) -> None:
    book, twin = AlarmBook(WORLD), AlarmBook(WORLD)
    open_now: dict[str, Alarm] = {}
    for step, (seen, changes) in enumerate(story):
        picture = scene(step / 2, *seen, **changes)
        events = book.look(picture)
        assert twin.look(picture) == events
        for event in events:
            if isinstance(event, AlarmCleared):
                del open_now[event.alarm_id]
            else:
                open_now[event.alarm.id] = event.alarm
        assert {alarm.id for alarm in book.open} == set(open_now)
        ranks = [ALARM_PRIORITIES.index(alarm.priority) for alarm in book.open]
        assert ranks == sorted(ranks)


BLOCKS: dict[str, Any] = {"task": "blocking"}


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"identity": "authorized"}, "an authorized vehicle waits at EastGate, which Ugv_T01"),
        ({"emergency": True}, "an emergency vehicle waits at EastGate, which Ugv_T01 blocks"),
        ({"identity": "authorized", "status": "leaving"}, ""),
        ({"identity": "unauthorized", "intent": "hostile"}, ""),
    ],
)
def test_a_block_that_holds_up_whom_it_must_not_is_an_alarm(
    changes: dict[str, Any], text: str
) -> None:
    """The block may be older than the vehicle: no plan runs any more that could be halted."""
    book, seen = AlarmBook(WORLD), track("T1", "EastGate", **changes)
    ways = [a for a in raised(play(book, every(5, seen, EastGate=BLOCKS))) if "block" in a.kind]
    assert [(a.kind, a.priority, a.command) for a in ways] == [("way_blocked", "high", "")] * bool(
        text
    )
    assert all(text in alarm.text for alarm in ways)
    cleared = [c.alarm_id for c in play(book, every(9, seen, start=6)) if c.kind == "alarm_cleared"]
    assert {alarm.id for alarm in ways} <= {*cleared}


@pytest.mark.parametrize(
    ("changes", "gates", "shut"),
    [
        ({"kind": "person"}, ("EastGate", "WestGate"), True),
        ({"noncombatants": True}, ("EastGate", "WestGate"), True),
        ({"kind": "person"}, ("EastGate",), False),
        ({"intent": "hostile", "identity": "unauthorized"}, ("EastGate", "WestGate"), False),
    ],
)
def test_somebody_shut_in_is_an_alarm(
    changes: dict[str, Any], gates: tuple[str, ...], shut: bool
) -> None:
    inside = track("T1", "NorthGate", status="inside", **changes)
    blocking = dict.fromkeys(gates, BLOCKS)
    alarms = raised(play(AlarmBook(WORLD), [scene(t / 2, inside, **blocking) for t in range(11)]))
    texts = [alarm.text for alarm in alarms if alarm.kind == "way_blocked"]
    assert bool(texts) == shut
    assert all("is shut in: EastGate, WestGate are blocked" in text for text in texts)
