"""What is no order moves nobody: not by the words, not by a reading, not by any decision."""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.language.mention_check import check_mentions
from pa_console.language.references.scene import Move
from pa_console.llm.roles.compact_prompts import compact_planner_prompt
from pa_console.mission.approval import (
    CheckedPlan,
    OrderAsRead,
    approval_state,
    inadmissible,
    request_approval,
    standing_approver,
)
from pa_console.mission.context import MissionContext, Services
from pa_console.mission.gate import CommandGate
from pa_console.mission.planning.picture_text import digest_picture
from pa_console.mission.rehearse import device_commands
from pa_console.mission.spelling import question_back, respell
from pa_console.mission.understand import Understood, understand
from pa_console.policy.monitor import Monitor
from pa_console.schema.command import STILL
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Verdict
from pa_console.schema.mission import Decision, Mission
from pa_console.schema.plan import Action, Plan
from pa_console.session.confidence import UNSURE
from pa_console.session.log.journal import Journal
from pa_console.station.assembly import Site
from pa_console.station.headless import run_missions
from tests.mission.gate import send
from tests.rig import Rig
from tests.scripted import ScriptedEngine, plan

TEXTS = yaml.safe_load(
    (Path(__file__).parents[1] / "language" / "data" / "no_orders.yaml").read_text("utf-8")
)
MOVE = Action(agent="Drone_T04", command="move_to EastGate")
MOVES = Plan(reason="asked: 1 drone to EastGate; Free drone: Drone_T04", actions=(MOVE,))

orders_as_read = st.builds(
    OrderAsRead,
    asked=st.sampled_from(["", "asked: 1 drone to EastGate"]),
    readings=st.sampled_from([(), ("asked: 1 drone to NorthGate",)]),
    gaps=st.sampled_from([(), ("not accounted for: base",)]),
    confidence=st.none() | st.floats(0.0, 1.0),
    read_apart=st.booleans(),
    narrowed=st.booleans(),
    question=st.sampled_from(["", "what is to be done?"]),
)
decisions = st.builds(
    Decision,
    kind=st.sampled_from(["approve", "modify", "choose"]),
    reason=st.just("seen by eye"),
    override_judge=st.booleans(),
    plan=st.just(MOVES),
    asked=st.just("asked: 1 drone to NorthGate"),
)
verdicts = st.sampled_from([Verdict(verdict="Success"), Verdict(verdict="Failure")])


@given(orders_as_read, st.booleans(), st.booleans(), st.booleans())
def test_a_plan_is_approve_only_where_nothing_speaks_against_it(
    read: OrderAsRead, blocked: bool, objected: bool, warned: bool
) -> None:
    state = approval_state(read, blocked=blocked, objected=objected, warned=warned)
    unsure = read.confidence is not None and read.confidence < UNSURE
    doubted = unsure or bool(read.gaps) or read.read_apart
    worst = [
        (bool(read.question), "not_understood"),
        (blocked, "blocked"),
        (objected, "judge_objects"),
        (doubted, "may_be_misunderstood"),
        (warned, "warned"),
        (read.narrowed, "narrowed"),
    ]
    assert state == next((name for holds, name in worst if holds), "approve")


@given(orders_as_read, verdicts, decisions)
def test_for_an_order_that_was_not_understood_no_decision_moves_anybody(
    read: OrderAsRead, verdict: Verdict, decision: Decision
) -> None:
    request = request_approval("M1.1", 1, CheckedPlan(MOVES, verdict=verdict), read)
    if not read.question:
        assert request.state != "not_understood"
        return
    assert request.state == "not_understood"
    assert (request.plan.actions, request.readings, request.if_halted) == ((), (), ())
    assert inadmissible(request, decision)


@pytest.mark.parametrize("kind", ["approve", "modify", "choose"])
def test_the_last_gate_lets_no_movement_pass_for_it_whoever_asks(site: Site, kind: str) -> None:
    gate = CommandGate(SimulatedFleet.start(site.world), Journal())
    request = ev.ApprovalRequested(attempt=1, plan=MOVES, state="not_understood")
    decision = Decision.model_validate({"kind": kind, "plan": MOVES, "asked": "x"})
    with pytest.raises(ValueError, match="say it anew"):
        gate.grant(request, decision, site.rulebook)
    for command in device_commands(MOVES, "M1.1"):
        assert command.verb not in STILL
        assert isinstance(send(gate, command), ev.CommandRefused)


@given(orders_as_read, verdicts, st.floats(0.0, 1.0), st.sampled_from(["", "seen by eye"]))
def test_a_standing_instruction_takes_approve_alone(
    read: OrderAsRead, verdict: Verdict, least: float, override: str
) -> None:
    request = request_approval("M1.1", 1, CheckedPlan(MOVES, verdict=verdict), read)
    decision = standing_approver("auto", override, least=least)(request)
    if decision.kind == "approve":
        overruled = request.state == "judge_objects" and override
        assert request.state == "approve" or (overruled and not read.gaps and not read.read_apart)


