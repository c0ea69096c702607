"""Telemetry decides whether a plan happened; stale or missing telemetry is unknown, never fine."""

from datetime import UTC, datetime
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.mission.execute import needs_more_evidence
from pa_console.mission.execution.dispatch import TIMED_OUT
from pa_console.mission.report import PlanFacts, ReportFacts, after_action_report
from pa_console.mission.verify import verify_plan
from pa_console.resources import find_data
from pa_console.schema.command import CommandReply
from pa_console.schema.events.event import WorkflowMoved
from pa_console.schema.mission import ActionOutcome, Alarm, Decision, Mission, Outcome, Verification
from pa_console.schema.plan import Action, Plan
from pa_console.schema.telemetry import AssetTelemetry, GateCover, Picture
from pa_console.sim.worlds.world_file import load_world
from tests.mission.pictures import GATES, asset, picture, track

WORLD = load_world(find_data("worlds", "checkpoint", "world.yaml"))
HOME = (
    asset("Drone_T01", "uav", "WestGate"), asset("Drone_T02", "uav", "NorthGate"),
    asset("Drone_T03", "uav", "SouthGate"), asset("Ugv_T01", "ugv", "EastGate"),
)  # fmt: skip


def _verify(command: str, after: Picture, status: str = "done", agent: str = "Drone_T04") -> str:
    plan = Plan(reason="test", actions=(Action(agent=agent, command=command),))
    reply = CommandReply.model_validate(
        {"command_id": "M1.1", "agent": agent, "status": status, "tick": 5}
    )
    return verify_plan(plan, WORLD, picture(*HOME), after, {agent: reply}).outcome


def test_arrival_is_seen_in_telemetry_not_taken_from_the_device() -> None:
    there = picture(*HOME, asset("Drone_T04", "uav", "EastGate"))
    elsewhere = picture(*HOME, asset("Drone_T04", "uav", "Checkpoint"))
    assert _verify("move_to EastGate", there) == "pass"
    assert _verify("move_to EastGate", elsewhere) == "fail"


def test_a_device_that_failed_is_a_failure_even_at_the_right_place() -> None:
    there = picture(*HOME, asset("Drone_T04", "uav", "EastGate"))
    assert _verify("move_to EastGate", there, status="failed") == "fail"


def test_stale_telemetry_is_unknown() -> None:
    stale = picture(*HOME, asset("Drone_T04", "uav", "EastGate", stamp_s=1.0))
    assert _verify("move_to EastGate", stale) == "unknown"


def test_a_gate_that_lost_its_cover_fails_the_mission() -> None:
    gone = picture(*HOME[1:], asset("Drone_T01", "uav", "EastGate"))
    plan = Plan(reason="x", actions=(Action(agent="Drone_T01", command="move_to EastGate"),))
    reply = CommandReply(command_id="M1.1", agent="Drone_T01", status="done", tick=5)
    verification = verify_plan(plan, WORLD, picture(*HOME), gone, {"Drone_T01": reply})
    assert verification.outcome == "fail"
    assert verification.gates_lost == ("WestGate",)


@pytest.mark.parametrize(
    ("identity", "expected"), [("unauthorized", "pass"), ("unknown", "fail"), (None, "unknown")]
)
def test_identify_is_proved_by_the_track(identity: str | None, expected: str) -> None:
    robot = asset("Robot_T01", "robot", "WestGate")
    seen = () if identity is None else (track("V1", "WestGate", identity=identity),)
    after = picture(*HOME, robot, tracks=seen)
    assert _verify("identify WestGate", after, agent="Robot_T01") == expected


def _outcome(command: str, after: Picture, tick: int = 95, detail: str = "") -> Verification:
    """Verify a command of Drone_T04 that ended at `tick` (10 a second; the picture is of 10 s)."""
    plan = Plan(reason="test", actions=(Action(agent="Drone_T04", command=command),))
    final = CommandReply(
        command_id="M1.1",
        agent="Drone_T04",
        status="failed" if detail else "done",
        tick=tick,
        detail=detail,
    )
    return verify_plan(plan, WORLD, picture(*HOME), after, {"Drone_T04": final})


def test_a_report_from_before_the_end_of_the_command_proves_nothing() -> None:
    there = picture(*HOME, asset("Drone_T04", "uav", "EastGate", stamp_s=9.0))
    verification = _outcome("move_to EastGate", there)
    assert verification.outcome == "unknown"
    assert "no telemetry since its command ended" in verification.reason


def test_a_pass_says_since_when_it_holds() -> None:
    home = [member.model_copy(update={"stamp_s": 9.8}) for member in HOME]
    there = picture(*home, asset("Drone_T04", "uav", "EastGate", stamp_s=9.6))
    verification = _outcome("move_to EastGate", there)
    assert (verification.outcome, verification.as_of_s) == ("pass", 9.6)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"integrity": "suspect"}, "suspect"),
        ({"comms": "lost", "stamp_s": 2.0}, "silent for 8 s"),
        ({"stale": True, "stamp_s": 6.0}, "4 s old"),
    ],
)
def test_telemetry_that_cannot_be_relied_on_is_unknown(changes: dict[str, Any], why: str) -> None:
    there = picture(*HOME, asset("Drone_T04", "uav", "EastGate", available=False, **changes))
    verification = _outcome("move_to EastGate", there)
    assert verification.outcome == "unknown"
    assert why in verification.reason


