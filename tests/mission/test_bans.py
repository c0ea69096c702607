"""Standing bans: a prohibition that is to last is offered, and no plan or command passes it."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.language.mood import lasting_ban
from pa_console.mission.examine import banned
from pa_console.mission.gate import CommandGate
from pa_console.mission.orders.standing import StandingBan, StandingOrders
from pa_console.mission.rehearse import device_commands
from pa_console.schema.command import COMMANDS, STILL, Verb
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Ban, Decision, StandingOrder
from pa_console.schema.plan import Action, Plan
from pa_console.session.log.journal import Journal
from pa_console.station.assembly import Site
from pa_training.situations.worlds import shipped_world
from tests.mission.gate import send
from tests.rig import Rig
from tests.scripted import ScriptedEngine, plan

pytestmark = pytest.mark.invariant

WORLD = shipped_world()
NOBODY_SOUTH = Ban(places=("SouthGate",))


def person(request: ev.ApprovalRequested) -> Decision:
    return Decision(kind="approve", request_id=request.request_id)


def standing(*bans: Ban) -> StandingOrders:
    orders = StandingOrders()
    for ban in bans:
        order = StandingOrder(
            id=orders.new_id(), text="no", ban=ban, words="from now on", order=f"no {ban}"
        )
        orders.approve(StandingBan(order))
    return orders


@pytest.mark.parametrize(
    ("text", "ban"),
    [
        ("Nobody goes to the south gate.", NOBODY_SOUTH),
        ("Drone_T04 must never fly to the east gate.",
         Ban(assets=("Drone_T04",), places=("EastGate",))),
        ("No ground robot enters the checkpoint tonight.",
         Ban(assets=("Robot_T01", "Robot_T02"), places=("Checkpoint",))),
        ("Do not send Drone_T04 to the east gate.", None),
        ("Send Drone_T04 to the east gate.", None),
        ("Nobody goes to the south gate. Send Robot_T01 to the north gate.", None),
    ],
)  # fmt: skip
def test_a_prohibition_that_is_to_last_is_a_ban(text: str, ban: Ban | None) -> None:
    assert lasting_ban(WORLD, text) == ban


async def test_a_ban_is_offered_and_then_blocks_the_plans_that_break_it(rig: Rig) -> None:
    scripted = ScriptedEngine([plan(("Drone_T04", "move_to SouthGate"))])
    await rig.run(scripted, text="Nobody goes to the south gate tonight.", approver=person)
    [offered] = [e.data.order for e in rig.events if isinstance(e.data, ev.StandingOrderRead)]
    assert offered.ban == NOBODY_SOUTH
    assert any(isinstance(e.data, ev.StandingOrderApproved) for e in rig.events)
    assert not any(isinstance(e.data, ev.CommandSent) for e in rig.events)


MOVING: list[Verb] = [verb for verb in COMMANDS if verb not in STILL]
names = st.sampled_from(list(WORLD.assets))
places = st.sampled_from(list(WORLD.frames))
bans = st.builds(
    Ban,
    assets=st.lists(names, max_size=2).map(tuple),
    places=st.lists(places, max_size=2).map(tuple),
)


@st.composite
def actions(draw: st.DrawFn) -> Action:
    verb = draw(st.sampled_from(MOVING))
    command = f"{verb} {draw(places)}" if COMMANDS[verb].takes_frame else verb
    return Action(agent=draw(names), command=command)


@given(st.lists(bans, min_size=1, max_size=3, unique_by=repr), actions())
def test_whatever_is_banned_is_found_in_a_plan_and_stopped_at_the_gate(
    site: Site, forbidden: list[Ban], action: Action
) -> None:
    orders = standing(*forbidden)
    goal = WORLD.base if action.verb == "return_to_base" else action.target
    hit = any(
        (not ban.assets or action.agent in ban.assets) and (not ban.places or goal in ban.places)
        for ban in forbidden
    )
    made = Plan(reason="x", actions=(action,))
    assert bool(banned(made, WORLD, orders)) == hit
    gate = CommandGate(SimulatedFleet.start(site.world), Journal(), orders=orders)
    request = ev.ApprovalRequested(request_id="M1.1", attempt=1, plan=made, state="approve")
    gate.grant(request, Decision(kind="approve", request_id="M1.1"), site.rulebook)
    for command in device_commands(made, "M1.1"):
        passed = not isinstance(send(gate, command), ev.CommandRefused)
        assert passed != hit


def test_a_ban_that_is_paused_or_revoked_bans_nothing() -> None:
    orders = standing(NOBODY_SOUTH)
    assert orders.banned_by("Drone_T04", "SouthGate") is not None
    orders.pause("S1", paused=True)
    assert orders.banned_by("Drone_T04", "SouthGate") is None
    orders.pause("S1", paused=False)
    orders.revoke("S1")
    assert orders.banned_by("Drone_T04", "SouthGate") is None
