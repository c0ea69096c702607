"""Whatever clients say, the station hears no decision but one on what it has shown them."""

import asyncio
from datetime import UTC, datetime
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.fleets.station_authority import Keys, StationAuthority
from pa_console.http.bodies import DecisionBody
from pa_console.http.guard import ProblemError
from pa_console.http.served_session import ServedSession
from pa_console.http.tokens import Bearer
from pa_console.mission.approval import inadmissible
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision, Mission
from pa_console.schema.plan import Action, Plan
from pa_console.session.state import SessionState
from pa_console.station.station import ControlStation
from pa_console.views.session_views import shown_sha256
from tests.mission.test_two_people import keys_of

NOW = datetime(2026, 1, 1, tzinfo=UTC)
ANNA = Bearer("anna", "operator")
KINDS = ("approve", "reject", "modify", "choose", "answer")


class Heard:
    """A station that tells the decisions that it hears, and takes each."""

    def __init__(self) -> None:
        self.decisions: list[Decision] = []
        self.session: ServedSession | None = None

    def decide(self, decision: Decision) -> None:
        """Note a decision; its event comes later, as a station's does."""
        self.decisions.append(decision)
        made = ev.DecisionMade(attempt=1, decision=decision, accepted=True)
        event = ev.Event(t=NOW, tick=1, mission="M1", data=made)
        assert self.session is not None
        asyncio.get_running_loop().call_soon(self.session.take, event)


def waiting(
    *requests: ev.ApprovalRequested, keys: Keys | None = None
) -> tuple[ServedSession, Heard]:
    """Return a session in which the last of `requests` waits, and its station."""
    authority = StationAuthority(keys) if keys is not None else None
    state, heard = SessionState(), Heard()
    mission = Mission(id="M1", text="Fill the gap.", created=NOW)
    told = (ev.MissionReceived(mission=mission, position=0), ev.MissionStarted(), *requests)
    for data in told:
        state.apply(ev.Event(t=NOW, tick=0, mission="M1", data=data))
    session = ServedSession(cast(ControlStation, heard), state, lambda: None, authority=authority)
    heard.session = session
    return session, heard


def decide(session: ServedSession, body: DecisionBody, who: Bearer = ANNA) -> Any:
    return asyncio.run(session.decide(who, body))


actions = st.builds(
    Action,
    agent=st.sampled_from(("Drone_T01", "Drone_T04")),
    command=st.sampled_from(("hold", "move_to EastGate")),
)
plans = st.builds(
    Plan, reason=st.sampled_from(("a", "b")), actions=st.lists(actions, max_size=2).map(tuple)
)
requests = st.builds(
    ev.ApprovalRequested,
    request_id=st.sampled_from(("M1.1", "M1.2")),
    attempt=st.just(1),
    plan=plans,
    blocked_by=st.sampled_from(((), ("WF-03: uncovered",))),
    acknowledge=st.sampled_from(((), ("CAP-08",))),
    needs_override=st.booleans(),
    readings=st.sampled_from(((), ("1 drone to EastGate",))),
)


@given(st.lists(requests, min_size=1, max_size=3), st.data())
def test_no_decision_is_heard_but_on_what_is_shown_and_admissible(
    history: list[ev.ApprovalRequested], data: st.DataObject
) -> None:
    session, heard = waiting(*history)
    seen, shown = data.draw(st.sampled_from(history)), history[-1]
    body = DecisionBody(
        kind=data.draw(st.sampled_from(KINDS)),
        request_id=seen.request_id,
        shown_sha256=shown_sha256(seen),
        reason=data.draw(st.sampled_from(("", "because"))),
        override_judge=data.draw(st.booleans()),
        acknowledged=data.draw(st.sampled_from(((), ("CAP-08",)))),
        asked=data.draw(st.sampled_from(("", "1 drone to EastGate"))),
        actions=data.draw(st.sampled_from((None, ()))),
    )
    told, refused = None, 0
    try:
        told = decide(session, body)
    except ProblemError as problem:
        refused = problem.details.status
    if told is None:
        assert refused in (409, 422)
        assert heard.decisions == []
        return
    (decision,) = heard.decisions
    assert seen == shown
    assert inadmissible(shown, decision) == ""
    assert (decision.request_id, decision.by) == (shown.request_id, "anna")
    assert not decision.standing
    assert decision.signatures == {}
    assert told.accepted


@given(requests, requests)
def test_requests_that_differ_in_anything_have_different_hashes(
    one: ev.ApprovalRequested, other: ev.ApprovalRequested
) -> None:
    assert (shown_sha256(one) == shown_sha256(other)) == (one == other)


def test_nobody_is_made_to_have_signed_what_another_has_approved() -> None:
    request = ev.ApprovalRequested(request_id="M1.1", attempt=1, plan=Plan(reason="", actions=()))
    body = DecisionBody(kind="approve", request_id="M1.1", shown_sha256=shown_sha256(request))
    session, heard = waiting(request, keys=keys_of("ann"))
    with pytest.raises(ProblemError) as refused:
        decide(session, body)
    assert refused.value.details.status == 403
    assert heard.decisions == []
    assert decide(session, body.model_copy(update={"kind": "reject"})).accepted
    assert decide(session, body, Bearer("ann", "operator")).by == "ann"


def test_where_nothing_waits_nothing_is_decided() -> None:
    session, heard = waiting()
    body = DecisionBody(kind="approve", request_id="M1.1", shown_sha256="0" * 64)
    with pytest.raises(ProblemError, match="no plan is waiting"):
        decide(session, body)
    assert heard.decisions == []
