"""An operator takes an asset, and the console sends it nothing until it is given back."""

import asyncio
from collections import Counter
from collections.abc import Callable
from contextlib import aclosing, suppress
from random import Random

import pytest

from pa_console.mission.approval import standing_approver
from pa_console.schema.events import event as ev
from pa_console.schema.incident import DriveByHand, SetBattery
from pa_console.schema.mission import Decision
from pa_console.session.state import SessionState
from pa_console.station.assembly import Site, open_station
from pa_console.station.clock import SteppedClock
from pa_console.station.station import ControlStation
from tests.rig import Rig
from tests.scripted import SUCCESS, ScriptedEngine, plan

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


SESSIONS, STEPS = 16, 24
HANDS = ("Drone_T04", "Robot_T02")
PLANS = [
    plan(("Drone_T04", "move_to EastGate")),
    plan(("Robot_T02", "move_to SouthGate")),
    plan(("Drone_T04", "move_to SouthGate"), ("Robot_T02", "move_to Checkpoint")),
    plan(("Drone_T04", "return_to_base")),
    plan(("Ugv_T02", "move_to EastGate")),
]
ORDERS = (
    "Drone_T04 to the east gate.", "Robot_T02 to the south gate.", "Drone_T04 home.",
    "Send an asset to the east gate.", "In five seconds send Drone_T04 to the east gate.",
    "Every minute send Robot_T02 to the south gate.",
    "Whenever a drone is below 20 %, return it to base without asking.",
)  # fmt: skip


class Books:
    """What a session may send by what has happened in it."""

    def __init__(self) -> None:
        self.state = SessionState()
        self.reported: set[str] = set()
        self.back: dict[str, int] = {}
        """The number of the event by which an asset was let go last."""
        self.approved: dict[str, int] = {}
        """The number of the event that approved the plan of a mission last."""
        self.counts: Counter[str] = Counter()
        self._number = 0

    def take(self, event: ev.Event) -> None:
        """Hold one event against the books."""
        self._number += 1
        match event.data:
            case ev.TelemetryReceived(picture=picture):
                driven = {name for name, asset in picture.assets.items() if asset.manual}
                for name in (self.reported - driven) | (driven - self.reported):
                    self.back[name] = self._number
                self.reported = driven
            case ev.ManualControlTaken() | ev.ManualControlEnded():
                self.back[event.data.asset] = self._number
                self.counts[event.data.kind] += 1
            case ev.DecisionMade(accepted=True, decision=decision) if event.mission:
                if decision.kind == "approve":
                    self.approved[event.mission] = self._number
            case ev.CommandSent(command=command):
                self._sent(event.mission, command.agent, command.command_id)
            case ev.MissionAwaitsAssets(again=again):
                self.counts["given anew" if again else "awaits"] += 1
            case ev.AllStopped():
                self.counts["forgotten"] += len(self.state.awaiting)
            case _:
                pass
        self.state.apply(event)

    def _sent(self, mission: str | None, asset: str, command_id: str) -> None:
        if command_id.startswith("stop"):
            self.counts["holds"] += asset in self.reported
            return
        assert asset not in self.state.manual, "to an asset that an operator has taken"
        assert asset not in self.reported, "to an asset that reports manual control"
        assert mission is not None
        since = self.back.get(asset, 0)
        assert self.approved[mission] > since, "approved before somebody drove it"
        self.counts["sent"] += asset in self.back


def one_thing(station: ControlStation, books: Books, random: Random) -> None:
    """Let an operator, or somebody at an asset, do one thing; ValueError where that cannot be."""
    hand = random.choice(HANDS)
    match random.randrange(10):
        case 0 | 1:
            station.submit(f"Take over {hand}")
        case 2 | 3:
            station.submit(f"Give {hand} back")
        case 4:
            ends = hand in books.reported and hand not in books.state.manual
            station.inject(DriveByHand(asset=hand, ends=ends))
        case 5 if random.random() < 0.4:
            station.stop_all("anna")
        case 6:
            station.inject(SetBattery(asset="Drone_T04", percent=random.choice((10.0, 90.0))))
        case _:
            station.submit(random.choice(ORDERS))
    if station.stopped and random.random() < 0.7:
        station.release("anna")


async def play(site: Site, random: Random) -> Counter[str]:
    """Play one session to its end; return how often what happened."""
    plans = [random.choice(PLANS) for _ in range(400)]
    station = open_station(site, ScriptedEngine(plans, [SUCCESS]).engine(), SteppedClock())
    books, approve = Books(), standing_approver("auto")
    begun = asyncio.Event()

    async def follow() -> None:
        async with aclosing(station.run()) as events:
            async for event in events:
                books.take(event)
                begun.set()

    def decide() -> None:
        current = books.state.current
        request = current.approval if current is not None else None
        if request is None or not station.awaits_decision or decided[request.request_id] > 1:
            return
        given = request.standing is not None and not request.blocked_by
        kind = "approve" if given else approve(request).kind
        if decided[request.request_id]:
            kind = "reject"  # what was not accepted would be asked for ever
        decided[request.request_id] += 1
        decision = Decision(kind=kind, by="anna", request_id=request.request_id)
        station.decide(decision)

    async def pass_time(seconds: float) -> None:
        waiting = asyncio.create_task(station.advance(seconds))
        while not waiting.done():
            decide()
            await asyncio.sleep(0)

    decided = Counter[str]()

    following = asyncio.create_task(follow())
    await begun.wait()
    for _ in range(STEPS):
        with suppress(ValueError):
            one_thing(station, books, random)
        for _ in range(random.randrange(1, 4)):
            await pass_time(random.choice((0.2, 1.0, 4.0)))
    await station.close("over")
    await following
    counts = books.counts
    assert counts["awaits"] == counts["given anew"] + counts["forgotten"] + len(
        books.state.awaiting
    )
    return counts


async def test_in_random_sessions_nothing_reaches_an_asset_in_a_hand(site: Site) -> None:
    counts = Counter[str]()
    for seed in range(SESSIONS):
        counts += await play(site, Random(seed))
    for what in ("manual_control_taken", "sent", "awaits", "given anew", "holds"):
        assert counts[what], f"no session has any: {what}"
