"""In a large world the prompt speaks of what the mission concerns, and stays as short."""

import math
from collections.abc import Mapping
from datetime import UTC, datetime

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.language.name_linking import named, names_meant
from pa_console.llm.roles.grammar import plan_grammar
from pa_console.llm.roles.prompts import fixed_part, planner_prompt
from pa_console.mission.planning.picture_text import (
    MOST_ASSETS,
    MOST_GATES,
    MOST_TRACKS,
    digest_picture,
    select,
)
from pa_console.resources import find_data
from pa_console.schema.mission import Mission
from pa_console.schema.rule import Rule
from pa_console.schema.telemetry import AssetTelemetry, GateCover, Picture, Selection, Track
from pa_console.schema.world import AssetKind, AssetSpec, Frame, Platform, World
from pa_console.sim.worlds.world_file import load_world
from tests.mission.pictures import GATES, asset, picture, track

PLATFORM = Platform(
    speed_mps=5.0, turn_rate_dps=90.0, radius_m=0.5, sensor_range_m=40.0,
    drain_idle_pct_per_min=0.1, drain_moving_pct_per_min=1.0,
)  # fmt: skip
PLACES = ("River", "Hill", "Mill", "Dock", "Quarry", "Orchard", "Chapel", "Foundry", "Ferry", "Oak")
KINDS: tuple[AssetKind, ...] = ("uav", "ugv", "robot")


def large_world(gates: int = 50, assets: int = 1000) -> World:
    """Return a world whose gates stand on a circle of 1 km, each with one asset, the rest spare."""
    names = [f"{PLACES[n % 10]}Gate_{n // 10 + 1}" for n in range(gates)]
    frames = {
        name: Frame(kind="gate", at=_on_circle(n, gates, 1000.0)) for n, name in enumerate(names)
    }
    frames["Yard"] = Frame(kind="post", at=(10.0, 0.0))
    frames["Depot"] = Frame(kind="base", at=(0.0, 0.0))
    posts = [*names, *("Yard" for _ in range(assets - gates))][:assets]
    return World(
        name="large",
        title="Large",
        standoff_m=10.0,
        coverage_grace_s=20.0,
        perimeter=((-1e3, -1e3), (1e3, -1e3), (0.0, 1e3)),
        frames=frames,
        platforms=dict.fromkeys(KINDS, PLATFORM),
        assets={
            f"Unit_{n:04d}": AssetSpec(kind=KINDS[n % 3], post=post) for n, post in enumerate(posts)
        },
    )


def _on_circle(number: int, count: int, radius: float) -> tuple[float, float]:
    angle = math.tau * number / count
    return round(radius * math.cos(angle), 1), round(radius * math.sin(angle), 1)


def calm(world: World, *tracks: Track, **changes: Mapping[str, object]) -> Picture:
    """Return the picture of everybody at their posts, but for `changes` by asset id."""
    team: dict[str, AssetTelemetry] = {}
    for name, spec in world.assets.items():
        told = asset(name, spec.kind, spec.post, position=world.frames[spec.post].at)
        team[name] = told.model_copy(update=changes.get(name, {}))
    gates: dict[str, GateCover] = {}
    for gate in world.gates:
        here = [a for a in team.values() if a.at == a.post == gate]
        by = tuple(a.id for a in here if a.available)
        unsure = tuple(a.id for a in here if not a.available and a.stale)
        gates[gate] = GateCover(covered=bool(by), by=by, unsure=unsure)
    return Picture(
        tick=100, time_s=10.0, assets=team, tracks={t.id: t for t in tracks}, gates=gates
    )


SMALL = load_world(find_data("worlds", "checkpoint", "world.yaml"))
LARGE = large_world()
SILENT: dict[str, object] = {"comms": "lost", "stale": True, "available": False, "stamp_s": 3.0}
BATTERY = Rule(
    id="CAP-99", domain="CAP", priority="medium", text="Low batteries return.", tags=("battery",)
)


