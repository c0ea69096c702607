"""Thousands of random histories: what standing orders start, and what may be dispatched for it.

The histories keep books of their own. Whatever happens in whatever order: nothing is started
without an order that is approved, not revoked, and whose condition has become true; nothing while
everything is stopped, nothing twice for one occurrence, nothing by its own effect, never more than
the limit; and nothing is sent without the approval that its mission needs.
"""

from dataclasses import dataclass, field
from random import Random

import pytest

from pa_console.mission.approval import people_needed, unasked_decision
from pa_console.mission.gate import CommandGate
from pa_console.mission.orders.standing import (
    HOUR_S,
    REST_S,
    RETRY_S,
    SETTLE_S,
    Due,
    StandingOrders,
    Withheld,
)
from pa_console.mission.rehearse import device_commands
from pa_console.policy.rulebook import Rulebook
from pa_console.policy.standing_conditions import StandingCondition
from pa_console.schema.command import DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.mission import ApprovalState, Decision, StandingOrder
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rule import Rule, RuleSet, StandingLimits
from pa_console.schema.telemetry import Picture
from pa_console.session.log.journal import Journal
from tests.mission.gate import WORLD, Link, send
from tests.mission.pictures import GATES, asset, picture

HISTORIES, STEPS = 1000, 25
POSTS = (("Drone_T01", GATES[0]), ("Drone_T02", GATES[1]))
NAMES = tuple(name for name, _ in POSTS)
RULE = Rule(id="ROE-01", domain="ROE", priority="high", text="r")
LIMITS = StandingLimits(allowed=("observe", "return_to_base"))
BOOKS = [
    Rulebook("r", "", (), rule_set=RuleSet(name="r", rules=(RULE,), standing=limits, approvals=two))
    for limits in (LIMITS, StandingLimits())
    for two in ({}, {"observe": 2})
]
PLANS = [
    Plan(reason="r", actions=tuple(Action(agent="Drone_T01", command=c) for c in commands))
    for commands in (("observe EastGate",), ("return_to_base",), ("move_to EastGate",), ("hold",))
]
STATES: tuple[ApprovalState, ...] = ("approve", "approve", "may_be_misunderstood", "narrowed")
CHARGES = (10.0, 20.5, 21.5, 22.5, 80.0)
REPORTS = {
    (name, charge, stale): asset(name, "uav", gate, battery_pct=charge, stale=stale)
    for name, gate in POSTS
    for charge in CHARGES
    for stale in (False, True)
}
BASE = picture(*(REPORTS[name, 80.0, False] for name in NAMES))
GAPS_S = (0.5, 0.5, 1.0, 1.0, 5.0, REST_S - 1.0, REST_S, REST_S + 2.0, HOUR_S / 3)

CONDITIONS = [
    StandingCondition(
        StandingOrder(
            id=f"S{number}",
            text="t",
            each="asset",
            condition=f"it.battery_pct < {percent}.0",
            words="w",
            order="Relieve {it}.",
            unasked=unasked,
            most_an_hour=most,
        ),
        WORLD,
    )
    for number, (percent, unasked, most) in enumerate(
        ((20, False, 1), (21, True, 2), (22, True, 3), (23, False, 6)), start=1
    )
]
BELOW = {"S1": 20.0, "S2": 21.0, "S3": 22.0, "S4": 23.0}


@dataclass
class Subject:
    """How the histories themselves follow one subject of one order."""

    true_since_s: float | None = None
    true_last_s: float = -1e9
    started: bool = False
    """Whether nothing more may be started in this occurrence."""
    settled: bool = False
    """Whether the orders have decided on this occurrence at least once."""
    mission: str = ""
    not_before_s: float = 0.0


