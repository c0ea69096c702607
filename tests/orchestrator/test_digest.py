"""The digest says who covers what and who is free to go."""

from hypothesis import given
from hypothesis import strategies as st

from pa_console.orchestrator.digest import digest_picture
from pa_console.resources import find_data
from pa_console.sim.world_file import load_world
from tests.orchestrator.pictures import GATES, asset, picture, track

WORLD = load_world(find_data("worlds", "checkpoint", "world.yaml"))


def test_sole_covers_are_not_free_and_spares_are_best_first() -> None:
    digest = digest_picture(
        picture(
            asset("Drone_T01", "uav", "WestGate"),
            asset("Drone_T04", "uav", "Checkpoint", battery_pct=60.0),
            asset("Drone_T05", "uav", "Checkpoint", battery_pct=80.0),
            asset("Robot_T01", "robot", "Base", low_battery=True, battery_pct=10.0),
            asset("Ugv_T01", "ugv", "EastGate", available=False, status="failed"),
            tracks=(track("V2", "WestGate", distance_m=30.0), track("V1", "EastGate")),
        ),
        WORLD,
    )
    assert digest.sole_cover == {"WestGate": "Drone_T01"}
    assert digest.free["uav"] == ("Drone_T05", "Drone_T04")
    assert digest.free["robot"] == ()
    assert digest.low_battery == ("Robot_T01",)
    assert digest.down == ("Ugv_T01",)
    assert digest.uncovered == ("NorthGate", "EastGate", "SouthGate")
    assert [line.split(":")[0] for line in digest.tracks] == ["V2", "V1"]


def test_a_track_is_told_with_what_is_known_of_it() -> None:
    known = track("V1", "EastGate", identity="unauthorized", status="stopped", observed=True)
    new = track("V2", "WestGate", distance_m=80.0)
    assert digest_picture(picture(tracks=(known, new)), WORLD).tracks == (
        "V1: vehicle stopped at EastGate, 40 m, unauthorized, intent unknown, observed, not warned",
        "V2: vehicle approaches WestGate, 80 m, not identified, not observed, not warned",
    )


assets = st.lists(
    st.builds(
        asset,
        name=st.sampled_from([f"Drone_T{n:02d}" for n in range(12)]),
        kind=st.sampled_from(["uav", "ugv", "robot"]),
        at=st.sampled_from([*GATES, "Checkpoint", "Base", None]),
        available=st.booleans(),
        low_battery=st.booleans(),
    ),
    unique_by=lambda a: a.id,
)


@given(assets)
def test_moving_free_assets_one_at_a_time_uncovers_no_gate(team: list[object]) -> None:
    view = picture(*team)  # pyright: ignore[reportArgumentType]
    digest = digest_picture(view, WORLD)
    for names in digest.free.values():
        for name in names:
            assert view.assets[name].available
            assert all(cover.by != (name,) for cover in view.gates.values())