def test_a_gate_whose_cover_is_unknown_or_was_reported_too_early_is_unknown() -> None:
    there = picture(*HOME, asset("Drone_T04", "uav", "EastGate"))
    unsure = GateCover(covered=False, unsure=("Drone_T01",))
    silent = there.model_copy(update={"gates": there.gates | {"WestGate": unsure}})
    verification = _outcome("move_to EastGate", silent)
    assert (verification.outcome, verification.gates_unknown) == ("unknown", ("WestGate",))
    early = picture(asset("Drone_T01", "uav", "WestGate", stamp_s=9.0), *HOME[1:],
                    asset("Drone_T04", "uav", "EastGate"))  # fmt: skip
    assert _outcome("move_to EastGate", early).gates_unknown == ("WestGate",)


def test_a_time_out_is_no_proof_of_failure_and_none_of_success() -> None:
    detail = f"{TIMED_OUT}: no acknowledgement within 8 s"
    there = picture(*HOME, asset("Drone_T04", "uav", "EastGate"))
    verification = _outcome("move_to EastGate", there, detail=detail)
    assert verification.outcome == "unknown"
    assert "telemetry: at EastGate" in verification.reason
    away = picture(*HOME, asset("Drone_T04", "uav", "Checkpoint"))
    assert _outcome("move_to EastGate", away, detail=detail).outcome == "fail"


def test_an_asset_at_its_target_that_heads_elsewhere_has_not_arrived() -> None:
    passing = picture(*HOME, asset("Drone_T04", "uav", "EastGate", post="Base"))
    assert _outcome("move_to EastGate", passing).outcome == "fail"


def test_a_track_that_was_known_before_does_not_prove_that_another_was_identified() -> None:
    known, new = track("V1", "WestGate", identity="authorized"), track("V2", "WestGate")
    before = picture(*HOME, tracks=(known, new))
    plan = Plan(reason="x", actions=(Action(agent="Robot_T01", command="identify WestGate"),))
    final = {"Robot_T01": CommandReply(command_id="1", agent="Robot_T01", status="done", tick=95)}
    robot = asset("Robot_T01", "robot", "WestGate")
    verification = verify_plan(plan, WORLD, before, picture(*HOME, robot, tracks=(known, new)),
                               final)  # fmt: skip
    assert (verification.outcome, verification.reason) == (
        "fail",
        "Robot_T01 identify WestGate: V2 still unidentified",
    )
    found = picture(*HOME, robot, tracks=(known, track("V2", "WestGate", identity="authorized")))
    assert verify_plan(plan, WORLD, before, found, final).outcome == "pass"


@pytest.mark.parametrize("changes", [{"stale": True}, {"stamp_s": 9.0}])
def test_a_track_not_seen_since_the_command_ended_is_unknown(changes: dict[str, Any]) -> None:
    robot = asset("Robot_T01", "robot", "WestGate")
    seen = (track("V1", "WestGate", identity="unauthorized", **changes),)
    plan = Plan(reason="x", actions=(Action(agent="Robot_T01", command="identify WestGate"),))
    final = {"Robot_T01": CommandReply(command_id="1", agent="Robot_T01", status="done", tick=95)}
    after = picture(*HOME, robot, tracks=seen)
    assert verify_plan(plan, WORLD, picture(*HOME), after, final).outcome == "unknown"
    assert needs_more_evidence(plan, after, 9.5)


def test_evidence_is_in_once_every_report_was_sent_after_the_end() -> None:
    plan = Plan(reason="x", actions=(Action(agent="Drone_T04", command="move_to EastGate"),))
    there = picture(*HOME, asset("Drone_T04", "uav", "EastGate"))
    assert not needs_more_evidence(plan, there, 10.0)
    assert needs_more_evidence(plan, there, 10.5)
    failed = asset("Drone_T04", "uav", None, status="failed", available=False, stamp_s=3.0)
    assert not needs_more_evidence(plan, picture(*HOME, failed), 10.0)


reports = st.fixed_dictionaries(
    {},
    optional={
        "stamp_s": st.sampled_from([2.0, 8.0, 9.4, 9.5, 10.0]),
        "stale": st.booleans(),
        "integrity": st.sampled_from(["ok", "suspect"]),
        "comms": st.sampled_from(["ok", "degraded", "lost"]),
        "at": st.sampled_from([*GATES, None]),
    },
)


@given(reports, st.lists(reports, min_size=4, max_size=4), st.sampled_from([60, 95, 100]))
def test_a_pass_never_rests_on_an_old_or_unsound_report(
    own: dict[str, Any], team: list[dict[str, Any]], end: int
) -> None:
    members = (*HOME, asset("Drone_T04", "uav", "EastGate"))
    told: list[AssetTelemetry] = []
    for member, changes in zip(members, (*team, own), strict=True):
        sound = changes.get("integrity") != "suspect" and changes.get("comms") != "lost"
        available = sound and not changes.get("stale")
        told.append(member.model_copy(update=changes | {"available": available}))
    after = picture(*told)
    verification = _outcome("move_to EastGate", after, tick=end)
    if verification.outcome == "pass":
        arrived = after.assets["Drone_T04"]
        assert arrived.at == "EastGate"
        assert arrived.available
        assert arrived.stamp_s >= end * 0.1 - 1e-6
        assert verification.as_of_s >= end * 0.1 - 1e-6
        for gate in GATES:
            stamps = [after.assets[name].stamp_s for name in after.gates[gate].by]
            assert max(stamps) >= end * 0.1 - 1e-6


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
