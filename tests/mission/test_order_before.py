"""Orders that lean on the one before are read with its commands, others without."""

from collections.abc import Sequence
from datetime import UTC, datetime

import pytest

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.language.mention_check import check_mentions
from pa_console.language.references.scene import Move
from pa_console.llm.roles.prompts import compact_planner_prompt
from pa_console.mission.context import MissionContext, Services
from pa_console.mission.planning.picture_text import digest_picture
from pa_console.mission.understand import Understood, understand
from pa_console.policy.monitor import Monitor
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action, Plan
from pa_console.station.assembly import Site
from tests.scripted import ScriptedEngine

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
