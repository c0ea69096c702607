"""The fold keeps what each view shows, whatever arrives."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.schema import incident as inc
from pa_console.schema.base import ALARM_PRIORITIES, AlarmPriority
from pa_console.schema.command import CommandReply, DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Usage, Verdict
from pa_console.schema.incident import FailAsset, Incident
from pa_console.schema.mission import (
    Alarm,
    Decision,
    Metrics,
    Mission,
    QueueEntry,
    Verification,
)
from pa_console.session.state import SessionState
from pa_console.session.wording import incident_in_words
from pa_console.views.event_words import event_in_words
from tests.schema.strategies import PAYLOADS, events, models, values
from tests.session.logs import folded
from tests.session.story import PLAN, START, at, session_started, story
from tests.tui import living, site


def test_a_mission_is_told_from_intake_to_its_end() -> None:
    state = folded(story())
    trace = state.missions["M1"]
    assert trace.stage == "finished"
    assert trace.status == "verified"
    assert trace.attempts[0].plan == PLAN
    assert trace.decision is not None
    assert [reply.status for reply in trace.commands["c1"].replies] == ["done"]
    assert state.active is None
    assert state.current is trace
    assert state.ended == "quit"


def test_streamed_text_shows_until_the_whole_answer_is_there() -> None:
    session = story()
    streamed = next(i for i, e in enumerate(session) if isinstance(e.data, ev.TextStreamed))
    proposed = next(i for i, e in enumerate(session) if isinstance(e.data, ev.PlanProposed))
    assert folded(session[: streamed + 1]).missions["M1"].attempts[0].text == '{"rea'
    assert folded(session[: proposed + 1]).missions["M1"].attempts[0].text == "{}"


def test_an_open_approval_is_withdrawn_when_it_is_decided_voided_or_over() -> None:
    session = story()
    asked = next(i for i, e in enumerate(session) if isinstance(e.data, ev.ApprovalRequested))
    assert folded(session[: asked + 1]).missions["M1"].approval is not None
    voided = at(2.0, ev.PlanVoided(attempt=1, reason="the world moved"), "M1")
    assert folded([*session[: asked + 1], voided]).missions["M1"].approval is None
    assert folded(session).missions["M1"].approval is None


def test_attempts_keep_their_numbers_in_order_of_arrival() -> None:
    mission = Mission(id="M1", text="x", created=START)
    numbers = (1, 3, 1, 10**9, 0)
    state = folded(
        [
            at(0, ev.MissionReceived(mission=mission, position=0), "M1"),
            *(at(1, ev.RepairRequested(attempt=n, reasons=(str(n),)), "M1") for n in numbers),
        ]
    )
    attempts = state.missions["M1"].attempts
    assert [attempt.number for attempt in attempts] == [1, 3, 10**9, 0]
    assert [attempt.repair for attempt in attempts] == [("1",), ("3",), (str(10**9),), ("0",)]


def test_a_mission_that_was_never_received_does_not_become_the_active_one() -> None:
    state = folded([at(0, ev.MissionStarted(), "M9")])
    assert state.active is None
    assert state.current is None


@given(st.lists(events(), max_size=10))
@settings(max_examples=100, deadline=None)
def test_events_in_any_order_never_break_the_fold(happened: list[ev.Event]) -> None:
    state = folded(happened)
    current = state.current
    assert current is None or current.mission.id in state.missions
    assert state.tick == max([0, *(event.tick for event in happened)])


@pytest.mark.parametrize(
    ("incident", "words"),
    [
        (inc.SpawnTrack(gate="NorthGate", track="person"), "a person appears on the lane to"),
        (inc.FailAsset(asset="Uav_1"), "Uav_1 has stopped working"),
        (inc.RestoreAsset(asset="Uav_1"), "Uav_1 works again"),
        (inc.SetBattery(asset="Uav_1", percent=12.5), "battery of Uav_1 reads 12.5 %"),
        (inc.SetComms(asset="Uav_1", comms="lost"), "link of Uav_1 is lost"),
        (inc.PlaceAsset(asset="Uav_1", frame="Base"), "Uav_1 is placed at Base"),
        (inc.ClearTracks(gate="NorthGate"), "all tracks at NorthGate are gone"),
    ],
)
def test_an_incident_is_noticed_in_plain_words(incident: inc.Incident, words: str) -> None:
    state = folded([at(0, ev.IncidentHappened(incident=incident))])
    assert words in state.notices[-1].text


@pytest.mark.parametrize(
    ("decision", "words"),
    [
        (Decision(kind="modify", plan=PLAN), "plan 2: the plan was changed by operator"),
        (
            Decision(kind="approve", override_judge=True, acknowledged=("R-1",), reason="seen"),
            "plan 2: the judge was overridden, broken R-1 accepted by operator: seen",
        ),
    ],
)
def test_a_decision_against_what_was_proposed_is_noticed(decision: Decision, words: str) -> None:
    made = ev.DecisionMade(attempt=2, decision=decision, accepted=True)
    assert folded([at(0, made)]).notices[-1].text == words
    assert event_in_words(made).endswith(words.removeprefix("plan 2: "))


def test_an_approval_as_proposed_and_a_decision_not_taken_are_no_notice() -> None:
    for decision, accepted in (
        (Decision(kind="approve"), True),
        (Decision(kind="modify", plan=PLAN), False),
    ):
        made = ev.DecisionMade(attempt=2, decision=decision, accepted=accepted)
        assert not folded([at(0, made)]).notices


def test_a_notice_does_not_give_away_the_truth_behind_a_track() -> None:
    spawn = inc.SpawnTrack(gate="NorthGate", identity="authorized", intent="hostile")
    text = folded([at(0, ev.IncidentHappened(incident=spawn))]).notices[-1].text
    assert "hostile" not in text
    assert "authorized" not in text


def mission(name: str = "M1", **fields: object) -> Mission:
    return Mission.model_validate({"id": name, "text": "watch", "created": START} | fields)


def alarm(name: str, priority: AlarmPriority = "high", distance: float | None = None) -> Alarm:
    return Alarm(
        id=name, kind="unknown_track", priority=priority, subject="Track_01",
        text=f"{name} is near", raised_s=1.0, distance_m=distance,
    )  # fmt: skip


def fold_of(*told: ev.EventPayload | tuple[str, ev.EventPayload]) -> SessionState:
    state = SessionState()
    for count, item in enumerate(told):
        name, data = item if isinstance(item, tuple) else (None, item)
        state.apply(at(count, data, name))
    return state


def moved(phase: int, track: str = "Track_01", **fields: object) -> tuple[str, ev.WorkflowMoved]:
    given = {"workflow": "threat", "rule_id": "WF-01", "track": track, "phase": phase}
    phases = ("recon", "identify", "warn")
    return "M1", ev.WorkflowMoved.model_validate(given | {"phases": phases} | fields)


def received(name: str = "M1") -> ev.MissionReceived:
    return ev.MissionReceived(mission=mission(name), position=0)


def proposed(number: int) -> tuple[str, ev.PlanProposed]:
    return "M1", ev.PlanProposed(attempt=number, text="", plan=PLAN)


def test_alarms_stand_by_priority_then_distance_and_go_when_cleared() -> None:
    raised = [ev.AlarmRaised(alarm=a) for a in (
        alarm("low", "low"), alarm("far", "high", 80.0), alarm("near", "high", 9.0),
        alarm("worst", "emergency"),
    )]  # fmt: skip
    state = fold_of(*raised, ev.AlarmCleared(alarm_id="near", reason="it left"))
    assert [item.alarm.id for item in state.alarms] == ["worst", "far", "low"]
    assert "it left" in state.notices[-1].text


def test_an_alarm_is_acknowledged_until_it_gets_worse() -> None:
    seen = (ev.AlarmRaised(alarm=alarm("x")), ev.AlarmAcknowledged(alarm_id="x"))
    assert fold_of(*seen).alarms[0].acknowledged
    assert fold_of(*seen, ev.AlarmRaised(alarm=alarm("x", "low"))).alarms[0].acknowledged
    worse = fold_of(*seen, ev.AlarmRaised(alarm=alarm("x", "emergency")))
    assert not worse.alarms[0].acknowledged


@given(st.lists(st.tuples(st.sampled_from("abc"), st.sampled_from(ALARM_PRIORITIES),
                          st.sampled_from(("raise", "ack", "clear"))), max_size=12))  # fmt: skip
def test_only_raised_and_not_cleared_alarms_are_open(
    told: list[tuple[str, AlarmPriority, str]],
) -> None:
    state, expected = SessionState(), set[str]()
    for name, priority, what in told:
        if what == "raise":
            state.apply(at(0, ev.AlarmRaised(alarm=alarm(name, priority))))
            expected.add(name)
        elif what == "ack":
            state.apply(at(0, ev.AlarmAcknowledged(alarm_id=name)))
        else:
            state.apply(at(0, ev.AlarmCleared(alarm_id=name, reason="")))
            expected.discard(name)
    assert {item.alarm.id for item in state.alarms} == expected
    ranks = [ALARM_PRIORITIES.index(item.alarm.priority) for item in state.alarms]
    assert ranks == sorted(ranks)


def test_the_queue_is_as_it_was_told_last() -> None:
    entries = tuple(
        QueueEntry(mission=mission(name), priority="low", reason="first come") for name in "AB"
    )
    state = fold_of(ev.QueueChanged(entries=entries), ev.QueueChanged(entries=entries[1:]))
    assert [entry.mission.id for entry in state.queue] == ["B"]


def test_a_preempted_mission_waits_again_and_goes_on_counting_its_plans() -> None:
    start = (("M1", received()), ("M1", ev.MissionStarted()),
             proposed(1),
             ("M1", ev.ApprovalRequested(attempt=1, plan=PLAN)))  # fmt: skip
    gone = (*start, ("M1", ev.MissionPreempted(by="M2", reason="a threat at NorthGate")))
    state = fold_of(*gone)
    trace = state.missions["M1"]
    assert (state.active, trace.stage, trace.approval) == (None, "queued", None)
    assert "M2" in trace.preempted
    again = fold_of(*gone, ("M1", ev.MissionStarted()),
                   proposed(2)).missions["M1"]  # fmt: skip
    assert [(a.number, a.round) for a in again.attempts] == [(1, 0), (2, 1)]
    assert again.preempted == ""


def test_the_end_of_a_waiting_mission_leaves_the_active_one() -> None:
    ended = ev.MissionFinished(status="cancelled", reason="withdrawn", metrics=Metrics())
    state = fold_of(("M1", received()), ("M2", received("M2")), ("M1", ev.MissionStarted()),
                   ("M2", ended))  # fmt: skip
    assert state.active == "M1"
    assert state.current is state.missions["M1"]


def test_each_plan_of_a_workflow_belongs_to_its_phase() -> None:
    def plan(number: int, outcome: str) -> list[tuple[str, ev.EventPayload]]:
        command = DeviceCommand(command_id=f"c{number}", agent="Uav_1", verb="report")
        given = Verification.model_validate({"outcome": outcome, "actions": ()})
        approve = Decision(kind="approve")
        return [
            proposed(number),
            ("M1", ev.DecisionMade(attempt=number, decision=approve, accepted=True)),
            ("M1", ev.CommandSent(command=command)),
            moved(number),
            ("M1", ev.MissionVerified(verification=given, seconds=0.0)),
            ("M1", ev.OutcomeJudged(verdict=Verdict(verdict="Success", feedback=str(number)))),
        ]

    told = [("M1", received()), ("M1", ev.MissionStarted()), moved(0)]
    trace = fold_of(*told, *plan(1, "pass"), *plan(2, "unknown")).missions["M1"]
    assert [(a.phase, a.round) for a in trace.attempts] == [("recon", 0), ("identify", 1)]
    assert [v.round for v in trace.verified] == [0, 1]
    assert [v.verdict.feedback for v in trace.verified if v.verdict] == ["1", "2"]
    assert [c.round for c in trace.commands.values()] == [0, 1]
    assert trace.verification is not None
    assert trace.verification.outcome == "unknown"
    assert trace.phase == "warn"


def test_a_verdict_on_an_outcome_belongs_to_its_plan_however_late_it_comes() -> None:
    def done(number: int) -> list[tuple[str, ev.EventPayload]]:
        given = Verification(outcome="pass", actions=())
        approve = Decision(kind="approve")
        return [
            proposed(number),
            ("M1", ev.DecisionMade(attempt=number, decision=approve, accepted=True)),
            ("M1", ev.MissionVerified(verification=given, seconds=0.0)),
        ]

    def judged(number: int) -> tuple[str, ev.EventPayload]:
        verdict = Verdict(verdict="Success", feedback=str(number))
        return "M1", ev.OutcomeJudged(attempt=number, verdict=verdict, usage=Usage(seconds=0.5))

    ended = ev.MissionFinished(status="verified", reason="", metrics=Metrics())
    told = [("M1", received()), *done(1), *done(2), judged(1), ("M1", ended), judged(2)]
    trace = fold_of(*told).missions["M1"]
    assert [v.verdict.feedback for v in trace.verified if v.verdict] == ["1", "2"]
    assert trace.stage == "finished"
    assert trace.metrics is not None
    assert trace.metrics.outcome_s == pytest.approx(1.0)


def test_the_phase_is_of_the_first_track_that_has_one_left() -> None:
    told = (("M1", received()), moved(3, outcome="left"), moved(1, "Track_02"))
    trace = fold_of(*told).missions["M1"]
    assert trace.phase == "identify"
    assert list(trace.standings) == ["Track_01", "Track_02"]


def test_a_halted_plan_and_its_replacement_are_told_apart() -> None:
    halted = ev.PlanHalted(attempt=1, reasons=("Uav_1 failed",), safe_state=("Ugv_1 hold",))
    trace = fold_of(("M1", received()), proposed(1),
                   ("M1", halted),
                   proposed(2)).missions["M1"]  # fmt: skip
    assert trace.halts == [halted]
    assert [a.round for a in trace.attempts] == [0, 1]


def test_a_command_counts_how_often_it_was_sent_again() -> None:
    command = DeviceCommand(command_id="c1", agent="Uav_1", verb="report")
    told = (("M1", received()), ("M1", ev.CommandSent(command=command)),
            ("M1", ev.CommandResent(command_id="c1", times=2)),
            ("M1", ev.CommandResent(command_id="c9", times=2)))  # fmt: skip
    assert fold_of(*told).missions["M1"].commands["c1"].resent == 2


def test_a_stop_is_followed_by_asset_until_a_mission_starts() -> None:
    hold = DeviceCommand(command_id="stop1.1", agent="Uav_1", verb="hold")
    reply = CommandReply(command_id="stop1.1", agent="Uav_1", status="done", tick=5)
    sent, stop = ev.CommandSent(command=hold), ev.AllStopped(by="operator")
    for told in ((sent, stop), (stop, sent)):
        state = fold_of(*told, ev.CommandReplied(reply=reply))
        assert state.stop is not None
        assert [r.status for r in state.stop.orders["Uav_1"].replies] == ["done"]
    state = fold_of(stop, ("M1", received()), ("M1", ev.MissionStarted()))
    assert state.stop is None


def test_what_a_scenario_does_is_marked_as_hidden() -> None:
    incident = FailAsset(asset="Uav_1")
    for source, hidden in (("scenario", True), ("operator", False)):
        given = {"incident": incident, "source": source}
        state = fold_of(ev.IncidentHappened.model_validate(given))
        assert state.notices[-1].hidden is hidden


def test_the_scenario_is_that_of_the_session() -> None:
    assert fold_of().scenario == ""
    named = session_started().model_copy(update={"scenario": "situation-1"})
    assert fold_of(named).scenario == "situation-1"


@given(values(Incident))
@settings(max_examples=60, deadline=None)
def test_every_incident_can_be_said(incident: Incident) -> None:
    assert incident_in_words(incident)


@given(st.data())
@settings(max_examples=60, deadline=None)
def test_no_sequence_of_events_of_known_missions_breaks_the_fold(data: st.DataObject) -> None:
    names = ("M1", "M2")
    state = fold_of(*((name, received(name)) for name in names))
    for count in range(data.draw(st.integers(0, 12))):
        payload = data.draw(models(data.draw(st.sampled_from(PAYLOADS))))
        owner = data.draw(st.sampled_from((*names, "M9", None)))
        state.apply(at(count, payload, owner))
        assert state.current is not None
        for trace in state.missions.values():
            assert trace.phase is not None
            rounds = [attempt.round for attempt in trace.attempts]
            assert rounds == sorted(rounds)


def test_an_alarm_says_where_its_track_is_now() -> None:
    text = "Track_01: an unknown vehicle is approaching NorthGate, 90 m"
    alarm = living.UNKNOWN.model_copy(update={"text": text, "distance_m": 90.0})
    state = SessionState()
    track = site.track("Track_01", status="stopped", distance_m=15.2)
    for data in (ev.AlarmRaised(alarm=alarm),
                 ev.TelemetryReceived(picture=site.picture(tracks=(track,)))):  # fmt: skip
        state.apply(ev.Event(t=START, tick=1, data=data))
    (shown,) = state.alarms
    assert shown.alarm.text == "Track_01: an unknown vehicle has stopped at NorthGate, 15 m"
    assert shown.alarm.distance_m == 15.2