def mission(text: str, **changes: str) -> Mission:
    values = {"id": "M1", "text": text, "created": datetime(2026, 1, 1, tzinfo=UTC)} | changes
    return Mission.model_validate(values)


def chosen(text: str) -> Selection:
    selection = select(calm(LARGE), LARGE, mission(text), [])
    assert selection is not None
    return selection


def test_a_small_world_is_told_whole() -> None:
    team = [asset(name, spec.kind, spec.post) for name, spec in SMALL.assets.items()]
    assert select(picture(*team), SMALL, mission("Watch."), []) is None


@pytest.mark.parametrize(
    ("text", "gates"),
    [
        ("Send a drone to HillGate_2.", ["HillGate_2"]),
        ("Send a drone to the hill gate 2.", ["HillGate_2"]),
        ("Send a drone to HILLGATE_2 now!", ["HillGate_2"]),
        ("Something is wrong at foundry gate 4", ["FoundryGate_4"]),
        ("Something is wrong at foundery gate 4", ["FoundryGate_4"]),
    ],
)
def test_gates_are_meant_by_name_in_words_or_misspelled(text: str, gates: list[str]) -> None:
    assert list(chosen(text).gates) == gates


def test_a_gate_named_by_half_means_all_that_share_the_name() -> None:
    assert list(chosen("Watch the quarry gates.").gates) == [f"QuarryGate_{n}" for n in range(1, 6)]


def test_several_gates_in_one_breath_are_all_meant() -> None:
    text = "Unknown vehicles are approaching both the north and east gates."
    assert names_meant(GATES, text) == ["NorthGate", "EastGate"]
    assert named(["Drone_T01", "Drone_T02"], "drone T02 and DRONE_T01, hold") == [
        "Drone_T01",
        "Drone_T02",
    ]
    assert named(["Unit_1", "Unit_11"], "Unit_11 holds") == ["Unit_11"]


def test_an_alarm_brings_its_gate_its_track_and_its_asset() -> None:
    seen = track("Track_07", "MillGate_3", distance_m=30.0)
    view = calm(LARGE, seen, Unit_0005=SILENT)
    answer = mission("Look at it.", subject="Track_07", gate="MillGate_3")
    selection = select(view, LARGE, answer, [])
    assert selection is not None
    assert list(selection.tracks) == ["Track_07"]
    assert list(selection.gates) == ["MillGate_3", "OrchardGate_1"]
    assert selection.gates["OrchardGate_1"] == "its cover is unknown"
    assert selection.assets["Unit_0022"] == "covers MillGate_3"
    assert (
        selection.assets["Unit_0005"] == "nothing certain is known of it, posted to OrchardGate_1"
    )
    replace = mission("Replace it.", subject="Unit_0005")
    selection = select(view, LARGE, replace, [])
    assert selection is not None
    assert selection.gates["OrchardGate_1"] == "Unit_0005 is posted to it"


def test_the_nearest_free_assets_of_every_kind_are_offered_best_first() -> None:
    near = {"position": LARGE.frames["MillGate_3"].at}
    view = calm(LARGE, Unit_0900=near, Unit_0901=near, Unit_0905=near | {"low_battery": True})
    selection = select(view, LARGE, mission("Cover MillGate_3."), [])
    assert selection is not None
    digest = digest_picture(view, LARGE, selection)
    assert digest.free["uav"][0] == "Unit_0900"
    assert digest.free["ugv"][0] == "Unit_0901"
    assert [len(names) for names in digest.free.values()] == [3, 3, 3]
    assert "Unit_0905" not in selection.assets
    assert selection.assets["Unit_0900"] == "free uav, 0 m away"


def test_a_rule_about_batteries_brings_low_ones_in() -> None:
    view = calm(LARGE, Unit_0500={"low_battery": True, "battery_pct": 9.0})
    without = select(view, LARGE, mission("Anything new?"), [])
    withal = select(view, LARGE, mission("Anything new?"), [BATTERY])
    assert without is not None
    assert withal is not None
    assert "Unit_0500" not in without.assets
    assert withal.assets["Unit_0500"] == "low battery"


