"""Standing orders in a session: approved first, then they start missions that need approval too."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from pa_console.evaluation.twin import resimulate
from pa_console.mission.approval import Approver, standing_approver
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.events import event as ev
from pa_console.schema.incident import FailAsset, SetBattery
from pa_console.schema.mission import Decision
from pa_console.schema.rule import StandingLimits
from pa_console.session.log.chain import read_log
from pa_console.session.log.verification import verify
from pa_console.session.log.writer import LogWriter
from pa_console.session.state import SessionState
from pa_console.signing import KEY_VARIABLE, load_signer
from pa_console.station.assembly import Site, open_station
from pa_console.station.clock import SteppedClock
from pa_console.station.headless import run_missions
from pa_console.station.station import ControlStation
from pa_console.views.event_words import event_in_words
from tests.rig import Rig
from tests.scripted import ScriptedEngine, plan, sure_engine
from tests.station.earlier.test_resumed_session import SEND, killed, open_again
from tests.station.test_authorized_session import authority_of

ORDER = "Whenever a drone is below 20 %, relieve it."
ASKED = "asked: relieve Drone_T01 at WestGate"
RELIEF = plan(
    ("Drone_T04", "move_to WestGate"), ("Drone_T01", "return_to_base"), reason=f"{ASKED}; so be it"
)
LOW = SetBattery(asset="Drone_T01", percent=15.0)


def person(request: ev.ApprovalRequested) -> Decision:
    """Approve what an operator may approve."""
    return Decision(kind="approve", acknowledged=request.acknowledge)


def but_for_missions(request: ev.ApprovalRequested) -> Decision:
    """Approve standing orders and no plan."""
    return person(request) if request.standing else Decision(kind="reject", reason="not now")


def low_once_in_force(event: ev.Event, station: ControlStation) -> None:
    if isinstance(event.data, ev.StandingOrderApproved):
        station.inject(LOW)


async def play(
    rig: Rig,
    approver: Approver,
    text: str = ORDER,
    *,
    on_event: Callable[[ev.Event, ControlStation], None] = low_once_in_force,
    engine: ScriptedEngine | None = None,
    seconds: float = 20.0,
) -> SessionState:
    """Give `text` and let some time pass."""
    engine = engine or ScriptedEngine([RELIEF])
    await rig.carry_out(rig.station(engine), [text], approver, on_event, duration_s=seconds)
    return rig.state


def told(rig: Rig, kind: type) -> list[ev.Event]:
    return [event for event in rig.events if isinstance(event.data, kind)]


def missions_of(state: SessionState, order: str = "S1") -> list[str]:
    return [t.mission.text for t in state.missions.values() if t.mission.standing == order]


async def test_it_is_shown_with_its_condition_and_moves_nobody_before_it_is_approved(
    rig: Rig,
) -> None:
    requests: list[ev.ApprovalRequested] = []

    def rejects(request: ev.ApprovalRequested) -> Decision:
        requests.append(request)
        return Decision(kind="reject")

    state = await play(
        rig, rejects, on_event=lambda e, s: s.inject(LOW) if e.data.kind == "worker" else None
    )
    (request,) = requests
    assert request.standing is not None
    assert request.plan.actions == ()
    (trace,) = state.missions.values()
    assert trace.standing is not None
    order = trace.standing.order
    assert order.words == "a drone is below 20 % battery"
    assert order.condition == "it.kind == 'uav' && it.battery_pct < 20.0"
    assert [start.order for start in trace.standing.now] == ["Relieve Drone_T01."]
    assert (trace.status, state.standing) == ("rejected", {})
    assert not told(rig, ev.CommandSent)


async def test_it_starts_one_mission_for_one_occurrence_and_that_waits_for_approval(
    rig: Rig,
) -> None:
    asked: list[str] = []

    def approves(request: ev.ApprovalRequested) -> Decision:
        asked.append(request.request_id)
        return person(request)

    state = await play(rig, approves, seconds=60.0)
    assert missions_of(state) == ["Relieve Drone_T01."]
    assert len(asked) == 2, "the order and its mission"
    (trace,) = [t for t in state.missions.values() if t.mission.standing]
    assert trace.mission.source == "standing"
    assert trace.decision is not None
    assert trace.decision.standing_order == ""
    standing = state.standing["S1"]
    assert standing.started == 1
    assert standing.last is not None
    assert (standing.last.subject, standing.last.mission) == ("Drone_T01", trace.mission.id)
    assert not standing.in_force, "it ends with the session"
    (began,) = told(rig, ev.StandingOrderStarted)
    assert event_in_words(began.data) == "by S1 for Drone_T01"


async def test_a_mission_that_it_started_can_be_rejected_and_is_not_started_again(
    rig: Rig,
) -> None:
    state = await play(rig, but_for_missions, seconds=60.0)
    assert missions_of(state) == ["Relieve Drone_T01."]
    assert not told(rig, ev.CommandSent)


async def test_an_instruction_given_beforehand_approves_no_standing_order(rig: Rig) -> None:
    state = await play(rig, standing_approver("auto", "whatever"))
    assert state.standing == {}
    (trace,) = state.missions.values()
    assert (trace.status, trace.reason) == (
        "rejected",
        "a standing order is approved by somebody who reads it, and nobody did",
    )


@pytest.mark.parametrize(
    ("text", "asks"),
    [
        ("Whenever the moon is full, relieve a drone.", "condition of this standing order"),
        ("Whenever the drone is below 20 %, relieve it.", "condition of this standing order"),
        ("Relieve a drone whenever it is below 20 %.", "Write: Whenever CONDITION, ORDER"),
        ("Each time a gate has no guard, do its thing.", "What does “its” stand for"),
        ("Whenever a drone is below 20 %, lorem ipsum dolor sit amet.", "not understood"),
        ("If a drone ever fails, relieve it at most 99 times an hour.", "How many times an hour"),
    ],
)
async def test_what_is_not_understood_gets_a_question_and_no_guess(
    rig: Rig, text: str, asks: str
) -> None:
    state = await play(rig, person, text)
    (trace,) = state.missions.values()
    assert asks in trace.questions[0].question
    assert (trace.status, state.standing, trace.attempts) == ("held", {}, [])


async def test_a_question_is_answered_by_saying_it_anew(rig: Rig) -> None:
    answers = [Decision(kind="answer", asked=ORDER)]
    state = await play(
        rig,
        lambda r: answers.pop() if r.state == "not_understood" else person(r),
        "Whenever the moon is full, relieve a drone.",
    )
    assert missions_of(state) == ["Relieve Drone_T01."]


async def test_the_rules_refuse_an_order_for_force_also_where_it_is_to_hold(rig: Rig) -> None:
    state = await play(rig, person, "Whenever somebody comes to a gate, shoot him.")
    (trace,) = state.missions.values()
    assert (trace.status, trace.decisions) == ("refused", [])
    assert "ROE-01" in trace.reason


async def test_the_same_twice_is_blocked(rig: Rig) -> None:
    def again(event: ev.Event, station: ControlStation) -> None:
        if isinstance(event.data, ev.StandingOrderApproved):
            station.submit(ORDER)

    state = await play(
        rig, lambda r: Decision(kind="reject") if r.blocked_by else person(r), on_event=again
    )
    *_, second = state.missions.values()
    assert (second.status, second.reason) == ("held", "S1 says the same and is in force")
    assert len(state.standing) == 1


async def test_a_revoked_order_starts_nothing_and_takes_back_what_waits(rig: Rig) -> None:
    def revokes(event: ev.Event, station: ControlStation) -> None:
        if isinstance(event.data, ev.StandingOrderApproved):
            station.submit("Watch the checkpoint and say what you see.")
            station.inject(LOW)
        if isinstance(event.data, ev.StandingOrderStarted):
            station.change_standing("S1", "revoke")
            station.inject(SetBattery(asset="Drone_T02", percent=10.0))

    state = await play(rig, person, on_event=revokes, engine=ScriptedEngine([plan()]))
    (trace,) = [t for t in state.missions.values() if t.mission.standing]
    assert (trace.status, trace.reason) == ("cancelled", "standing order S1 was revoked")
    assert state.standing["S1"].ended == "revoked by operator"
    assert len(told(rig, ev.StandingOrderStarted)) == 1


async def test_nothing_is_started_while_everything_is_stopped_nor_by_the_release(
    rig: Rig,
) -> None:
    def stops(event: ev.Event, station: ControlStation) -> None:
        match event.data:
            case ev.MissionFinished() if not station.stopped and "all_stopped" not in rig.kinds():
                station.stop_all()
                station.inject(LOW)
            case ev.TelemetryReceived(picture=picture) if picture.time_s >= 8 and station.stopped:
                station.release()
            case _:
                pass

    state = await play(rig, person, on_event=stops, seconds=30.0)
    assert state.standing["S1"].started == 0
    assert missions_of(state) == []


def allowing(site: Site, *verbs: str, approvals: dict[str, int] | None = None) -> Site:
    """Return the checkpoint with rules that leave `verbs` to standing orders."""
    book, old = site.rulebook, site.rulebook.rule_set
    assert old is not None
    limits = StandingLimits.model_validate({"allowed": verbs})
    changed = old.model_copy(update={"standing": limits, "approvals": approvals or {}})
    rules = Rulebook(
        book.name, book.sha256, book.compiled, book.workflows, book.seal, rule_set=changed
    )
    return replace(site, rulebook=rules)


UNASKED = "Whenever a drone is below 20 %, relieve it without asking."


@pytest.mark.parametrize(
    ("verbs", "text", "unasked"),
    [
        (("move_to", "return_to_base"), UNASKED, True),
        (("move_to", "return_to_base"), ORDER, False),
        (("move_to",), UNASKED, False),
        ((), UNASKED, False),
    ],
)
async def test_it_approves_by_itself_only_where_it_says_so_and_the_rules_allow_it(
    rig: Rig, verbs: tuple[str, ...], text: str, unasked: bool
) -> None:
    rig.site = allowing(rig.site, *verbs)
    state = await play(rig, but_for_missions, text, engine=sure_engine(ASKED, RELIEF, "WestGate"))
    (trace,) = [t for t in state.missions.values() if t.mission.standing]
    assert trace.decision is not None
    assert trace.decision.standing_order == ("S1" if unasked else "")
    assert bool(told(rig, ev.CommandSent)) is unasked
    if unasked:
        assert trace.decision.by == "standing instruction: standing order S1"
        assert trace.status == "verified"


def low_while_a_gate_is_bare(event: ev.Event, station: ControlStation) -> None:
    if isinstance(event.data, ev.StandingOrderApproved):
        station.inject(FailAsset(asset="Drone_T03"))
    low_once_in_force(event, station)


async def test_a_warning_that_holds_without_its_plan_does_not_keep_it_from_approving(
    rig: Rig,
) -> None:
    """The bare gate has an alarm of its own; the relief neither opens nor closes it."""
    rig.site = allowing(rig.site, "move_to", "return_to_base")
    engine = sure_engine(ASKED, RELIEF, "WestGate")
    state = await play(
        rig, but_for_missions, UNASKED, on_event=low_while_a_gate_is_bare, engine=engine
    )
    (trace,) = [t for t in state.missions.values() if t.mission.standing]
    request = next(e.data for e in told(rig, ev.ApprovalRequested) if e.mission == trace.mission.id)
    assert isinstance(request, ev.ApprovalRequested)
    assert request.acknowledge == request.broken_anyway == ("WF-07",)
    assert trace.decision is not None
    assert trace.decision.standing_order == "S1"
    assert trace.status == "verified"


async def test_a_plan_that_two_people_must_approve_is_rejected_by_it(rig: Rig) -> None:
    rig.site = allowing(rig.site, "move_to", "return_to_base", approvals={"move_to": 2})
    state = await play(rig, person, UNASKED, engine=sure_engine(ASKED, RELIEF, "WestGate"))
    (trace,) = [t for t in state.missions.values() if t.mission.standing]
    assert trace.status == "rejected"
    assert "move_to needs 2 people" in trace.reason
    assert not told(rig, ev.CommandSent)


async def test_a_doubtful_plan_of_it_waits_for_the_operator(rig: Rig) -> None:
    rig.site = allowing(rig.site, "move_to", "return_to_base")
    other = plan(("Drone_T04", "move_to WestGate"), reason="asked: Drone_T04 to WestGate")
    asked: list[ev.ApprovalRequested] = []

    def looks(request: ev.ApprovalRequested) -> Decision:
        asked.append(request)
        return but_for_missions(request)

    await play(rig, looks, UNASKED, engine=ScriptedEngine([other]))
    assert len(asked) == 2
    assert not told(rig, ev.CommandSent)


async def test_its_missions_are_signed_as_standing_where_there_are_keys(site: Site) -> None:
    allowed = allowing(site, "move_to", "return_to_base")
    authority = authority_of(allowed)
    engine = sure_engine(ASKED, RELIEF, "WestGate")
    station = open_station(allowed, engine.engine(), SteppedClock(), authority=authority)
    made: list[ev.DecisionMade] = []

    def sink(event: ev.Event, _: SessionState) -> None:
        low_once_in_force(event, station)
        if isinstance(event.data, ev.DecisionMade):
            made.append(event.data)

    _, trace = await run_missions(station, [UNASKED], but_for_missions, sink, duration_s=20.0)
    assert trace.status == "verified", trace.reason
    kinds = [
        authority.trust.approval("ann", each.decision.signatures["ann"], authority.now())[0]["kind"]
        for each in made
    ]
    assert kinds == ["operator", "standing"]


async def test_the_log_tells_of_it_holds_and_comes_to_the_same_in_a_replay(
    rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(KEY_VARIABLE, str(tmp_path / "key" / "key.pem"))
    station = rig.station(sure_engine(ASKED, RELIEF, "WestGate"))
    log = tmp_path / "one.jsonl"
    with LogWriter(log, station.session, signer=load_signer()) as writer:
        station.write_to(writer)
        await rig.carry_out(station, [ORDER], person, low_once_in_force, duration_s=20.0)
    assert verify(log).intact
    again, events = SessionState(), list(read_log(log))
    for event in events:
        again.apply(event)
    assert again.standing == rig.state.standing
    assert again.standing["S1"].started == 1
    assert resimulate(events, rig.site.world).equal


async def test_none_goes_on_with_a_session_whose_console_was_killed(
    site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(KEY_VARIABLE, str(tmp_path / "key" / "key.pem"))

    def waits(event: ev.Event, station: ControlStation) -> bool:
        if event.data.kind == "session_started":
            station.submit(ORDER)
            station.submit(SEND)
        low_once_in_force(event, station)
        if isinstance(event.data, ev.ApprovalRequested):
            station.decide(person(event.data))
        waiting = event.data.entries if isinstance(event.data, ev.QueueChanged) else ()
        return any(entry.mission.standing for entry in waiting)

    found = await killed(site, tmp_path, waits)
    assert len(found.started_by_standing) == 1
    station = open_again(site, found, ScriptedEngine([RELIEF]))
    happened: list[ev.Event] = []

    def sink(event: ev.Event, _: SessionState) -> None:
        happened.append(event)

    await run_missions(station, [ORDER], but_for_missions, sink)
    told = [event.data for event in happened]
    (ended,) = [data for data in told if isinstance(data, ev.StandingOrderRevoked)]
    assert (ended.order_id, ended.by) == ("S1", "the console")
    held = [e.mission for e in happened if isinstance(e.data, ev.MissionFinished)]
    assert found.started_by_standing[0] in held
    (anew,) = [data for data in told if isinstance(data, ev.StandingOrderApproved)]
    assert anew.order.id != "S1", "given again it is another one"
