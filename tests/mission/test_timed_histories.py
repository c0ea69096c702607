"""Thousands of random histories of timed orders on a clock that jumps, sleeps and goes back.

Another station takes command in between, and this one takes it back: nothing that was approved
before is sent then.
"""

from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from itertools import takewhile
from random import Random

import pytest

from pa_console.language.references.scene import Move
from pa_console.mission.gate import CommandGate
from pa_console.mission.orders.agenda import Agenda, StationTime, TimingLimits
from pa_console.mission.orders.standing import Due, Ended, StandingOrders, Withheld
from pa_console.mission.rehearse import device_commands
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision, Schedule, StandingOrder
from pa_console.schema.plan import Action, Plan
from pa_console.schema.telemetry import Picture
from pa_console.session.log.journal import Journal
from tests.mission.gate import Link

BEGAN = datetime(2026, 3, 1, 9, 0, tzinfo=UTC)
GRACE_S = 60.0
HISTORIES, STEPS = 2000, 60
RULES = Rulebook("none", "", ())
EAST = Plan(reason="r", actions=(Action(agent="Drone_T04", command="move_to EastGate"),))


@dataclass
class Command:
    """The right of this station to command, in place of the keys of a site."""

    refusal: str = ""

    def objection(self, _: Rulebook) -> str:
        """Return why nothing may be sent."""
        return self.refusal

    def fresh(self, _: set[str]) -> tuple[str, ...]:
        """Return the vehicles that know no roster: none."""
        return ()

    def valid(self, *_: object) -> dict[str, str]:
        """Return the signatures that count."""
        return {"anna": "signed"}

    def grant(self, *_: object) -> None:
        """Take in an approval."""