def test_the_digest_speaks_of_the_selection_only_and_names_the_unknown() -> None:
    view = calm(LARGE, Unit_0005=SILENT, Unit_0700=SILENT)
    selection = select(view, LARGE, mission("Watch HillGate_1."), [])
    digest = digest_picture(view, LARGE, selection)
    assert digest.covered == {"HillGate_1": 1, "OrchardGate_1": 0}
    assert digest.sole_cover == {"HillGate_1": "Unit_0001"}
    assert digest.unknown == ("OrchardGate_1: cover unknown, Unit_0005 silent for 7 s",)
    assert set(digest.posts) <= set(selection.assets if selection else ())
    assert digest.selection == selection


def prompt_length(assets: int) -> int:
    world = large_world(assets=assets)
    seen = [track(f"Track_{n:02d}", world.gates[n % 50]) for n in range(30)]
    silent = dict.fromkeys(list(world.assets)[::2], SILENT)
    view = calm(world, *seen, **silent)
    task = mission("Send everybody to the hill gates.")
    selection = select(view, world, task, [BATTERY])
    prompt = planner_prompt(world, digest_picture(view, world, selection), [BATTERY], task)
    return len(prompt.system) + len(prompt.user)


def test_the_prompt_does_not_grow_with_the_number_of_assets() -> None:
    assert abs(prompt_length(1000) - prompt_length(120)) < 200


def test_the_frames_of_a_large_world_are_told_with_the_mission_not_in_the_fixed_part() -> None:
    assert "HillGate_1" not in fixed_part("planner", LARGE)
    view = calm(LARGE)
    task = mission("Watch HillGate_1.")
    selection = select(view, LARGE, task, [])
    assert selection is not None
    user = planner_prompt(LARGE, digest_picture(view, LARGE, selection), [], task).user
    assert "\nFrames: HillGate_1, Depot, Yard\n" in user
    grammar = plan_grammar(LARGE, view, selection.assets, selection.frames)
    assert '"HillGate_1"' in grammar
    assert "MillGate_1" not in grammar


names = st.sampled_from(sorted(LARGE.assets)[:60])
words = st.lists(
    st.sampled_from(["hill", "gate", "2", "all", "Unit_0003", "unit 0004", "Track_01", "send"]),
    max_size=12,
).map(" ".join)


@settings(max_examples=40)
@given(
    words,
    st.dictionaries(names, st.sampled_from([SILENT, {"low_battery": True}]), max_size=30),
    st.integers(0, 20),
)
def test_a_selection_is_bounded_counts_what_it_leaves_out_and_gives_a_readable_grammar(
    text: str, changes: dict[str, dict[str, object]], tracks: int
) -> None:
    view = calm(LARGE, *(track(f"Track_{n:02d}", LARGE.gates[n]) for n in range(tracks)), **changes)
    selection = select(view, LARGE, mission(text or "?"), [BATTERY])
    assert selection is not None
    assert len(selection.gates) <= MOST_GATES
    assert len(selection.tracks) == min(tracks, MOST_TRACKS)
    assert len(selection.assets) <= MOST_ASSETS
    assert selection.left_out["assets"] + len(selection.assets) == len(LARGE.assets)
    assert selection.left_out["gates"] + len(selection.gates) == len(LARGE.gates)
    assert all(selection.assets.values())
    digest = digest_picture(view, LARGE, selection)
    for free in digest.free.values():
        assert all(view.gates[g].by != (name,) for name in free for g in LARGE.gates)
    assert plan_grammar(LARGE, view, selection.assets, selection.frames).startswith("start: ")


def test_the_gates_that_a_mission_means_go_before_those_in_trouble() -> None:
    seen = [track(f"Track_{n:02d}", LARGE.gates[n]) for n in range(20)]
    selection = select(calm(LARGE, *seen), LARGE, mission("Send a drone to the oak gates."), [])
    assert selection is not None
    assert list(selection.gates)[:5] == [f"OakGate_{n}" for n in range(1, 6)]
    assert len(selection.gates) == MOST_GATES