@pytest.mark.parametrize("kind", TEXTS)
async def test_what_is_no_order_is_asked_back_about_or_moves_nobody(rig: Rig, kind: str) -> None:
    """Whatever a planner makes of it: this one moves a drone that nobody named."""
    answer = plan(("Drone_T04", "move_to EastGate"), reason=MOVES.reason)
    for text in TEXTS[kind]:
        rig.events.clear()
        trace = await rig.run(ScriptedEngine([answer]), text=text)
        assert trace.status in ("held", "rejected", "refused"), text
        assert not any(isinstance(event.data, ev.CommandSent) for event in rig.events), text


@pytest.mark.parametrize(
    ("text", "asked"),
    [
        ("Send it home.", "Which asset is meant by “it”?"),
        ("Close the window, it is draughty.", "it names nobody and nothing of this site"),
    ],
)
async def test_who_is_meant_is_asked_of_an_order_that_only_points(
    rig: Rig, text: str, asked: str
) -> None:
    both = plan(
        ("Drone_T04", "move_to EastGate"),
        ("Robot_T01", "move_to EastGate"),
        reason="asked: Drone_T04, Robot_T01 to EastGate; Drone_T04: free",
    )
    station = rig.station(ScriptedEngine([both]))
    traces = await run_missions(
        station,
        ["Drone_T04 and Robot_T01 to the east gate.", text],
        standing_approver("auto", least=0.0),
        lambda event, _state: rig.events.append(event),
    )
    assert traces[1].status == "held"
    assert asked in traces[1].reason


@pytest.mark.parametrize(
    "text",
    [
        "asdf qwer",
        "Schick die Drohne zum Osttor.",
        "Envoie Drone_T04 à EastGate tout de suite",
        "lorem ipsum dolor sit amet",
    ],
)
async def test_what_is_not_english_is_asked_back_as_it_was_typed(rig: Rig, text: str) -> None:
    trace = await rig.run(ScriptedEngine([plan(("Drone_T04", "move_to EastGate"))]), text=text)
    assert (trace.approval_state, trace.mission.text, trace.attempts) == (
        "not_understood",
        text,
        [],
    )
    assert "in English?" in trace.reason


@pytest.mark.parametrize(
    "text",
    [
        "snd a dron to teh noth gaet",
        "Recognise and colour-code the vehicle at the centre, please",
        "R1 -> west, now",
        "Freeze.",
        "drone 4 east gate",
        "Please tell Señora Pérez that Drone_T04 goes home, bitte.",
    ],
)
def test_a_misspelt_or_terse_order_is_one(site: Site, text: str) -> None:
    read = respell(text, site.world, site.rulebook)
    assert question_back(text, read, site.world, site.rulebook) == ""


THEN = datetime(2026, 1, 1, tzinfo=UTC)
SENT = (Move("Drone_T04", "move_to", "EastGate", "Checkpoint"),)


async def understood(site: Site, text: str, moves: Sequence[Move] = SENT) -> Understood:
    """Return how `text` is understood after an order with these `moves`."""
    services = Services.open(
        SimulatedFleet.start(site.world), site.rulebook, ScriptedEngine([]).engine()
    )
    before = Mission(id="M1", text="Drone_T04 to EastGate", created=THEN)
    services.past.remember(before, moves, undid=False, corrects=False)
    mission = Mission(id="M2", text=text, created=THEN)
    monitor = Monitor(site.rulebook, site.world, services.sightings)
    read = await understand(MissionContext(services, mission, lambda _event: None, monitor), {})
    assert isinstance(read, Understood)
    return read


async def test_words_that_lean_on_the_order_before_come_with_its_commands(site: Site) -> None:
    read = await understood(site, "correction, south. I said east, I meant south")
    commands = "Drone_T04 move_to EastGate from Checkpoint"
    assert read.mission.follows == commands
    assert [(one.said, one.means) for one in read.references][-1] == ("the order before", commands)


@pytest.mark.parametrize(
    "text",
    [
        "Send Robot_T01 to the north gate.",
        "Drone_T02 home.",
        "Report, all drones.",
        "Somebody to the west gate.",
    ],
)
async def test_an_order_that_stands_by_itself_comes_without(site: Site, text: str) -> None:
    assert (await understood(site, text)).mission.follows == ""


async def test_nothing_is_leant_on_where_nothing_was_ordered(site: Site) -> None:
    text = "correction, south. I said east, I meant south"
    assert (await understood(site, text, ())).mission.follows == ""


def test_the_planner_reads_the_commands_before_the_words(site: Site) -> None:
    picture = SimulatedFleet.start(site.world).picture()
    digest, follows = digest_picture(picture, site.world), "Drone_T04 move_to EastGate"
    mission = Mission(id="M2", text="the south one", created=THEN, follows=follows)
    end = f'Before: {follows}\nMission: "the south one"'
    assert compact_planner_prompt(site.world, digest, [], mission).user.endswith(end)


def test_what_was_named_before_need_not_be_named_again(site: Site) -> None:
    picture = SimulatedFleet.start(site.world).picture()
    plan = Plan(reason="", actions=(Action(agent="Drone_T04", command="move_to SouthGate"),))
    words = "the south one, rather", "asked: Drone_T04 to SouthGate"
    follows = "Drone_T04 move_to EastGate from Checkpoint"
    alone = check_mentions(site.world, picture, *words, plan)
    after = check_mentions(site.world, picture, *words, plan, follows=follows)
    assert "not in the order's words: Drone_T04" in alone.gaps
    assert after.gaps == ()
