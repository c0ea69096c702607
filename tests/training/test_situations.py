"""Situations: reproducible, as an evaluation would begin them, and their troubles show."""

import pickle
import random

from hypothesis import example, given, settings
from hypothesis import strategies as st

from pa_console.evaluation.score import begin
from pa_console.schema.incident import FailAsset, SetBattery, SetComms, SetWeather, SpawnTrack
from pa_console.schema.plan import Action
from pa_console.sim.checkpoint import Checkpoint
from pa_training.situations.past_incidents import OrderHistory
from pa_training.situations.situations import Situation, random_situation, settled
from pa_training.situations.worlds import random_world, shipped_world

HOME = shipped_world()
SEEDS = st.integers(0, 10**6)


def situation_of(seed: int, *, history: bool = True) -> Situation:
    rng = random.Random(seed)
    return random_situation(rng, random_world(rng), history=history)


@settings(max_examples=10, deadline=None)
@given(SEEDS)
def test_equal_seeds_give_equal_situations_in_another_process_too(seed: int) -> None:
    situation, again = situation_of(seed), situation_of(seed)
    moved: Situation = pickle.loads(pickle.dumps(situation))
    assert situation.sim.state_hash() == again.sim.state_hash() == moved.sim.state_hash()
    assert situation.digest == again.digest == moved.digest


@settings(max_examples=10, deadline=None)
@given(SEEDS)
def test_one_without_history_is_as_an_evaluation_begins_its_case(seed: int) -> None:
    situation = situation_of(seed, history=False)
    case = situation.case("A", "Hold.", ("run.refused",))
    begun = begin(case, situation.world, situation.seed)
    assert begun.state_hash() == situation.sim.state_hash()


@settings(max_examples=25, deadline=None)
@given(SEEDS)
@example(197342)
def test_troubles_show_in_the_picture(seed: int) -> None:
    situation = situation_of(seed)
    picture, digest = situation.picture, situation.digest
    assert situation.troubles or not situation.setup
    queued = set[str]()
    """Gates with a contact that may be too far off to be seen; others come behind it."""
    for incident in situation.setup:
        match incident:
            case FailAsset(asset=name):
                assert name in digest.down
            case SetBattery(asset=name) if picture.assets[name].available:
                assert name in digest.low_battery
            case SetComms(asset=name, comms="degraded"):
                assert name in digest.degraded_comms
            case SetWeather(weather=weather):
                assert picture.weather == weather
            case SpawnTrack(gate=gate, distance_m=near) if near == 1.0 and gate not in queued:
                assert gate in {track.gate for track in picture.tracks.values()}
            case SpawnTrack(gate=gate):
                queued.add(gate)
            case _:
                pass


def test_every_kind_of_trouble_and_knowledge_comes_up() -> None:
    rng = random.Random(1)
    blank = Checkpoint(HOME)
    found = [random_situation(rng, HOME, like=blank) for _ in range(240)]
    kinds = {trouble for situation in found for trouble in situation.troubles}
    tracks = [track for situation in found for track in situation.picture.tracks.values()]
    assert len(kinds) == 9
    assert 36 <= sum(not situation.troubles for situation in found) <= 96
    assert {"approaching", "stopped"} <= {track.status for track in tracks}
    assert {track.identity for track in tracks} == {"unknown", "authorized", "unauthorized"}
    assert {track.intent for track in tracks} == {"unknown", "benign", "hostile"}
    assert {True, False} == {track.observed for track in tracks}
    assert any(track.warned for track in tracks)
    assert any(track.noncombatants for track in tracks)


def test_missions_in_one_situation_do_not_disturb_each_other() -> None:
    situation = settled(HOME, setup=(SpawnTrack(gate="EastGate"),))
    before = situation.sim.state_hash()
    fork = situation.fork()
    fork.step()
    assert fork.state_hash() != before == situation.sim.state_hash()


def test_what_was_ordered_before_is_known() -> None:
    robot = (Action(agent="Robot_T01", command="identify NorthGate"),)
    setup = (SpawnTrack(gate="NorthGate", distance_m=1.0, identity="authorized"),)
    known = settled(HOME, setup=setup, history=OrderHistory(orders=(robot,)))
    assert [track.identity for track in known.picture.tracks.values()] == ["authorized"]
    leaving = settled(HOME, history=OrderHistory(under_way=robot, wait_s=2.0))
    assert leaving.picture.assets["Robot_T01"].speed_mps > 0.0
