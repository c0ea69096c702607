"""Random sessions in which two assets are driven by hand, among orders, alarms, clocks and stops.

Every event is held against the books: to an asset in a hand nothing is sent but a stop's hold; what
it is sent after it is back was approved after that; and no mission that awaits it is lost.
"""

import asyncio
from collections import Counter
from contextlib import aclosing, suppress
from random import Random

from pa_console.mission.approval import standing_approver
from pa_console.schema.events import event as ev
from pa_console.schema.incident import DriveByHand, SetBattery
from pa_console.schema.mission import Decision
from pa_console.session.state import SessionState
from pa_console.station.assembly import Site, open_station
from pa_console.station.clock import SteppedClock
from pa_console.station.station import ControlStation
from tests.scripted import SUCCESS, ScriptedEngine, plan

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
