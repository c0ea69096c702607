"""A scenario happens by itself: at times, on conditions, at random from the seed, and exactly."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.schema.incident import (
    After,
    AssetIs,
    FailAsset,
    Incident,
    IncidentCondition,
    ObstructWay,
    PlaceAsset,
    RandomEvents,
    RevealTrack,
    Scenario,
    ScriptedEvent,
    SetBattery,
    SetRadio,
    SpawnTrack,
    TrackIs,
    WorkerFault,
)
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.scenario_file import list_scenarios, load_scenario, scenario_path
from tests.sim.running import order, run

MARK = SetBattery(asset="Robot_T02", percent=50.0)


def scenario(*events: ScriptedEvent, random: tuple[RandomEvents, ...] = ()) -> Scenario:
    return Scenario(name="test", title="Test", about="Test", events=events, random=random)


def happenings(sim: Checkpoint, seconds: float) -> list[tuple[float, Incident]]:
    """Run for `seconds`; return what the scenario made happen, and when."""
    found = [(sim.time_s, incident) for incident in sim.take_incidents()]
    for _ in range(round(seconds / sim.world.dt_s)):
        sim.step()
        found += [(sim.time_s, incident) for incident in sim.take_incidents()]
    return found


def when_marked(sim: Checkpoint, seconds: float) -> float:
    """Return when the one event `MARK` happened within `seconds`."""
    [at] = [time_s for time_s, incident in happenings(sim, seconds) if incident == MARK]
    return at


def test_events_happen_at_their_time_and_show_in_the_picture(world: World) -> None:
    low = SetBattery(asset="Drone_T02", percent=10.0)
    fail = FailAsset(asset="Drone_T01")
    script = scenario(
        ScriptedEvent(at_s=0.0, do=low), ScriptedEvent(at_s=2.0, delay_s=1.5, do=fail)
    )
    sim = Checkpoint(world, 1, script)
    assert sim.picture().assets["Drone_T02"].low_battery
    assert happenings(sim, 6.0) == [(0.0, low), (3.5, fail)]
    assert sim.picture().assets["Drone_T01"].status == "failed"
    assert sim.take_incidents() == []


def test_events_follow_each_other(world: World) -> None:
    second = FailAsset(asset="Drone_T02")
    script = scenario(
        ScriptedEvent(when=After(event="first"), delay_s=2.0, do=second),
        ScriptedEvent(name="first", at_s=1.0, do=FailAsset(asset="Drone_T01")),
        ScriptedEvent(name="third", when=After(event="first"), do=MARK),
    )
    times = {incident: time_s for time_s, incident in happenings(Checkpoint(world, 1, script), 5.0)}
    assert times[MARK] == 1.0
    assert times[second] == pytest.approx(3.1)


@pytest.mark.parametrize(
    "condition",
    [
        AssetIs(asset="Drone_T04", state="moving"),
        AssetIs(asset="Drone_T04", state="arrived", at="EastGate"),
        AssetIs(asset="Ugv_T02", state="low_battery"),
        AssetIs(asset="Ugv_T02", state="charging"),
        AssetIs(asset="Robot_T01", state="failed"),
        AssetIs(asset="Robot_T01", state="failed", at="Checkpoint"),
        AssetIs(asset="Drone_T03", state="silent"),
    ],
)
def test_an_event_waits_for_what_assets_come_to(world: World, condition: IncidentCondition) -> None:
    sim = Checkpoint(world, 1, scenario(ScriptedEvent(when=condition, delay_s=1.0, do=MARK)))
    assert happenings(sim, 3.0) == []
    order(sim, "Drone_T04", "observe", "EastGate")
    order(sim, "Ugv_T02", "return_to_base")
    sim.inject(SetBattery(asset="Ugv_T02", percent=12.0))
    sim.inject(FailAsset(asset="Robot_T01"))
    sim.inject(SetRadio(asset="Drone_T03", up=False))
    assert when_marked(sim, 60.0) > 3.9


def test_conditions_that_do_not_come_true_make_nothing_happen(world: World) -> None:
    never = [
        AssetIs(asset="Drone_T01", state="arrived", at="EastGate"),
        AssetIs(asset="Nobody", state="failed"),
        TrackIs(track="Car", state="leaving"),
        TrackIs(track="Car", state="gone"),
        TrackIs(track="Car", state="warned"),
    ]
    car = SpawnTrack(gate="WestGate", name="Car")
    script = scenario(
        ScriptedEvent(at_s=1.0, do=car),
        *(ScriptedEvent(when=condition, do=MARK) for condition in never),
    )
    assert happenings(Checkpoint(world, 1, script), 30.0) == [(1.0, car)]


def test_an_event_waits_for_what_becomes_of_a_contact(world: World) -> None:
    car = SpawnTrack(gate="NorthGate", name="Car", speed_mps=8.0, distance_m=90.0)
    states = (
        "present",
        "detected",
        "observed",
        "stopped",
        "identified",
        "warned",
        "leaving",
        "gone",
    )
    marks = {
        state: SetBattery(asset="Robot_T02", percent=50.0 + n) for n, state in enumerate(states)
    }
    script = scenario(
        ScriptedEvent(at_s=1.0, do=car),
        *(
            ScriptedEvent(when=TrackIs(track="Car", state=state), do=marks[state])
            for state in states
        ),
    )
    sim = Checkpoint(world, 1, script)
    found = happenings(sim, 30.0)
    order(sim, "Robot_T01", "identify", "NorthGate")
    found += happenings(sim, 60.0)
    order(sim, "Robot_T01", "warn", "NorthGate")
    found += happenings(sim, 90.0)
    times = {incident: time_s for time_s, incident in found}
    in_order = [times[marks[state]] for state in states]
    assert in_order == sorted(in_order)
    assert in_order[0] == 1.0
    assert len(set(in_order)) >= 6


def test_the_truth_behind_a_contact_can_turn(world: World) -> None:
    turn = RevealTrack(track="Car", identity="authorized", intent="benign")
    script = scenario(
        ScriptedEvent(
            at_s=0.0, do=SpawnTrack(gate="EastGate", name="Car", identity="unauthorized")
        ),
        ScriptedEvent(at_s=2.0, do=turn),
    )
    sim = Checkpoint(world, 1, script)
    run(sim, 1.0)
    [contact] = sim.truth().tracks.values()
    assert contact.identity == "unauthorized"
    run(sim, 2.0)
    [contact] = sim.truth().tracks.values()
    assert contact.identity == "authorized"


def test_the_death_of_the_worker_changes_nothing_but_is_told(world: World) -> None:
    script = scenario(ScriptedEvent(at_s=1.0, do=WorkerFault()))
    sim, calm = Checkpoint(world, 1, script), Checkpoint(world, 1)
    assert happenings(sim, 5.0) == [(1.0, WorkerFault())]
    run(calm, 5.0)
    assert sim.truth() == calm.truth()


def test_what_is_impossible_is_skipped_and_told(world: World) -> None:
    small = world.frames | {"Base": world.frames["Base"].model_copy(update={"radius_m": 1.0})}
    script = scenario(
        ScriptedEvent(at_s=1.0, do=PlaceAsset(asset="Ugv_T02", frame="Base"), name="crowd"),
        ScriptedEvent(when=After(event="crowd"), do=MARK),
        ScriptedEvent(at_s=1.0, do=FailAsset(asset="Tank")),
        random=(RandomEvents(mean_s=0.5, do=(FailAsset(asset="Tank"),)),),
    )
    sim = Checkpoint(world.model_copy(update={"frames": small}), 1, script)
    assert happenings(sim, 10.0) == []
    told = sim.take_skipped()
    assert any("crowd did not happen: no free place for Ugv_T02 at 'Base'" in text for text in told)
    assert any("events.2 did not happen: there is no asset 'Tank'" in text for text in told)
    assert any("random.0 (fail) did not happen" in text for text in told)
    assert sim.take_skipped() == []


def test_random_events_come_as_often_as_told_and_from_the_seed_alone(world: World) -> None:
    process = RandomEvents(mean_s=2.0, from_s=40.0, do=(MARK, FailAsset(asset="Drone_T04")))
    script = scenario(random=(process,))
    sims = [Checkpoint(world, seed, script) for seed in (7, 7, 8)]
    for second in range(20):
        order(sims[1], "Ugv_T02", "move_to", world.gates[second % 4])
        sims[1].inject(SpawnTrack(gate="NorthGate"))
        run(sims[1], 1.0)
    first, other = happenings(sims[0], 440.0), happenings(sims[2], 440.0)
    assert happenings(sims[1], 420.0) == first != other
    assert first[0][0] > 40.0
    assert 150 < len(first) < 250
    assert {incident.kind for _, incident in first} == {"battery", "fail"}


def test_a_process_faster_than_the_step_does_not_stop_the_world(world: World) -> None:
    script = scenario(random=(RandomEvents(mean_s=1e-9, do=(MARK,)),))
    assert 10 <= len(happenings(Checkpoint(world, 1, script), 1.0)) <= 11


def test_starting_anew_plays_the_scenario_anew(world: World) -> None:
    script = scenario(ScriptedEvent(at_s=1.0, do=FailAsset(asset="Drone_T01")))
    sim = Checkpoint(world, 1, script)
    fresh = sim.state_hash()
    run(sim, 3.0)
    sim.reset(1)
    assert sim.state_hash() == fresh
    assert sim.take_incidents() == []
    assert [time_s for time_s, _ in happenings(sim, 3.0)] == [1.0]


@given(seed=st.integers(0, 2**32), name=st.integers(0, 20), cut=st.integers(1, 400))
@settings(max_examples=12, deadline=None)
def test_twins_and_forks_of_every_scenario_stay_equal(
    world: World, world_path: Path, seed: int, name: int, cut: int
) -> None:
    known = list_scenarios(world_path)
    script = load_scenario(scenario_path(world_path, known[name % len(known)][0]), world)
    sim, twin = Checkpoint(world, seed, script), Checkpoint(world, seed, script)
    one, other = happenings(sim, cut * world.dt_s), happenings(twin, cut * world.dt_s)
    assert (one, sim.state_hash()) == (other, twin.state_hash())
    fork, before = sim.fork(), sim.state_hash()
    ahead = happenings(fork, 30.0)
    assert sim.state_hash() == before
    assert happenings(sim, 30.0) == happenings(twin, 30.0) == ahead
    assert sim.state_hash() == twin.state_hash() == fork.state_hash()
    assert sim.picture() == twin.picture() == fork.picture()


def test_an_obstruction_may_not_fall_on_an_asset(world: World) -> None:
    script = scenario(ScriptedEvent(at_s=1.0, do=ObstructWay(start=(-5.0, 0.0), end=(5.0, 0.0))))
    sim = Checkpoint(world, 1, script)
    assert happenings(sim, 2.0) == []
    assert "stands where the obstruction would lie" in sim.take_skipped()[0]