@dataclass
class Moved:
    """Whom a mission of an order moves, from when, and when it was over."""

    names: set[str]
    since_s: float
    ended_s: float | None = None

    def explains(self, subject: str, true_since_s: float) -> bool:
        """Whether what has been so of `subject` since then may be its effect."""
        over = self.ended_s is not None and true_since_s - self.ended_s >= REST_S
        return subject in self.names and true_since_s > self.since_s and not over


@dataclass
class History:
    """One session, and what it may do by the histories' own books."""

    random: Random
    orders: StandingOrders = field(default_factory=StandingOrders)
    approved: set[str] = field(default_factory=set[str])
    stopped: bool = False
    now_s: float = 0.0
    subjects: dict[tuple[str, str], Subject] = field(default_factory=dict[tuple[str, str], Subject])
    starts: dict[str, list[float]] = field(default_factory=dict[str, list[float]])
    open: dict[str, Due] = field(default_factory=dict[str, Due])
    moved: dict[str, Moved] = field(default_factory=dict[str, Moved])
    granted: set[DeviceCommand] = field(default_factory=set[DeviceCommand])
    count: int = 0
    events: int = 0

    def __post_init__(self) -> None:
        self.link = Link()
        self.gate = CommandGate(self.link, Journal(), None, self.orders)  # pyright: ignore[reportArgumentType]
        self.assets = dict(BASE.assets)

    def step(self) -> None:
        """Let one thing happen, then look at the picture."""
        chosen = self.random.randrange(8)
        if chosen == 0:
            self.approve()
        elif chosen == 1:
            self.revoke()
        elif chosen == 2:
            self.stop_or_release()
        elif chosen == 3 and self.open:
            self.decide()
        elif chosen == 4 and self.open:
            self.end()
        self.look()

    def approve(self) -> None:
        """Put an order in force that is not."""
        condition = self.random.choice(CONDITIONS)
        name = condition.order.id
        if name in self.approved:
            return
        self.orders.approve(condition)
        self.approved.add(name)
        for key in [key for key in self.subjects if key[0] == name]:
            del self.subjects[key]
        self.starts[name] = []

    def revoke(self) -> None:
        """Take an order out of force, or try to."""
        name = self.random.choice(list(BELOW))
        if name in self.approved:
            self.orders.revoke(name)
            self.approved.discard(name)
        else:
            with pytest.raises(ValueError, match="is in force"):
                self.orders.revoke(name)

    def stop_or_release(self) -> None:
        """Stop everything, or release the stop."""
        if self.stopped:
            self.gate.release()
        else:
            for hold in self.gate.stop_all():
                send(self.gate, hold)
            self.granted.clear()
            self.open.clear()
        self.stopped = not self.stopped

    def picture(self) -> Picture:
        """Return a picture in which batteries and links are something else."""
        for name in NAMES:
            charge, stale = self.random.choice(CHARGES), self.random.random() < 0.15
            self.assets[name] = REPORTS[name, charge, stale]
        return BASE.model_copy(update={"assets": dict(self.assets), "time_s": self.now_s})

    def look(self) -> None:
        """Let time pass, and let the orders look at what the picture shows then."""
        self.now_s += self.random.choice(GAPS_S)
        seen = self.picture()
        busy = {self.random.choice(NAMES)} if self.random.random() < 0.1 else set[str]()
        self.follow(seen)
        for found in self.orders.look(seen, busy, stopped=self.stopped):
            assert isinstance(found, Due | Withheld)
            subject = self.subjects[found.order.id, found.subject]
            subject.settled = True
            if isinstance(found, Withheld):
                subject.started = not found.reason.startswith("waits ")
                continue
            self.check(found, busy)
            self.count += 1
            subject.mission = mission = f"M{self.count:03d}"
            self.orders.started(mission, found)
            self.open[mission] = found
            self.events += 1
        if self.stopped:
            for subject in self.subjects.values():
                subject.started = subject.started or subject.true_since_s is not None

    def follow(self, seen: Picture) -> None:
        """Note by the histories' own reckoning of what each condition is true now."""
        for name in self.approved:
            for each, report in seen.assets.items():
                subject = self.subjects.setdefault((name, each), Subject())
                if report.stale:
                    if subject.true_since_s is not None:
                        subject.true_last_s = self.now_s
                    continue
                if report.battery_pct < BELOW[name]:
                    if subject.true_since_s is None:
                        self.subjects[name, each] = subject = Subject(self.now_s)
                    subject.true_last_s = self.now_s
                elif subject.true_since_s is not None and (
                    not (subject.started or subject.settled)
                    or self.now_s - subject.true_last_s >= REST_S
                ):
                    self.subjects[name, each] = Subject()

    def check(self, due: Due, busy: set[str]) -> None:
        """Refuse what must never be started."""
        name = due.order.id
        assert name in self.approved, "no approved, unrevoked standing order"
        assert not self.stopped, "everything is stopped"
        assert due.subject not in busy
        subject = self.subjects[name, due.subject]
        assert subject.true_since_s is not None, "its condition has not become true"
        assert self.assets[due.subject].battery_pct < BELOW[name]
        assert self.now_s - subject.true_since_s >= SETTLE_S
        assert not subject.started, "twice for one occurrence"
        assert self.now_s >= subject.not_before_s, "too soon after a mission that failed"
        since_s = subject.true_since_s
        own = any(moved.explains(due.subject, since_s) for moved in self.moved.values())
        assert not own, "by its own effect"
        subject.started = True
        self.starts[name].append(self.now_s)
        recent = [s for s in self.starts[name] if self.now_s - s < HOUR_S]
        assert len(recent) <= due.order.most_an_hour, "more than the limit"

    def decide(self) -> None:
        """Put a plan of an open mission to whoever decides; send what was granted, and more."""
        mission = self.random.choice(list(self.open))
        book, plan = self.random.choice(BOOKS), self.random.choice(PLANS)
        warned = self.random.choice(((), (), ("WF-04",), ("WF-04", "WF-07")))
        request = ev.ApprovalRequested(
            request_id=f"{mission}.{self.random.randrange(1, 4)}",
            attempt=1,
            plan=plan,
            state="warned" if warned else self.random.choice(STATES),
            acknowledge=warned,
            broken_anyway=self.random.choice(((), warned[:1], warned)),
            confidence=self.random.choice((0.9, 0.9, 0.6)),
            blocked_by=("ROE-01: no",) if self.random.random() < 0.15 else (),
            needs_override=self.random.random() < 0.1,
        )
        request = request.model_copy(update={"approvals": people_needed(request, book.approvals)})
        decision, by_order = self.decision(mission, request, book)
        allowed = self.admissible(mission, request, decision, book, by_order=by_order)
        if decision.kind == "approve" and not self.gate.inadmissible(request, decision, book):
            assert allowed, (request, decision)
        commands = device_commands(plan, request.request_id)
        try:
            self.gate.grant(request, decision, book)
        except ValueError:
            assert not (allowed and not self.stopped)
        else:
            assert allowed
            assert not self.stopped
            self.granted = set(commands)
            moved = {action.agent for action in plan.actions}
            before = self.moved.get(mission)
            since_s = before.since_s if before is not None else self.now_s
            self.moved[mission] = Moved(moved, since_s)
            self.orders.moves(mission, moved)
        for command in (*commands, *self.stray()):
            told = send(self.gate, command)
            if isinstance(told, ev.CommandSent):
                assert command in self.granted, "sent without the approval that it needs"
                self.granted.discard(command)
                self.events += 1

    def decision(
        self, mission: str, request: ev.ApprovalRequested, book: Rulebook
    ) -> tuple[Decision, bool]:
        """Return somebody's decision, and whether it is a standing order's, real or forged."""
        order = self.open[mission].order
        chosen = self.random.randrange(5)
        if chosen == 0:
            return Decision(kind="reject"), False
        if chosen == 1:
            return Decision(kind="approve"), False
        if chosen == 2:
            name = self.random.choice(list(BELOW))
            return Decision(kind="approve", standing_order=name), True
        return unasked_decision(order, request, book.unasked) or Decision(kind="reject"), True

    def admissible(
        self,
        mission: str,
        request: ev.ApprovalRequested,
        decision: Decision,
        book: Rulebook,
        *,
        by_order: bool,
    ) -> bool:
        """Whether by the histories' own reckoning `decision` may carry `request` out."""
        if decision.kind != "approve" or request.blocked_by or request.needs_override:
            return False
        if request.approvals or not {*request.acknowledge} <= {*decision.acknowledged}:
            return False
        if not by_order:
            return True
        order = self.open[mission].order
        verbs = {action.verb for action in request.plan.actions} - {"hold", "report"}
        return (
            decision.standing_order == order.id
            and order.id in self.approved
            and order.unasked
            and verbs <= set(book.unasked)
            and request.state in ("approve", "warned")
            and {*request.acknowledge} <= {*request.broken_anyway}
            and request.confidence == 0.9
        )

    def stray(self) -> list[DeviceCommand]:
        """Return commands that nobody has decided."""
        verb = self.random.choice(("move_to", "observe"))
        return [
            DeviceCommand(command_id="x", agent="Drone_T02", verb=verb, target="WestGate"),
            *list(self.granted)[:1],
        ]

    def end(self) -> None:
        """Let an open mission be over."""
        mission = self.random.choice(list(self.open))
        due, failed = self.open.pop(mission), self.random.random() < 0.5
        self.orders.ended(mission, self.now_s, failed=failed)
        subject = self.subjects.get((due.order.id, due.subject))
        if failed and subject is not None and subject.mission == mission:
            subject.started, subject.not_before_s = False, self.now_s + RETRY_S
        if mission in self.moved:
            self.moved[mission].ended_s = self.now_s


