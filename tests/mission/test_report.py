"""The after-action report says what happened, in plain lines, and calls unknown unknown."""

from datetime import UTC, datetime
from typing import Any

from pa_console.mission.report import PlanFacts, ReportFacts, after_action_report
from pa_console.schema.events.event import WorkflowMoved
from pa_console.schema.mission import ActionOutcome, Alarm, Decision, Mission, Outcome, Verification
from pa_console.schema.plan import Action, Plan
from pa_console.schema.telemetry import GateCover
from tests.mission.pictures import asset, picture, track

MISSION = Mission(
    id="M001", text="Look at WestGate.", created=datetime(2026, 1, 1, tzinfo=UTC), alarm="A001"
)
ALARM = Alarm(
    id="A001", kind="unknown_track", priority="high", subject="Track_01", gate="WestGate",
    text="Track_01: an unknown vehicle is approaching WestGate, 40 m", raised_s=12.0,
)  # fmt: skip
PLAN = Plan(reason="one drone observes", actions=(Action(agent="D4", command="observe WestGate"),))
COVERED = picture(
    *(asset(f"D{n}", "uav", gate) for n, gate in enumerate(picture().gates)),
)


def seen(outcome: Outcome) -> Verification:
    action = ActionOutcome(agent="D4", command="observe WestGate", outcome=outcome, reason="why")
    return Verification(outcome=outcome, actions=(action,), reason="because", as_of_s=33.5)


def test_a_mission_in_phases_is_told_from_alarm_to_outcome() -> None:
    facts = ReportFacts(MISSION, alarm=ALARM, rules=("WF-01", "ROE-02"))
    steps: dict[str, Any] = {
        "workflow": "inspection", "rule_id": "WF-01", "track": "Track_01",
        "phases": ("recon", "identify"),
    }  # fmt: skip
    facts.moved(WorkflowMoved(**steps, phase=0), 13.0)
    facts.plans += [
        PlanFacts(
            PLAN,
            MISSION.text,
            halted=("D1 failed on its way",),
            decision=Decision(kind="approve", reason="looks right"),
            unmet=("1 drone home: none is spared",),
        ),
        PlanFacts(PLAN, "Identify it.", seen("pass")),
    ]
    facts.moved(WorkflowMoved(**steps, phase=2, outcome="it left"), 61.0)
    text = after_action_report(facts, "verified", "", COVERED)
    assert text.splitlines() == [
        "M001 verified: Look at WestGate.",
        "Raised by A001 (high) at 12 s: Track_01: an unknown vehicle is approaching WestGate, 40 m",
        "Rules: WF-01, ROE-02",
        "Workflow inspection (WF-01) for Track_01: recon from 13 s; over at 61 s: it left",
        "Plan 1. Rationale: one drone observes",
        "Decided by operator: approve, looks right",
        "Not met: 1 drone home: none is spared",
        "Halted: D1 failed on its way",
        "- D4 observe WestGate",
        "Plan 2 for 'Identify it.'. Rationale: one drone observes",
        "- D4 observe WestGate: pass, why",
        "By telemetry as of 33.5 s: pass, because",
        "All gates covered.",
    ]
    assert len(facts.halts) == 1


def test_an_answered_alarm_that_clears_later_is_not_told_as_open() -> None:
    facts = ReportFacts(MISSION, alarm=ALARM)
    facts.plans.append(PlanFacts(PLAN, MISSION.text, seen("pass")))
    other = ALARM.model_copy(update={"id": "A002", "text": "Track_02: another"})
    lines = after_action_report(facts, "verified", "", COVERED, [ALARM, other]).splitlines()
    clears = "it clears when the track is gone, leaves or is known to be harmless"
    assert f"A001 is answered; {clears}" in lines
    assert "Open alarms: A002 Track_02: another" in lines
    unverified = after_action_report(facts, "unverified", "why", COVERED, [ALARM])
    assert "answered" not in unverified
    assert "Open alarms: A001" in unverified


def test_nothing_executed_says_why() -> None:
    text = after_action_report(ReportFacts(MISSION), "rejected", "too risky", COVERED)
    assert "Nothing was executed: too risky" in text
    assert "Raised by alarm A001" in text


def test_what_is_unknown_is_never_called_covered() -> None:
    silent = asset("D3", "uav", "WestGate", available=False, stale=True, stamp_s=3.0)
    now = picture(*[a for a in COVERED.assets.values() if a.at != "WestGate"], silent,
                  tracks=(track("V1", "EastGate", stale=True, stamp_s=5.0),))  # fmt: skip
    gates = now.gates | {"WestGate": GateCover(covered=False, unsure=("D3",), uncovered_s=7.0)}
    now = now.model_copy(update={"gates": gates})
    facts = ReportFacts(MISSION)
    facts.see(now)
    facts.see(now.model_copy(update={"time_s": 14.0}))
    facts.plans.append(PlanFacts(PLAN, MISSION.text, seen("unknown")))
    text = after_action_report(facts, "unverified", "D3 is silent", now, [ALARM])
    assert "All gates covered" not in text
    assert "Gates whose cover is unknown: WestGate" in text
    assert "Longest without known cover: WestGate 4 s" in text
    assert "Open track: V1 at EastGate, identity unknown, intent unknown, last seen 5 s ago" in text
    assert "Open alarms: A001 Track_01: an unknown vehicle" in text
    assert "Unknown: D3 silent for 7 s" in text
    assert "Outcome: D3 is silent" in text


def test_a_thousand_silent_assets_make_no_long_report() -> None:
    crowd = [asset(f"D{n}", "uav", None, available=False, stale=True) for n in range(1000)]
    text = after_action_report(ReportFacts(MISSION), "held", "no plan", picture(*crowd))
    assert "and 992 more" in text
    assert len(text) < 1500
