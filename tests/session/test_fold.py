"""The fold keeps what each view shows, whatever arrives."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.schema import incident as inc
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision, Mission
from pa_console.views.event_words import event_in_words
from tests.schema.strategies import events
from tests.session.logs import folded
from tests.session.story import PLAN, START, at, story


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
