"""The unknown-vehicle workflow goes phase after phase, skips what does not apply, and ends."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.policy.orderings import WorkflowMove, WorkflowRun
from pa_console.policy.rulebook import Compiler, Rulebook, compile_rule
from pa_console.schema.rehearsal import Moment, TrackMoment
from pa_console.schema.rule import Phase, Rule, Workflow
from tests.policy.book import checkpoint_rules

UNKNOWN: dict[str, Any] = {
    "gate": "GateOfTheHill", "identity": "unknown", "intent": "unknown", "status": "approaching",
    "observed": False, "warned": False,
}  # fmt: skip
PHASES = ["recon", "identify", "warn", "escalate"]


class Story:
    """Tells the moments of one track, a second apart unless it says otherwise."""

    def __init__(self, **facts: Any) -> None:
        self.time_s, self.facts = 0.0, UNKNOWN | facts
        self.run = WorkflowRun.start(checkpoint_rules(), self.now, "Track_07")

    @property
    def now(self) -> Moment:
        """The present moment."""
        track = TrackMoment.model_validate(self.facts)
        return Moment(time_s=self.time_s, tracks={"Track_07": track})

    def then(self, after_s: float = 1.0, **facts: Any) -> list[WorkflowMove]:
        """Let time pass and facts change; return what the workflow makes of it."""
        assert self.run is not None
        self.time_s += after_s
        self.facts |= facts
        return self.run.advance(self.now)

    @property
    def phase(self) -> str:
        """The name of the current phase, empty when the workflow is over."""
        assert self.run is not None
        return self.run.current.name if self.run.current is not None else ""


def test_a_threat_is_observed_identified_warned_and_contained() -> None:
    story = Story()
    assert story.run is not None
    assert [phase.name for phase in story.run.phases] == PHASES
    assert (story.then(), story.phase) == ([], "recon")
    assert story.then(observed=True) == [WorkflowMove("done", "recon")]
    assert story.phase == "identify"
    story.then(identity="unauthorized")
    assert story.phase == "warn"
    assert story.then(warned=True) == []
    assert story.then(defiant=True) == []
    assert story.then(intent="hostile") == [WorkflowMove("done", "warn")]
    assert (story.phase, story.run.outcome) == ("escalate", "")
    assert story.then(blocked=True) == [
        WorkflowMove("done", "escalate"), WorkflowMove("ended", outcome="contained"),
    ]  # fmt: skip
    assert (story.run.current, story.run.position, story.run.skipped) == (None, 4, ())
    assert story.then(intent="benign") == []


def test_who_may_pass_is_cleared_and_the_rest_is_skipped() -> None:
    story = Story(observed=True)
    story.then()
    assert story.then(identity="authorized")[-1] == WorkflowMove("ended", outcome="cleared")
    assert story.run is not None
    assert story.run.skipped == ("warn", "escalate")


def test_one_that_leaves_is_over_at_whatever_phase() -> None:
    known: list[dict[str, Any]] = [{}, {"observed": True}, {"identity": "unauthorized"}]
    for facts_so_far in known:
        story = Story(**facts_so_far)
        story.then(status="leaving")
        assert story.then(5.0)[-1] == WorkflowMove("ended", outcome="left")


def test_one_that_heeds_the_warning_has_left() -> None:
    story = Story(observed=True, identity="unauthorized")
    story.then(warned=True, status="stopped")
    assert story.then(3.0, status="leaving") == []
    assert story.then(5.0)[-1] == WorkflowMove("ended", outcome="left")


def test_one_that_is_no_longer_detected_is_not_said_to_have_left() -> None:
    story = Story()
    assert story.run is not None
    assert story.run.advance(Moment(time_s=9.0)) == [
        WorkflowMove("ended", outcome="no longer detected")
    ]
    assert story.run.command() == ""


def test_one_that_stands_still_after_the_warning_stays_under_watch() -> None:
    story = Story(observed=True, identity="unauthorized")
    story.then()
    assert story.then(warned=True) == []
    assert story.then(4.0, status="stopped") == []
    assert story.then(4.0) == []
    assert story.phase == "warn"
    assert story.then(4.0) == [
        WorkflowMove("done", "warn"), WorkflowMove("skipped", "escalate"),
        WorkflowMove("ended", outcome="under watch"),
    ]  # fmt: skip


@pytest.mark.parametrize("suspected", ["at first", "after the warning"])
def test_noncombatants_are_never_escalated_against(suspected: str) -> None:
    story = Story(observed=True, identity="unauthorized", noncombatants=suspected == "at first")
    story.then(warned=True)
    story.then(intent="hostile", defiant=True, noncombatants=True)
    assert story.run is not None
    assert story.run.current is None
    assert story.run.outcome == "under observation only"
    assert story.run.skipped[-1] == "escalate"


def test_an_alarm_about_a_known_threat_begins_where_something_is_left_to_do() -> None:
    story = Story(observed=True, identity="unauthorized", warned=True, intent="hostile")
    story.then()
    assert story.phase == "escalate"


def test_no_workflow_starts_for_one_that_needs_none() -> None:
    assert Story(identity="authorized").run is None
    assert Story(status="leaving").run is None


def test_no_workflow_starts_for_a_track_that_nobody_knows() -> None:
    assert WorkflowRun.start(checkpoint_rules(), Moment(time_s=0.0), "Track_07") is None


def test_a_command_names_track_and_gate_even_when_the_track_has_changed_its_gate() -> None:
    story = Story(observed=True)
    story.then()
    assert story.run is not None
    assert "Track_07" in story.run.command()
    assert "GateOfTheHill" in story.run.command()
    story.then(gate="OtherGate")
    assert "OtherGate" in story.run.command()
    assert story.run.gate == "OtherGate"


def book_with(
    starts: str = "true", done: str = "false", ends: dict[str, str] | None = None
) -> Rulebook:
    rule = Rule(id="WF-01", domain="WF", priority="high", text="In order.")
    phase = Phase(name="only", command="go to {gate}", done=done)
    workflow = Workflow(id="own", rule="WF-01", starts=starts, ends=ends or {}, phases=(phase,))
    return Rulebook("own", "", (compile_rule(rule),), (Compiler().workflow(workflow),))


def test_an_expression_that_cannot_be_evaluated_holds_for_nothing() -> None:
    now = Moment(time_s=0.0, tracks={"V1": TrackMoment.model_validate(UNKNOWN)})
    assert WorkflowRun.start(book_with(starts="it.nosuchfield"), now, "V1") is None
    run = WorkflowRun.start(
        book_with(done="1 / 0 == 1", ends={"lost": "now.tracks['V9'].warned"}), now, "V1"
    )
    assert run is not None
    assert run.advance(now) == []
    assert run.current is not None


def test_expressions_may_speak_of_the_moment_and_of_the_orders_in_it() -> None:
    book = book_with(done="now.orders.exists(o, o.target == it.gate) && id == 'V1'")
    tracks = {"V1": TrackMoment.model_validate(UNKNOWN)}
    now = Moment(time_s=0.0, tracks=tracks)
    run = WorkflowRun.start(book, now, "V1")
    assert run is not None
    assert run.advance(now) == []
    ordered = Moment.model_validate(
        now.model_dump()
        | {
            "orders": (
                {"agent": "U1", "kind": "uav", "verb": "observe", "target": UNKNOWN["gate"]},
            )
        }
    )
    assert run.advance(ordered) == [WorkflowMove("done", "only"), WorkflowMove("ended")]


facts = st.fixed_dictionaries(
    {},
    optional={
        "identity": st.sampled_from(["unknown", "authorized", "unauthorized"]),
        "intent": st.sampled_from(["unknown", "benign", "hostile"]),
        "status": st.sampled_from(["approaching", "stopped", "leaving", "inside"]),
        "observed": st.booleans(),
        "warned": st.booleans(),
        "defiant": st.booleans(),
        "noncombatants": st.booleans(),
        "blocked": st.booleans(),
    },
)


def _learned(known: dict[str, Any], change: dict[str, Any]) -> dict[str, Any]:
    """Return `change` without what a station never forgets of a track: who it is, what it did."""
    kept = {name for name in ("observed", "warned", "defiant", "noncombatants") if known.get(name)}
    if known["identity"] != "unknown" and change.get("identity") == "unknown":
        kept.add("identity")
    return {name: value for name, value in change.items() if name not in kept}


def test_a_threat_that_is_none_any_more_ends_once_it_has_been_steady() -> None:
    story = Story(observed=True, identity="unauthorized", warned=True, intent="hostile")
    assert story.run is not None
    story.then()
    assert story.phase == "escalate"
    assert story.then(intent="benign") == [WorkflowMove("skipped", "escalate")]
    assert (story.run.current, story.run.ended) == (None, False)
    assert story.then(2.0) == []
    assert story.then(5.0) == [WorkflowMove("ended", outcome="under watch")]
    assert story.then(5.0) == []


@settings(max_examples=150, deadline=None)
@given(facts, st.lists(st.tuples(st.sampled_from([0.5, 3.0, 7.0]), facts), max_size=12))
def test_a_workflow_only_goes_on_tells_every_phase_once_and_ends_with_an_outcome(
    first: dict[str, Any], later: list[tuple[float, dict[str, Any]]]
) -> None:
    story = Story(**first)
    if story.run is None:
        return
    told: list[WorkflowMove] = []
    for after_s, change in later:
        position = story.run.position
        told += story.then(after_s, **_learned(story.facts, change))
        assert story.run.position >= position
        escalating = story.run.current is not None and story.run.current.name == "escalate"
        assert not escalating or story.facts["intent"] == "hostile"
        assert not escalating or not story.facts.get("noncombatants", False)
    passed = [move.phase for move in told if move.what != "ended"]
    assert passed == PHASES[: len(passed)]
    assert story.run.skipped == tuple(move.phase for move in told if move.what == "skipped")
    ended = [move for move in told if move.what == "ended"]
    assert bool(ended) == story.run.ended == bool(story.run.outcome)
    assert not ended or story.run.current is None
    assert all(move.outcome == story.run.outcome for move in ended)
