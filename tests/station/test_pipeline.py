"""The eight steps end to end: what is executed was checked, rehearsed, judged and approved."""

import pytest

from pa_console.llm.backend import EngineDiedError
from pa_console.mission.approval import standing_approver
from pa_console.schema.events.event import ApprovalRequested, Event
from pa_console.schema.incident import FailAsset, SpawnTrack
from pa_console.schema.mission import Decision
from pa_console.schema.plan import Plan
from pa_console.station.station import ControlStation
from tests.rig import Rig
from tests.scripted import FAILURE, SUCCESS, ScriptedEngine, plan

SPARE = plan(("Drone_T04", "move_to EastGate"))
UNCOVERS = plan(("Drone_T01", "move_to EastGate"))


async def test_a_sound_plan_goes_through_all_steps_and_the_asset_arrives(rig: Rig) -> None:
    trace = await rig.run(ScriptedEngine([SPARE]))
    assert trace.status == "verified"
    assert rig.state.picture is not None
    assert rig.state.picture.assets["Drone_T04"].at == "EastGate"
    wanted = [
        "session_started", "telemetry", "mission_received", "mission_started", "rules_retrieved",
        "picture_digested", "prompt_built", "text_streamed", "plan_proposed", "plan_rehearsed",
        "plan_checked", "prompt_built", "plan_judged", "approval_requested", "decision_made",
        "command_sent", "command_replied", "mission_verified", "mission_reported",
        "mission_finished", "outcome_judged", "session_ended",
    ]  # fmt: skip
    remaining = iter(rig.kinds())
    assert all(kind in remaining for kind in wanted), rig.kinds()


async def test_every_rule_in_force_has_a_finding(rig: Rig) -> None:
    trace = await rig.run(ScriptedEngine([SPARE]))
    found = [finding.rule_id for finding in trace.attempts[0].findings]
    assert found == [rule.id for rule in rig.site.rulebook.rules]


async def test_a_plan_that_uncovers_a_gate_is_repaired_with_the_findings(rig: Rig) -> None:
    engine = ScriptedEngine([UNCOVERS, SPARE])
    trace = await rig.run(engine)
    assert trace.status == "verified"
    assert [attempt.number for attempt in trace.attempts] == [1, 2]
    assert any(reason.startswith("WF-03") for reason in trace.attempts[0].repair)
    assert "WF-03" in engine.requests[1].user
    assert all(c.command.agent == "Drone_T04" for c in trace.commands.values())


async def test_a_plan_that_stays_bad_is_refused_and_nothing_moves(rig: Rig) -> None:
    bad = [plan((f"Drone_T0{n}", "move_to EastGate")) for n in (1, 2, 3)]
    trace = await rig.run(ScriptedEngine(bad))
    assert trace.status == "refused"
    assert "WF-03" in trace.reason
    assert len(trace.attempts) == 3
    assert "command_sent" not in rig.kinds()
    assert not any(attempt.judged for attempt in trace.attempts)


async def test_repeating_the_same_bad_plan_ends_the_repair_early(rig: Rig) -> None:
    trace = await rig.run(ScriptedEngine([UNCOVERS]))
    assert trace.status == "refused"
    assert len(trace.attempts) == 2


@pytest.mark.parametrize(
    "text",
    ["", "not json", '{"reason": "x", "actions": [{"agent": "Drone_T04", "command": "fire"}]}'],
)
async def test_an_unreadable_answer_is_held(rig: Rig, text: str) -> None:
    trace = await rig.run(ScriptedEngine([text]))
    assert trace.status == "held"
    assert "command_sent" not in rig.kinds()


@pytest.mark.parametrize(
    ("orders", "says"),
    [
        ([("Drone_T99", "hold")], "Drone_T99"),
        ([("Drone_T04", "move_to Moon")], "Moon"),
        ([("Drone_T04", "block EastGate")], "block"),
        ([("Drone_T04", "hold"), ("Drone_T04", "report")], "Drone_T04"),
    ],
)
async def test_impossible_orders_are_rejected_by_name_never_dropped(
    rig: Rig, orders: list[tuple[str, str]], says: str
) -> None:
    trace = await rig.run(ScriptedEngine([plan(*orders, ("Drone_T02", "report"))]))
    assert trace.status == "refused"
    assert says in trace.reason
    assert "command_sent" not in rig.kinds()


@pytest.mark.parametrize("verdict", ["", "maybe", EngineDiedError("the worker died")])
async def test_no_verdict_means_hold(rig: Rig, verdict: str | EngineDiedError) -> None:
    trace = await rig.run(ScriptedEngine([SPARE], [verdict]))
    assert trace.status == "held"
    assert "command_sent" not in rig.kinds()


async def test_a_dead_planner_holds_the_mission(rig: Rig) -> None:
    trace = await rig.run(ScriptedEngine([EngineDiedError("the worker died")]))
    assert trace.status == "held"
    assert "died" in trace.reason


async def test_a_judges_failure_needs_a_reason_to_be_overruled(rig: Rig) -> None:
    trace = await rig.run(ScriptedEngine([SPARE], [FAILURE]))
    assert trace.status == "rejected"
    assert "command_sent" not in rig.kinds()


async def test_an_override_is_logged_with_its_reason(rig: Rig) -> None:
    approver = standing_approver("auto", "the gate was checked by eye")
    trace = await rig.run(ScriptedEngine([SPARE], [FAILURE]), approver=approver)
    assert trace.status == "verified"
    assert trace.decision is not None
    assert trace.decision.override_judge
    assert trace.decision.reason == "the gate was checked by eye"


