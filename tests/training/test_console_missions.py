"""The console's own missions: its very words, and what they mean."""

from pa_training.order_generator.console_missions import console_missions

from pa_console.schema.incident import FailAsset, SetBattery, SpawnTrack
from pa_console.station.alarms import AlarmBook
from pa_training.situations.situations import settled
from pa_training.situations.worlds import shipped_world
from pa_training.teacher.teacher import teach

HOME = shipped_world()
SETUP = (
    SpawnTrack(gate="EastGate", distance_m=40.0),
    FailAsset(asset="Drone_T03"),
    SetBattery(asset="Drone_T01", percent=11.0),
    SetBattery(asset="Robot_T02", percent=11.0),
)


def test_they_are_those_of_the_alarms_and_of_the_workflows_phase() -> None:
    situation = settled(HOME, setup=SETUP)
    missions = {text: (order, verbs) for text, order, verbs in console_missions(
        HOME, situation.picture
    )}  # fmt: skip
    book = AlarmBook(HOME)
    book.look(situation.picture)
    later = situation.picture.time_s + HOME.coverage_grace_s
    book.look(situation.picture.model_copy(update={"time_s": later}))
    commands = {alarm.command for alarm in book.open if alarm.command and alarm.gate != "EastGate"}
    assert len(commands) == 3
    assert commands <= missions.keys()
    tasks = {order.asks[0].task for order, _ in missions.values()}
    assert tasks == {"cover", "home", "respond", "look"}
    assert [verbs for _, verbs in missions.values() if verbs] == [("observe",)]


def test_the_teacher_answers_each_with_its_verbs() -> None:
    situation = settled(HOME, setup=SETUP)
    for _, order, verbs in console_missions(HOME, situation.picture):
        target = teach(order, HOME, situation.picture, situation.digest, verbs)
        assert target.plan.actions
        assert target.expect == "execute"


def test_where_nothing_is_the_matter_there_are_none() -> None:
    assert console_missions(HOME, settled(HOME).picture) == []
