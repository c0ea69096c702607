"""The digest says who covers what and who is free to go."""

from hypothesis import given
from hypothesis import strategies as st

from pa_console.language.canonical.facts import tracks_of_digest
from pa_console.llm.roles.prompts import planner_prompt
from pa_console.mission.planning.picture_text import digest_picture
from pa_console.resources import find_data
from pa_console.schema.telemetry import GateCover
from pa_console.sim.worlds.world_file import load_world
from tests.llm.site import mission
from tests.mission.pictures import GATES, asset, picture, track

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
    assert digest.stood == {"Ugv_T01": "EastGate"}
    assert digest.uncovered == ("NorthGate", "EastGate", "SouthGate")
    assert [line.split(":")[0] for line in digest.tracks] == ["V2", "V1"]


def test_a_track_is_told_with_what_is_known_of_it() -> None:
    known = track("V1", "EastGate", identity="unauthorized", status="stopped", observed=True)
    new = track("V2", "WestGate", distance_m=80.0)
    assert digest_picture(picture(tracks=(known, new)), WORLD).tracks == (
        "V1: vehicle stopped at EastGate, 40 m, unauthorized, intent unknown, observed, not warned",
        "V2: vehicle approaches WestGate, 80 m, not identified, not observed, not warned",
    )


def test_a_disputed_identity_is_told_as_such() -> None:
    claims = {"Robot_T01": "authorized", "Cam_West": "hostile"}
    seen = track("V1", "EastGate", identity_claims=claims, hostile_by=("Cam_West",))
    [line] = digest_picture(picture(tracks=(seen,)), WORLD).tracks
    assert "not identified, identity disputed, not observed" in line
    [read] = tracks_of_digest((line,))
    assert (read.identity, read.identity_words) == ("", "not identified")


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


def test_the_prompt_of_a_small_world_with_fresh_telemetry_is_as_it_was_tuned() -> None:
    team = [asset(name, spec.kind, spec.post) for name, spec in WORLD.assets.items()]
    view = picture(*team, tracks=(track("Track_01", "WestGate"),))
    prompt = planner_prompt(WORLD, digest_picture(view, WORLD), [], mission("Watch the gates."))
    assert prompt.system.endswith("NorthGate, EastGate, SouthGate, WestGate, Checkpoint, Base")
    assert prompt.user == (
        "Rules\nnone\n"
        "Tracks: Track_01: vehicle approaches WestGate, 40 m, not identified, not observed,"
        " not warned\n"
        "Guards: Drone_T02 at NorthGate; Ugv_T01 at EastGate; Drone_T03 at SouthGate;"
        " Drone_T01 at WestGate\n"
        'Mission: "Watch the gates."\n'
        "Free: drone Drone_T04; vehicle Ugv_T02; robot Robot_T01, Robot_T02"
    )


def test_what_nobody_knows_is_told_as_unknown_not_as_down() -> None:
    silent = asset("Drone_T01", "uav", "WestGate", available=False, stale=True, stamp_s=3.0)
    forged = asset("Drone_T04", "uav", "Checkpoint", available=False, integrity="suspect")
    broken = asset("Ugv_T01", "ugv", "EastGate", available=False, status="failed", stale=True)
    seen = track("V1", "WestGate", stale=True, stamp_s=4.0, noncombatants=True)
    view = picture(silent, forged, broken, tracks=(seen,))
    gates = view.gates | {"WestGate": GateCover(covered=False, unsure=("Drone_T01",))}
    digest = digest_picture(view.model_copy(update={"gates": gates}), WORLD)
    assert digest.unknown == (
        "WestGate: cover unknown, Drone_T01 silent for 7 s",
        "Drone_T04 sends suspect telemetry",
    )
    assert digest.down == ("Ugv_T01",)
    assert digest.tracks[0].endswith("noncombatants suspected, last seen 6 s ago")
    user = planner_prompt(WORLD, digest, [], mission("Watch.")).user
    assert "\nUnknown: WestGate: cover unknown, Drone_T01 silent for 7 s; Drone_T04 sends" in user