@dataclass
class History:
    """One session: the wall clock and the fleet's clock, what was started, and what was not."""

    random: Random
    wall: datetime = BEGAN
    time_s: float = 0.0
    rate: float = 1.0
    stopped: bool = False
    orders: StandingOrders = field(init=False)
    missions: dict[str, str] = field(default_factory=dict[str, str])
    moments: dict[str, set[datetime]] = field(default_factory=dict[str, set[datetime]])
    skipped: dict[str, set[datetime]] = field(default_factory=dict[str, set[datetime]])
    accounted: dict[str, int] = field(default_factory=dict[str, int])
    """The moments of each order that became a mission, a reason, or were skipped."""
    out_of_force: set[str] = field(default_factory=set[str])
    paused: set[str] = field(default_factory=set[str])
    count: int = 0
    command: Command = field(default_factory=Command)
    link: Link = field(default_factory=Link)

    def __post_init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Begin anew, as a console that was started again: nothing is in force."""
        if hasattr(self, "orders"):
            self.out_of_force |= {order.id for order in self.orders.orders}
        self.missions.clear()
        self.paused.clear()
        self.orders = StandingOrders(StationTime(lambda: self.wall))
        self.orders.limits = TimingLimits(grace_s=GRACE_S)
        self.orders.skip_ids([*self.accounted, "S0"])
        self.gate = CommandGate(self.link, Journal(), self.command, self.orders)  # pyright: ignore[reportArgumentType]

    def relieve_or_take_back(self) -> None:
        """Another station takes command, or this one takes it back with a session of its own."""
        if self.command.refusal:
            self.command.refusal = ""
            self.restart()
        else:
            self.command.refusal = "another station is in command"

    def send(self, mission: str) -> None:
        """Approve a plan of a mission that has been started, and send it where that is allowed."""
        request = ev.ApprovalRequested(request_id=f"{mission}.1", attempt=1, plan=EAST)
        commands, before = device_commands(EAST, request.request_id), len(self.link.sent)
        if self.command.refusal:
            with pytest.raises(ValueError, match="another station"):
                self.gate.grant(request, Decision(kind="approve"), RULES)
            self.gate.send(commands, lambda _: None)
            assert len(self.link.sent) == before, "none while another station is in command"
            return
        self.gate.grant(request, Decision(kind="approve"), RULES)
        self.gate.send(commands, lambda _: None)
        assert self.link.sent[before:] == [*commands]

    def approve(self) -> None:
        """Put one more order in force."""
        random = self.random
        every_s = random.choice([0.0, 60.0, 300.0, 86400.0])
        start = self.orders.time.now + timedelta(seconds=random.choice([0, 5, 90, 3600]))
        schedule = Schedule(
            start=start,
            every_s=every_s,
            until=start + timedelta(hours=2) if every_s and random.random() < 0.3 else None,
            times=random.choice([0, 3]) if every_s else 0,
            stay_s=30.0 if not every_s and random.random() < 0.3 else 0.0,
        )
        order = StandingOrder(
            id=self.orders.new_id(), text=f"{self.count}", schedule=schedule, words="then",
            order=f"Send Drone_T04 to the east gate {random.random()}.",
        )  # fmt: skip
        self.orders.approve(Agenda(order))
        self.accounted[order.id] = 0
        self.moments[order.id], self.skipped[order.id] = set(), set()

    def look(self) -> None:
        """Let the station look, and hold every result against what must never be."""
        self.orders.time.take(self.time_s, self.rate)
        picture = Picture(
            tick=0, time_s=self.time_s, weather="clear", assets={}, tracks={}, gates={}
        )
        before = {order.id for order in self.orders.orders}
        for found in self.orders.look(picture, stopped=self.stopped):
            match found:
                case Due(order=order, late_s=late_s):
                    assert order.id in before, "no run without approval, none after revocation"
                    assert not self.stopped, "none while everything is stopped"
                    assert order.id not in self.paused
                    assert order.id not in self.missions.values(), "none beside its last one"
                    assert 0.0 <= late_s <= GRACE_S, "none later than allowed"
                    at = self.orders.time.now - timedelta(seconds=late_s)
                    back = found.start.order.endswith("back to Base.")
                    if not back:
                        assert at not in self.moments[order.id], "none twice"
                        assert at not in self.skipped[order.id], "none that was skipped"
                        self.moments[order.id].add(at)
                        self.accounted[order.id] += 1
                    self.count += 1
                    name = f"M{self.count}"
                    self.missions[name] = order.id
                    self.orders.started(name, found)
                    self.send(name)
                case Withheld(order=order, reason=reason):
                    assert reason
                    many = reason.split(" moments from")
                    self.accounted[order.id] += int(many[0]) if len(many) > 1 else 1
                case Ended(order=order):
                    self.out_of_force.add(order.id)
                case _:
                    pass
        assert not self.out_of_force & {order.id for order in self.orders.orders}

    def none_lost(self) -> None:
        """Every moment that has passed is a mission, has a reason, or was skipped."""
        for order in self.orders.orders:
            schedule = order.schedule
            assert schedule is not None
            if schedule.stay_s:
                continue
            moments = schedule.moments(100_000)
            passed = sum(1 for _ in takewhile(self.orders.time.now.__ge__, moments))
            assert self.accounted[order.id] >= passed

    def step(self) -> None:
        """Let one thing happen."""
        random = self.random
        match random.choices(
            ("go", "jump", "back", "sleep", "stop", "end", "revoke", "pause", "skip", "approve",
             "restart", "relieve"),
            (50, 5, 4, 4, 4, 25, 3, 5, 5, 6, 1, 2),
        )[0]:  # fmt: skip
            case "go":
                seconds = random.choice([0.5, 5.0, 45.0])
                self.wall += timedelta(seconds=seconds)
                self.rate = random.choice([1.0, 1.0, 8.0])
                self.time_s += seconds * self.rate
            case "jump":
                self.wall += timedelta(seconds=random.choice([30, 3600, 90000]))
            case "back":
                self.wall -= timedelta(seconds=random.choice([1, 600, 3600]))
            case "sleep":
                self.wall += timedelta(hours=random.choice([0.1, 3]))
            case "stop":
                self.stopped = not self.stopped
            case "end" if self.missions:
                name = random.choice(list(self.missions))
                order = self.missions.pop(name)
                moves = (Move("Drone_T04", "move_to", "EastGate", "Base"),)
                if random.random() < 0.7:
                    self.orders.moves(name, {"Drone_T04"}, moves)
                told = self.orders.ended(name, self.time_s, "Base")
                assert told is None or told[0].id == order
            case "revoke" | "pause" | "skip" as change if self.orders.orders:
                self.change(change, random.choice(self.orders.orders).id)
            case "approve" if len(self.orders.orders) < 8:
                self.approve()
            case "restart":
                self.restart()
            case "relieve":
                self.relieve_or_take_back()
            case _:
                pass

    def change(self, change: str, order: str) -> None:
        """Revoke or skip an order, or let it pause or go on."""
        if change == "revoke":
            self.orders.revoke(order)
            self.out_of_force.add(order)
            self.missions = {name: by for name, by in self.missions.items() if by != order}
        elif change == "pause":
            self.orders.pause(order, paused=order not in self.paused)
            self.paused ^= {order}
        else:
            try:
                self.skipped[order].add(self.orders.skip(order))
                self.accounted[order] += 1
            except ValueError:
                pass


@pytest.mark.parametrize("part", range(2))
def test_in_any_history_none_runs_unapproved_twice_late_or_is_lost_in_silence(part: int) -> None:
    started = sent = 0
    for seed in range(part, HISTORIES, 2):
        history = History(Random(seed))
        history.approve()
        for _ in range(STEPS):
            history.step()
            history.look()
        history.none_lost()
        started, sent = started + history.count, sent + len(history.link.sent)
    assert started > sent > HISTORIES / 4, "the histories have runs, some without command"


def test_the_station_clock_is_the_wall_clock_unless_the_simulation_runs_faster() -> None:
    wall = BEGAN
    time = StationTime(lambda: wall)
    time.take(0.0)
    for late_s, time_s in ((3.0, 0.5), (3.1, 3.0), (10.0, 10.0)):
        wall = BEGAN + timedelta(seconds=late_s)
        time.take(time_s)
        assert time.now == wall, "a hold-up and the catching up after it change nothing"
    wall += timedelta(seconds=1.0)
    time.take(18.0, 8.0)
    assert time.now == wall + timedelta(seconds=7.0)
