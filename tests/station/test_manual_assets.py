"""An operator takes an asset, and the console sends it nothing until it is given back."""

import asyncio
from collections.abc import Callable
from contextlib import aclosing

import pytest

from pa_console.mission.approval import standing_approver
from pa_console.schema.events import event as ev
from pa_console.schema.incident import DriveByHand
from pa_console.schema.mission import Decision
from pa_console.session.state import SessionState
from pa_console.station.assembly import Site, open_station
from pa_console.station.clock import SteppedClock
from pa_console.station.station import ControlStation
from tests.rig import Rig
from tests.scripted import ScriptedEngine, plan

EAST = plan(("Drone_T04", "move_to EastGate"))
OTHER = plan(("Robot_T02", "move_to EastGate"))
SEND = "Send an asset to the east gate."
T04 = "Send Drone_T04 to the east gate."
Step = Callable[[ev.Event, ControlStation], object]


async def run(
    site: Site, text: str, step: Step, *plans: str, ends: int, limit_s: float = 300.0
) -> SessionState:
    """Give a mission, and do what `step` does, until that many missions have ended."""
    station = open_station(site, ScriptedEngine([*plans]).engine(), SteppedClock())
    state = SessionState()
    async with aclosing(station.run()) as events:
        async for event in events:
            state.apply(event)
            if isinstance(event.data, ev.SessionStarted):
                station.submit(text)
            step(event, station)
            if sum(trace.status is not None for trace in state.missions.values()) == ends:
                break
            assert state.time_s < limit_s, "the missions do not end"
    return state


class Hand:
    """Approves everything, takes and gives back where it is told to; keeps every event."""

    def __init__(self, **acts: Step) -> None:
        """`acts` are done once, at the first event of their kind."""
        self.acts, self.events = acts, list[ev.Event]()

    def __call__(self, event: ev.Event, station: ControlStation) -> None:
        """Take in one event."""
        self.events.append(event)
        act = self.acts.pop(event.data.kind, None)
        if act is not None:
            act(event, station)
        elif isinstance(event.data, ev.ApprovalRequested):
            station.decide(standing_approver("auto")(event.data))

    def sent(self, asset: str) -> list[str]:
        """Return the verbs of what was sent to `asset`, and where it was taken and given back."""
        found: list[str] = []
        for event in self.events:
            match event.data:
                case ev.CommandSent(command=command) | ev.CommandRefused(command=command):
                    if command.agent == asset:
                        found.append(
                            f"{'not ' * (event.data.kind != 'command_sent')}{command.verb}"
                        )
                case ev.ManualControlTaken(asset=name) if name == asset:
                    found.append("taken")
                case ev.ManualControlEnded(asset=name) if name == asset:
                    found.append("back")
                case _:
                    pass
        return found


def takes(_: ev.Event, station: ControlStation) -> None:
    station.submit("I'll drive Drone_T04 myself")


async def test_a_plan_under_way_is_halted_and_others_are_asked_about(site: Site) -> None:
    asked: list[ev.ApprovalRequested] = []

    def also_asks(event: ev.Event, station: ControlStation) -> None:
        hand(event, station)
        if isinstance(event.data, ev.ApprovalRequested):
            asked.append(event.data)

    hand = Hand(command_replied=takes)
    state = await run(site, SEND, also_asks, EAST, OTHER, ends=2)
    assert hand.sent("Drone_T04") == ["move_to", "taken"]
    halted = [event.data.reasons for event in hand.events if isinstance(event.data, ev.PlanHalted)]
    assert halted == [("Drone_T04 came under manual control on its way",)]
    assert [request.plan.agents for request in asked] == [("Drone_T04",), ("Robot_T02",)]
    assert state.missions[next(iter(state.missions))].status == "verified"
    assert set(state.manual) == {"Drone_T04"}
    assert state.manual["Drone_T04"].by == "operator"


async def test_a_mission_for_that_asset_awaits_it_and_is_asked_about_when_it_is_back(
    site: Site,
) -> None:
    def gives_back(_: ev.Event, station: ControlStation) -> None:
        station.submit("Give Drone_T04 back")

    hand = Hand(command_replied=takes, mission_awaits_assets=gives_back)
    state = await run(site, T04, hand, EAST, ends=4)
    assert hand.sent("Drone_T04") == ["move_to", "taken", "back", "move_to"]
    first, _, again, _ = state.missions.values()
    assert (first.status, again.status) == ("unverified", "verified")
    assert again.mission.text == first.mission.text
    requests = [e.mission for e in hand.events if isinstance(e.data, ev.ApprovalRequested)]
    assert requests.count(again.mission.id) == 1
    assert not state.manual
    assert not state.awaiting


async def test_an_approval_that_was_asked_before_is_worth_nothing_after(site: Site) -> None:
    def takes_then_approves(event: ev.Event, station: ControlStation) -> None:
        takes(event, station)
        assert isinstance(event.data, ev.ApprovalRequested)
        station.decide(Decision(kind="approve", request_id=event.data.request_id))

    hand = Hand(approval_requested=takes_then_approves)
    state = await run(site, T04, hand, EAST, ends=2)
    assert hand.sent("Drone_T04") == ["taken"]
    (first, *_) = state.missions.values()
    assert first.status == "refused"
    assert state.awaiting == {first.mission.id: ("Drone_T04",)}


async def test_only_a_stop_reaches_it(site: Site) -> None:
    def stops(_: ev.Event, station: ControlStation) -> None:
        station.stop_all()

    hand = Hand(command_replied=takes, manual_control_taken=stops)
    state = await run(site, T04, hand, EAST, ends=2)
    assert hand.sent("Drone_T04") == ["move_to", "taken", "hold"]
    assert not state.awaiting


async def test_what_a_fleet_reports_by_itself_counts_as_well(site: Site) -> None:
    def somebody_drives(_: ev.Event, station: ControlStation) -> None:
        station.inject(DriveByHand(asset="Drone_T04"))

    def lets_go(_: ev.Event, station: ControlStation) -> None:
        station.inject(DriveByHand(asset="Drone_T04", ends=True))
        waits.append(asyncio.ensure_future(station.advance(3.0)))

    waits = list[asyncio.Future[None]]()
    hand = Hand(command_replied=somebody_drives, mission_awaits_assets=lets_go)
    state = await run(site, T04, hand, EAST, ends=2)
    assert hand.sent("Drone_T04") == ["move_to", "move_to"]
    assert not state.awaiting
    assert [trace.status for trace in state.missions.values()] == ["unverified", "verified"]
    told = [e.data.text for e in hand.events if isinstance(e.data, ev.Noticed)]
    assert "under manual control" in told
    assert "no longer under manual control" in told


async def test_words_that_cannot_be_done_are_refused(rig: Rig) -> None:
    said: list[str] = []

    def refused(event: ev.Event, station: ControlStation) -> None:
        if not isinstance(event.data, ev.SessionStarted):
            return
        station.submit("Take over Drone_T01")
        for text in ("Take over Drone_T01", "give Robot_T01 back"):
            with pytest.raises(ValueError, match="manual control") as error:
                station.submit(text)
            said.append(str(error.value))
        with pytest.raises(ValueError, match="there is no asset 'Drone_T99'"):
            station.manual.take("Drone_T99")

    await rig.run(ScriptedEngine([EAST]), on_event=refused)
    assert said == [
        "Drone_T01 is under manual control, taken by operator already",
        "Robot_T01 is not under manual control; taken here: Drone_T01",
    ]
    assert [
        event.data.asset for event in rig.events if event.data.kind == "manual_control_taken"
    ] == ["Drone_T01"]
