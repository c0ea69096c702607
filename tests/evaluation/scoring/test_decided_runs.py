"""A run whose watching ends early scores as one that is watched to its end."""

import pytest

from pa_console.evaluation.score import (
    FROM_ORDERS,
    RunRecorder,
    asked_fields,
    begin,
    is_decided,
    score_run,
    watch,
)
from pa_console.mission.rehearse import device_commands
from pa_console.schema.command import DeviceCommand
from pa_console.schema.evaluation import MissionCase
from pa_console.schema.world import World
from tests.evaluation.scoring.played import Stage, play
from tests.evaluation.scoring.recordings import ALL_RULES, UNKNOWN, WORLD, case, order
from tests.evaluation.witness_play import plans, written
from tests.shipped import missions

pytestmark = pytest.mark.long

CASES = missions()
WITNESSES = written("*.yaml")
BY_ORDERS = sorted(
    name
    for name, (each, _) in CASES.items()
    if all(asked_fields(source) <= FROM_ORDERS for source in each.success)
)


def stay(world: World) -> Stage:
    """Return orders to everybody to report, and to hold."""
    return [
        DeviceCommand(command_id=f"{name}.{verb}", agent=name, verb=verb)
        for name in world.assets
        for verb in ("report", "hold")
    ]


def scores(each: MissionCase, world: World, stages: list[Stage]) -> tuple[bool, bool]:
    """Play `stages`; return whether the run is decided then, and whether watching changes it."""
    sim = begin(each, world, 0)
    recorder = RunRecorder(sim, each.command)
    for stage in stages:
        play(sim, recorder, stage)
    if not is_decided(each, recorder.recording):
        return False, False
    early = score_run(each, recorder, "verified", ALL_RULES)
    watch(sim, recorder, each.watch_s - recorder.recording.final.time_s)
    return True, score_run(each, recorder, "verified", ALL_RULES) != early


@pytest.mark.parametrize("name", BY_ORDERS)
def test_watching_a_decided_run_changes_nothing(name: str) -> None:
    each, world = CASES[name]
    assert scores(each, world, []) == (True, False)
    assert scores(each, world, [stay(world)])[1] is False


@pytest.mark.parametrize("name", sorted(WITNESSES))
def test_a_witness_that_is_decided_scores_as_when_it_is_watched(name: str) -> None:
    each, world = CASES[name]
    stages = [
        device_commands(plan, f"plan{number}") for number, plan in enumerate(plans(WITNESSES[name]))
    ]
    assert scores(each, world, list(stages))[1] is False


def test_what_may_still_change_is_watched() -> None:
    ask_orders = case(UNKNOWN, success=["run.refused"])
    sent = [order("Drone_T04 observe WestGate")]
    assert scores(ask_orders, WORLD, []) == (True, False)
    assert scores(ask_orders, WORLD, [sent]) == (False, False)
    for asks in ("run.tracks.size() == 0", "run.coverage['WestGate'].at_end", "size(run) > 0"):
        assert scores(case(UNKNOWN, success=[asks]), WORLD, []) == (False, False)


def test_an_order_that_nobody_has_answered_is_waited_for() -> None:
    each = case(success=["size(run.reports) == 1"])
    sim = begin(each, WORLD, 0)
    recorder = RunRecorder(sim, each.command)
    recorder.sent(order("Drone_T04 report"))
    assert not is_decided(each, recorder.recording)