def test_in_any_history_nothing_starts_or_is_sent_that_must_not() -> None:
    happened = 0
    for seed in range(HISTORIES):
        history = History(Random(seed))
        history.approve()
        for _ in range(STEPS):
            history.step()
        happened += history.events
    assert happened > HISTORIES / 2, "the histories must bring something about"


def low_at(time_s: float, *names: str) -> Picture:
    """Return a picture in which the assets `names` are low."""
    assets = {name: REPORTS[name, 10.0 if name in names else 80.0, False] for name in NAMES}
    return BASE.model_copy(update={"assets": assets, "time_s": time_s})


def test_an_occurrence_beyond_the_limit_waits_and_starts_when_the_limit_allows() -> None:
    orders = StandingOrders()
    orders.approve(CONDITIONS[0])
    results = [
        (time_s, *(type(result) for result in orders.look(low_at(time_s, *NAMES))))
        for time_s in (0.0, 1.0, 2.0, 600.0, HOUR_S, HOUR_S + 1.0, HOUR_S + 2.0)
    ]
    assert results == [
        (0.0,), (1.0, Due, Withheld), (2.0,), (600.0,), (HOUR_S,), (HOUR_S + 1.0, Due),
        (HOUR_S + 2.0,),
    ]  # fmt: skip


@pytest.mark.parametrize("failed", [True, False])
def test_a_mission_is_tried_again_only_if_it_failed(failed: bool) -> None:
    orders, first = StandingOrders(), NAMES[0]
    orders.approve(CONDITIONS[3])
    orders.look(low_at(0.0, first))
    (due,) = orders.look(low_at(1.0, first))
    assert isinstance(due, Due)
    orders.started("M1", due)
    orders.ended("M1", 60.0, failed=failed)
    assert orders.look(low_at(60.0 + RETRY_S - 1.0, first)) == []
    again = orders.look(low_at(60.0 + RETRY_S, first))
    assert [type(result) for result in again] == [Due] * failed
