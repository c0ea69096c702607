"""Notices: what an operator wants to be told, once, and little of it in noise."""

from collections.abc import Iterable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.schema.events.event import Noticed
from pa_console.schema.telemetry import CameraReport, GateCover, Picture
from pa_console.station.notices import GONE_S, Noticer
from tests.mission.pictures import asset, picture, track

HOME = (
    asset("Drone_T01", "uav", "WestGate"), asset("Drone_T02", "uav", "NorthGate"),
    asset("Drone_T03", "uav", "SouthGate"), asset("Ugv_T01", "ugv", "EastGate"),
)  # fmt: skip


def later(view: Picture, seconds: float, **changes: Any) -> list[Picture]:
    """Return `view` again, twice a second for so long, with `changes` to the picture."""
    return [
        view.model_copy(update={"time_s": view.time_s + step / 2} | changes)
        for step in range(1, round(seconds * 2) + 1)
    ]


def told(noticer: Noticer, views: Iterable[Picture]) -> list[tuple[str, str]]:
    return [(notice.subject, notice.text) for view in views for notice in noticer.look(view)]


def home(name: str = "", **changes: Any) -> Picture:
    return picture(*(a.model_copy(update=changes if a.id == name else {}) for a in HOME))


def test_nothing_new_is_nothing_told() -> None:
    assert told(Noticer(home()), later(home(), 30)) == []


@pytest.mark.parametrize(
    ("changes", "subject", "text"),
    [
        ({"status": "failed"}, "Drone_T01", "status failed"),
        ({"low_battery": True, "battery_pct": 20.0}, "Drone_T01", "battery low, 20 %"),
        (
            {"comms": "lost", "stale": True, "stamp_s": 4.0},
            "Drone_T01",
            "communications lost, silent for 6 s",
        ),
        ({"stale": True, "stamp_s": 7.0}, "Drone_T01", "silent for 6 s"),
        ({"integrity": "suspect"}, "Drone_T01", "telemetry is suspect: it cannot be right"),
        ({"available": False, "status": "failed"}, "WestGate", "no longer covered"),
    ],
)
def test_what_happens_to_an_asset_is_told_once(
    changes: dict[str, Any], subject: str, text: str
) -> None:
    lines = told(Noticer(home()), later(home("Drone_T01", **changes), 12))
    assert lines.count((subject, text)) == 1
    assert len(lines) <= 2


def test_unknown_cover_a_dead_camera_and_the_weather_are_told() -> None:
    cameras = {"Cam": CameraReport(gate="WestGate", works=True, stamp_s=10.0)}
    view = home().model_copy(update={"cameras": cameras})
    unsure = GateCover(covered=False, unsure=("Drone_T01",))
    worse = home("Drone_T01", available=False, stale=True, stamp_s=8.0)
    changed = {
        "gates": worse.gates | {"WestGate": unsure},
        "cameras": {"Cam": cameras["Cam"].model_copy(update={"works": False})},
        "weather": "fog",
    }
    lines = told(Noticer(view), later(worse, 4, **changed))
    assert ("WestGate", "cover unknown, Drone_T01 silent for 4 s") in lines
    assert ("Cam", "camera at WestGate is out") in lines
    assert ("weather", "fog from now on") in lines


def test_a_track_is_told_from_its_first_detection_to_its_end() -> None:
    noticer = Noticer(home())
    steps: list[dict[str, Any]] = [
        {},
        {"observed": True},
        {"observed": True, "identity": "unauthorized"},
        {"observed": True, "identity": "unauthorized", "warned": True},
        {"observed": True, "identity": "unauthorized", "warned": True, "defiant": True},
        {"observed": True, "identity": "unauthorized", "warned": True, "defiant": True,
         "intent": "hostile", "hostile_by": ("Drone_T01", "Cam")},
    ]  # fmt: skip
    lines = [
        line
        for step in steps
        for line in told(noticer, [picture(*HOME, tracks=(track("V1", "WestGate", **step),))])
    ]
    assert [text for _, text in lines] == [
        "unknown vehicle approaching, WestGate, 40 m",
        "observed by a UAV",
        "identified as unauthorized",
        "warned",
        "goes on in spite of the warning",
        "intent hostile, Drone_T01 and Cam say so",
    ]
    assert told(noticer, later(home(), GONE_S + 1)) == [("V1", "track is gone")]


def test_a_thousand_assets_that_fall_silent_are_one_line() -> None:
    crowd = [asset(f"D{n:04d}", "uav", None) for n in range(1000)]
    silent = [a.model_copy(update={"comms": "lost", "stamp_s": 4.0}) for a in crowd]
    lines = told(Noticer(picture(*crowd)), [picture(*silent)])
    assert lines == [
        (
            "D0000",
            "communications lost, silent for 6 s; likewise 999 others, among them"
            " D0001, D0002, D0003",
        )
    ]


@given(st.lists(st.tuples(st.booleans(), st.booleans(), st.booleans()), max_size=60))
def test_flicker_twice_a_second_is_hardly_told(states: list[tuple[bool, bool, bool]]) -> None:
    noticer, notices = Noticer(home()), list[Noticed]()
    for step, (stale, degraded, seen) in enumerate(states):
        changes = {"stale": stale, "comms": "degraded" if degraded else "ok"}
        view = home("Drone_T01", **changes)
        here = {"V1": track("V1", "WestGate")} if seen or step % 2 else {}
        update = {"time_s": 10.0 + step / 2, "tracks": here}
        notices += noticer.look(view.model_copy(update=update))
    by_subject = [notice.subject for notice in notices]
    assert by_subject.count("V1") <= 1
    assert by_subject.count("Drone_T01") <= 1 + len(states) // 5


def test_a_dispute_about_an_identity_is_told_with_who_says_what() -> None:
    claims = {"Cam_West": "unauthorized", "Robot_T01": "authorized"}
    before = home()
    seen = picture(*HOME, tracks=(track("V1", "WestGate"),))
    disputed = picture(*HOME, tracks=(track("V1", "WestGate", identity_claims=claims),))
    lines = told(Noticer(before), [*later(seen, 2), *later(disputed, 5)])
    said = "identity disputed: Cam_West says unauthorized, Robot_T01 says authorized"
    assert [text for _, text in lines if "disputed" in text] == [
        f"{said}; have another robot identify it"
    ]