async def test_the_reason_for_an_override_stands_only_where_a_verdict_is_overruled(
    rig: Rig,
) -> None:
    approver = standing_approver("auto", "the gate was checked by eye")
    trace = await rig.run(ScriptedEngine([SPARE]), approver=approver)
    assert trace.decision is not None
    assert not trace.decision.override_judge
    assert trace.decision.reason == "approved by standing instruction"


async def test_an_inadmissible_approval_is_recorded_and_asked_again(rig: Rig) -> None:
    answers = iter([Decision(kind="approve"), Decision(kind="reject", reason="no")])
    trace = await rig.run(
        ScriptedEngine([SPARE], [FAILURE]), approver=lambda _request: next(answers)
    )
    assert [decision.accepted for decision in trace.decisions] == [False, True]
    assert trace.status == "rejected"


async def test_an_operators_plan_goes_through_the_same_safeguards(rig: Rig) -> None:
    bad = Plan.model_validate_json(UNCOVERS)
    requests: list[ApprovalRequested] = []

    def approver(request: ApprovalRequested) -> Decision:
        requests.append(request)
        return Decision(kind="modify", plan=bad) if len(requests) == 1 else Decision(kind="reject")

    trace = await rig.run(ScriptedEngine([SPARE]), approver=approver)
    assert requests[0].blocked_by == ()
    assert any("WF-03" in reason for reason in requests[1].blocked_by)
    assert trace.status == "refused"
    assert trace.attempts[1].author == "operator"


async def test_an_approved_plan_is_void_when_the_world_moved_under_it(rig: Rig) -> None:
    def fail_before_decision(event: Event, station: ControlStation) -> None:
        if isinstance(event.data, ApprovalRequested) and event.data.attempt == 1:
            station.inject(FailAsset(asset="Drone_T04"))

    engine = ScriptedEngine([SPARE, plan(("Ugv_T02", "move_to EastGate"))])
    trace = await rig.run(engine, on_event=fail_before_decision)
    assert "plan_voided" in rig.kinds()
    assert "Drone_T04" in trace.voided
    assert trace.status == "verified"
    assert all(c.command.agent == "Ugv_T02" for c in trace.commands.values())


async def test_a_mission_that_asks_for_force_is_refused_before_any_model_is_asked(
    rig: Rig,
) -> None:
    engine = ScriptedEngine([SPARE])
    trace = await rig.run(engine, text="Open fire on the truck at the loading dock.")
    assert trace.status == "refused"
    assert "ROE-01" in trace.reason
    assert engine.requests == []


async def test_the_outcome_is_unverified_when_an_asset_fails_on_the_way(rig: Rig) -> None:
    def fail_under_way(event: Event, station: ControlStation) -> None:
        if event.data.kind == "command_sent":
            station.inject(FailAsset(asset="Drone_T04"))

    trace = await rig.run(ScriptedEngine([SPARE]), on_event=fail_under_way)
    assert trace.status == "unverified"
    assert "Drone_T04" in trace.reason
    assert "plan_halted" in rig.kinds()


async def test_the_next_plan_is_made_from_a_picture_in_which_everybody_has_stopped(
    rig: Rig,
) -> None:
    def fail_under_way(event: Event, station: ControlStation) -> None:
        if event.data.kind == "telemetry":
            assets = event.data.picture.assets
            if assets["Drone_T04"].at is None and assets["Ugv_T02"].available:
                station.inject(FailAsset(asset="Ugv_T02"))

    orders = plan(("Drone_T04", "move_to EastGate"), ("Ugv_T02", "move_to NorthGate"))
    await rig.run(ScriptedEngine([orders, SPARE]), on_event=fail_under_way)
    halted = rig.kinds().index("plan_halted")
    digests = (e.data.digest for e in rig.events[halted:] if e.data.kind == "picture_digested")
    assert next(digests).posts["Drone_T04"] == "uav en route"


async def test_an_unknown_vehicle_is_observed_before_ground_assets_come_near(rig: Rig) -> None:
    orders = plan(("Drone_T04", "observe EastGate"), ("Robot_T01", "identify EastGate"))
    spawn = SpawnTrack(gate="EastGate", distance_m=60.0, identity="authorized")
    trace = await rig.run(ScriptedEngine([orders]), setup=[spawn])
    assert trace.status == "verified", trace.reason
    assert trace.report.count("Open track") == 1
    assert "identity authorized" in trace.report


async def test_whoever_is_to_be_warned_is_warned_once_it_is_known_who_that_is(rig: Rig) -> None:
    asked = "asked: warn vehicle at EastGate; At EastGate: Track_01 vehicle"
    first = plan(
        ("Drone_T04", "observe EastGate"), ("Robot_T01", "identify EastGate"), reason=asked
    )
    then = plan(("Robot_T01", "warn EastGate"), reason=asked)
    spawn = SpawnTrack(gate="EastGate", distance_m=40.0)
    trace = await rig.run(ScriptedEngine([first, then]), setup=[spawn])
    assert trace.status == "verified", trace.reason
    sent = [e.data.command.verb for e in rig.events if e.data.kind == "command_sent"]
    assert sent == ["observe", "identify", "warn"]


async def test_the_mission_measures_its_stages(rig: Rig) -> None:
    trace = await rig.run(ScriptedEngine([SPARE], [SUCCESS]))
    metrics = trace.metrics
    assert metrics is not None
    assert metrics.attempts == 1
    assert metrics.rehearsal_s > 0
    assert metrics.execution_s > 0
    assert metrics.end_to_end_s >= metrics.planning_s + metrics.checks_s + metrics.rehearsal_s
