"""What a rule did is found event by event, and a decision leads back to its telemetry."""

from pa_console.policy.authoring.examples import WORLD, example_plan, example_rehearsal
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Finding, RuleOpinion, Verdict
from pa_console.schema.mission import Decision, Mission
from pa_console.schema.plan import Plan
from pa_console.schema.rule import RuleExample, RuleHit
from pa_console.session.mission_trace import Attempt
from pa_console.session.state import SessionState
from pa_console.views.rule_trail import RuleDeed, evidence_of, trail_of, uses_of
from tests.session.story import PLAN, START, at, session_started
from tests.tui import story

RULE = "WF-03"
MISSION = Mission(id="M1", text="watch gate A", created=START)


def finding(status: str = "violates", rule: str = RULE) -> Finding:
    """Return a finding of a high rule."""
    return Finding.model_validate(
        {"rule_id": rule, "priority": "high", "status": status, "message": "GateA is left"}
    )


def checked(attempt: int, *findings: Finding) -> ev.PlanChecked:
    return ev.PlanChecked(attempt=attempt, findings=findings, seconds=0.0)


def did(*data: ev.EventPayload) -> list[tuple[int, RuleDeed, str]]:
    """Return what the rule did in a mission to which this happened."""
    begin = [
        at(0.0, session_started()),
        at(1.0, ev.MissionReceived(mission=MISSION, position=0), "M1"),
    ]
    found = trail_of(RULE, [*begin, *(at(2.0, payload, "M1") for payload in data)])
    return [(e.attempt, e.did, e.words) for trail in found for e in trail.entries]


def test_every_thing_that_a_rule_does_is_found_in_order() -> None:
    reasons = (f"{RULE}: GateA is left", "ROE-01: something else", f"{RULE}0: no")
    decision = Decision(kind="approve", acknowledged=(RULE,), reason="short")
    verdict = Verdict(verdict="Failure", rules=(RuleOpinion(rule_id=RULE, opinion="violates"),))
    hits = (RuleHit(rule_id="ROE-01", score=1.0, pinned=True), RuleHit(rule_id=RULE, score=0.25))
    assert did(
        ev.RulesRetrieved(method="related", hits=hits, seconds=0.0),
        ev.PlanProposed(attempt=1, text="{}", plan=PLAN),
        checked(1, finding(), finding("complies", "ROE-01")),
        ev.RepairRequested(attempt=1, reasons=reasons),
        ev.PlanProposed(attempt=2, text="{}", plan=PLAN),
        checked(2, finding("not_applicable")),
        ev.PlanProposed(attempt=3, text="{}", plan=PLAN),
        checked(3, finding("complies")),
        ev.PlanJudged(attempt=3, verdict=verdict),
        ev.ApprovalRequested(attempt=3, plan=PLAN, blocked_by=reasons),
        ev.DecisionMade(attempt=3, decision=decision, accepted=True),
        ev.PlanHalted(attempt=3, reasons=reasons, safe_state=()),
    ) == [
        (0, "retrieved", "rank 2, score 0.250"),
        (1, "broken", "GateA is left"),
        (1, "sent back", "GateA is left"),
        (2, "not applicable", "GateA is left"),
        (3, "decided", "GateA is left"),
        (3, "judged", "violates; Failure"),
        (3, "blocked", "GateA is left"),
        (3, "acknowledged", "by operator: short"),
        (3, "halted", "GateA is left"),
    ]


def test_a_mission_refused_for_its_words_is_told_apart_from_a_plan() -> None:
    assert did(checked(1, finding())) == [(1, "refused", "GateA is left")]


def test_entries_name_their_event_and_other_missions_are_left_out() -> None:
    events = [
        at(0.0, session_started("S7")),
        at(1.0, ev.MissionReceived(mission=MISSION, position=0), "M1"),
        at(2.0, ev.PlanProposed(attempt=1, text="{}", plan=PLAN), "M1"),
        at(3.0, checked(1, finding()), "M1"),
        at(4.0, checked(1, finding()), "M2"),
    ]
    (trail,) = trail_of(RULE, events)
    assert (trail.session, trail.mission.id, trail.entries[0].event) == ("S7", "M1", 4)
    assert trail.entries[0].tick == 30
    assert trail.did("broken", "halted")
    assert not trail.did("retrieved")
    assert trail_of("WF-99", events) == []


def test_a_decision_leads_back_to_the_telemetry_it_was_made_by() -> None:
    example = RuleExample(
        name="x",
        expect="fail",
        plan=(("Ugv_T02", "block WestGate"), ("Drone_T04", "hold")),
        given={
            "tracks": {"V1": {"gate": "WestGate", "stamp_s": 98.0}},
            "assets": {"Ugv_T02": {"battery_pct": 12.0, "comms": "degraded"}},
        },
    )
    plan: Plan = example_plan(example)
    broken = finding().model_copy(update={"message": "not identified: V1 at WestGate"})
    attempt = Attempt(1, plan=plan, findings=(broken, finding("complies", "ROE-01")))
    assert evidence_of(attempt) is None
    attempt.rehearsal = rehearsal = example_rehearsal(example, plan)
    found = evidence_of(attempt)
    assert found is not None
    assert found.deciding == (broken,)
    facts = dict(found.facts)
    assert list(facts) == ["Ugv_T02", "WestGate", "V1", "Drone_T04"]
    assert "battery 12 %, link degraded" in facts["Ugv_T02"]
    assert facts["WestGate"] == "covered by Drone_T01; tracks: V1"
    assert "identity unknown" in facts["V1"]
    assert "last detected 2.0 s earlier" in facts["V1"]
    assert found.time_s == rehearsal.before.time_s
    assert set(facts) - {"V1"} <= {*WORLD.assets, *WORLD.frames}
    attempt.findings = (finding("complies", "ROE-01"), finding("not_applicable"))
    held = evidence_of(attempt)
    assert held is not None
    assert [f.rule_id for f in held.deciding] == ["ROE-01"]


def missions(*broken: str) -> SessionState:
    state = SessionState()
    for event in story.stamped(story.told("approval", broken=broken)):
        state.apply(event)
    return state


def test_a_rule_is_followed_to_its_missions() -> None:
    traces = missions("WF-03").missions.values()
    (use,) = uses_of("WF-03", traces)
    assert use.mission == story.MISSION.id
    assert use.hit is not None
    assert use.hit.score == 0.38
    assert [(number, found.status) for number, found in use.decided] == [(1, "violates")]
    assert use.broken
    (judged,) = uses_of("ROE-01", traces)
    assert judged.hit is not None
    assert judged.hit.pinned
    assert not judged.decided
    (checked,) = uses_of("CAP-01", traces)
    assert checked.hit is None
    assert not checked.broken
    assert uses_of("WF-09", traces) == ()
