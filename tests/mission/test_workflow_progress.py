"""Where a mission stands in its workflows: entered by alarm or deed, then phase after phase."""

from datetime import UTC, datetime
from typing import Any

from pa_console.mission.outcome import WorkflowProgress
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import Moment, TrackMoment
from tests.policy.book import checkpoint_rules

UNKNOWN: dict[str, Any] = {
    "gate": "WestGate", "identity": "unknown", "intent": "unknown", "status": "approaching",
    "observed": False, "warned": False,
}  # fmt: skip
KNOWN = UNKNOWN | {"observed": True, "identity": "authorized", "intent": "benign"}


def now(seconds: float, **tracks: dict[str, Any]) -> Moment:
    """Return the moment at which there are these tracks."""
    found = {name: TrackMoment.model_validate(facts) for name, facts in tracks.items()}
    return Moment(time_s=seconds, tracks=found)


def course(subject: str | None = None) -> WorkflowProgress:
    mission = Mission(id="M1", text="look", created=datetime.now(UTC), subject=subject)
    return WorkflowProgress(checkpoint_rules(), mission)


def plan(command: str) -> Plan:
    return Plan(reason="r", actions=(Action(agent="Drone_T04", command=command),))


def test_an_alarms_mission_enters_the_workflow_of_its_track_once() -> None:
    mine = course("Track_01")
    there = now(0.0, Track_01=UNKNOWN, Track_02=UNKNOWN)
    [moved] = mine.begin(there)
    assert (moved.track, moved.rule_id, moved.phase) == ("Track_01", "WF-01", 0)
    assert moved.command
    assert list(mine.begin(there)) == []
    assert (mine.entered, mine.over, mine.tracks) == (True, False, ("Track_01",))
    assert mine.task is not None
    assert (mine.task.id, mine.task.text) == ("M1", moved.command)
    assert (mine.task.subject, mine.task.gate) == ("Track_01", "WestGate")
    assert mine.phase == f"Track_01 {moved.phases[0]}"
    assert mine.verbs == ("observe",)


def test_a_mission_about_no_track_has_no_workflow_until_a_plan_deals_with_one() -> None:
    for mine in (course(), course("Drone_T01"), course("Track_09")):
        there = now(0.0, Track_01=UNKNOWN)
        assert list(mine.begin(there)) == []
        assert (mine.entered, mine.over, mine.settled, mine.phase) == (False, True, True, "")
        assert (mine.task, mine.verbs) == (None, ())
        for harmless in ("move_to WestGate", "observe EastGate", "report"):
            assert list(mine.join(plan(harmless), there)) == []
        [moved] = mine.join(plan("observe WestGate"), there)
        assert moved.track == "Track_01"
        assert list(mine.join(plan("observe WestGate"), there)) == []


def test_phases_move_on_as_the_picture_says_and_only_then() -> None:
    mine = course("Track_01")
    [entered] = mine.begin(now(0.0, Track_01=UNKNOWN))
    assert list(mine.observe(now(1.0, Track_01=UNKNOWN))) == []
    [moved] = mine.observe(now(2.0, Track_01=UNKNOWN | {"observed": True}))
    assert moved.phase == entered.phase + 1
    assert mine.phase.endswith(entered.phases[1])
    assert mine.summary == f"Track_01: stopped at {entered.phases[1]}"
    assert not mine.over


def test_a_track_that_proves_harmless_ends_its_workflow_with_an_outcome() -> None:
    mine = course("Track_01")
    list(mine.begin(now(0.0, Track_01=UNKNOWN)))
    moves = list(mine.observe(now(2.0, Track_01=KNOWN)))
    assert mine.over
    assert mine.settled
    assert moves[-1].outcome
    assert moves[-1].command == ""
    assert mine.summary == f"Track_01: {moves[-1].outcome}"
    assert list(mine.observe(now(3.0))) == []


def test_a_track_that_is_gone_ends_its_workflow() -> None:
    mine = course("Track_01")
    list(mine.begin(now(0.0, Track_01=UNKNOWN)))
    [moved] = mine.observe(now(5.0))
    assert mine.over
    assert moved.outcome == checkpoint_rules().workflows[0].workflow.gone


def test_the_second_track_sets_the_task_when_the_first_is_through() -> None:
    mine = course("Track_01")
    both = now(0.0, Track_01=UNKNOWN, Track_02=UNKNOWN)
    list(mine.begin(both))
    list(mine.join(plan("observe WestGate"), both))
    assert mine.tracks == ("Track_01", "Track_02")
    assert mine.phase.startswith("Track_01")
    list(mine.observe(now(1.0, Track_01=KNOWN, Track_02=UNKNOWN)))
    assert mine.phase.startswith("Track_02")
    assert mine.task is not None
    assert mine.task.subject == "Track_02"
    assert "Track_01: " in mine.summary
    assert "Track_02: stopped at" in mine.summary
