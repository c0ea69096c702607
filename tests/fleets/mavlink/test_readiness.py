"""What a vehicle sends is asked for until it comes; what keeps it from arming is on its card."""

from pa_console.fleets.link import NotReady
from pa_console.fleets.mavlink.commands import Cmd
from pa_console.fleets.mavlink.messages import RequestedMessages, needed_messages
from pa_console.schema.world import World
from tests.fleets.mavlink.scripted import AGENT, Rig

COMPASS = "PreArm: Compass not calibrated"


def said(rig: Rig) -> list[str]:
    return [news.why for news in rig.news if isinstance(news, NotReady)]


def test_a_check_before_arming_is_on_the_card_and_refuses_orders_until_it_passes(
    world: World,
) -> None:
    rig = Rig(world, flies=False, kind="ardupilot").ready()
    rig.flight.checked(may_arm=False)
    rig.flight.said({"severity": 2, "text": COMPASS})
    rig.flight.step()
    assert said(rig)[-1] == COMPASS
    assert not [text for text in rig.notices() if "PreArm" in text]
    assert Cmd.RUN_PREARM_CHECKS in rig.autopilot.asked()
    rig.order("c1", "move_to", "EastGate")
    assert rig.answers("c1") == ["refused"]
    assert rig.detail("c1") == f"not ready: {COMPASS}"
    rig.flight.checked(may_arm=True)
    rig.flight.step()
    assert said(rig)[-1] == ""
    rig.order("c2", "move_to", "EastGate")
    assert rig.answers("c2") != ["refused"]


def test_a_drone_without_a_position_estimate_is_not_ready_and_raises_no_alarm(
    world: World,
) -> None:
    rig = Rig(world, flies=False)
    nowhere = {**rig.message(), "lat": 0, "lon": 0}
    rig.flight.positioned(nowhere, rig.arrival())
    rig.flight.step()
    assert said(rig) == ["it has no position estimate yet"]
    assert rig.notices() == []


def test_a_drone_in_flight_is_never_not_ready(world: World) -> None:
    rig = Rig(world).ready()
    rig.flight.checked(may_arm=False)
    rig.flight.step()
    assert said(rig) in ([], [""])


def test_a_battery_that_is_not_reported_is_reported_as_unknown(world: World) -> None:
    rig = Rig(world)
    rig.flight.state.battery_pct = None
    rig.report()
    rig.wait(6.0)
    assert rig.last().agent == AGENT
    assert rig.last().battery_pct is None


def test_messages_are_asked_for_until_they_come_and_again_after_silence() -> None:
    watch = RequestedMessages(needed_messages("uav", 0.25), began_s=0.0)
    first = {needed.name for needed in watch.due(0.0)}
    assert first == {
        "GLOBAL_POSITION_INT", "SYS_STATUS", "EXTENDED_SYS_STATE", "HOME_POSITION"
    }  # fmt: skip
    assert watch.due(1.0) == []
    watch.heard("SYS_STATUS", 1.0)
    assert {needed.name for needed in watch.due(3.5)} == first - {"SYS_STATUS"}
    assert "SYS_STATUS" in {needed.name for needed in watch.due(8.0)}
    watch.ask_again(8.1)
    assert {needed.name for needed in watch.due(8.1)} == first


def test_a_message_that_never_comes_is_missing_and_a_rover_lacks_no_flight_state() -> None:
    watch = RequestedMessages(needed_messages("ugv", 0.25), began_s=0.0)
    for now in range(20):
        watch.heard("HEARTBEAT", float(now))
        watch.heard("GLOBAL_POSITION_INT", float(now))
    assert [needed.name for needed in watch.missing(19.0)] == ["SYS_STATUS"]
