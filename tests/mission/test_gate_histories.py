"""Random histories of the gate: what was decided passes once, in its order, and nothing else does.

Nothing moves while everything is stopped, and to an asset under manual control nothing is sent but
a stop's hold. The histories keep books of their own: who drives which asset, what an operator or a
standing order has approved since, and which missions await which asset. Two assets are driven at
once, the console is restarted in between, and devices get commands again that they have not
answered.
"""

from collections import Counter
from dataclasses import dataclass, field
from datetime import UTC, datetime
from random import Random

import pytest

from pa_console.mission.gate import CommandGate
from pa_console.mission.orders.standing import Due, StandingOrders
from pa_console.mission.rehearse import device_commands
from pa_console.policy.rulebook import Rulebook
from pa_console.policy.standing_conditions import StandingCondition
from pa_console.schema.command import DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.mission import (
    Decision,
    Mission,
    MissionStatus,
    StandingOrder,
    StandingStart,
)
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rule import Rule, RuleSet, StandingLimits
from pa_console.schema.telemetry import Picture
from pa_console.session.log.journal import Journal
from tests.mission.gate import WORLD, Link, send
from tests.mission.pictures import GATES, asset, picture

pytestmark = pytest.mark.invariant

HISTORIES, STEPS = 1500, 36
NAMES = ("Drone_T01", "Drone_T02", "Robot_T01")
COMMANDS = ("move_to EastGate", "move_to WestGate", "hold", "report", "return_to_base")
RULE = Rule(id="ROE-01", domain="ROE", priority="high", text="r")
LIMITS = StandingLimits(allowed=("move_to", "return_to_base"))
BOOK = Rulebook("r", "", (), rule_set=RuleSet(name="r", rules=(RULE,), standing=LIMITS))
ORDER = StandingOrder(
    id="S1", text="t", each="asset", condition="it.battery_pct < 20.0", words="w",
    order="Relieve {it}.", unasked=True,
)  # fmt: skip
REPORTS = [
    asset(name, "robot" if name.startswith("Robot") else "uav", GATES[0], manual=manual,
          available=not manual)
    for name in NAMES for manual in (False, True)
]  # fmt: skip
SHOWN = {(report.id, report.manual): report for report in REPORTS}
BASE = picture(*(SHOWN[name, False] for name in NAMES))
SAFETY = (("move_to", "NorthGate"), ("hold", None))
ENDINGS: tuple[MissionStatus, ...] = ("unverified", "held", "verified", "rejected", "cancelled")


@dataclass
class History:
    """One session with its restarts, by the histories' own books."""

    random: Random
    link: Link = field(default_factory=Link)
    taken: set[str] = field(default_factory=set[str])
    reported: set[str] = field(default_factory=set[str])
    approved: list[DeviceCommand] = field(default_factory=list[DeviceCommand])
    """What was approved and has not been sent."""
    standing: dict[str, DeviceCommand] = field(default_factory=dict[str, DeviceCommand])
    """What each asset was sent last and may get again."""
    plan: tuple[DeviceCommand, ...] = ()
    """The plan that was approved last, as far as it was."""
    declared: set[str] = field(default_factory=set[str])
    """Who may be brought to safety once that plan is halted."""
    halted: bool = False
    waits: dict[DeviceCommand, set[int]] = field(default_factory=dict[DeviceCommand, set[int]])
    """The numbers of the actions that each command of that plan comes after."""
    verified: set[int] = field(default_factory=set[int])
    again: bool = False
    """True while what was sent is being sent again."""
    holds: list[DeviceCommand] = field(default_factory=list[DeviceCommand])
    awaiting: dict[str, tuple[Mission, set[str]]] = field(
        default_factory=dict[str, tuple[Mission, set[str]]]
    )
    stopped: bool = False
    stops: int = 0
    count: int = 0
    happened: Counter[str] = field(default_factory=Counter[str])

    def __post_init__(self) -> None:
        self.open()

    def open(self) -> None:
        """Begin with a gate that knows what the session's events tell, and nothing else."""
        self.orders = StandingOrders()
        self.orders.approve(StandingCondition(ORDER, WORLD))
        self.gate = CommandGate(self.link, Journal(), None, self.orders)  # pyright: ignore[reportArgumentType]
        self.gate.resume(self.stops, stopped=self.stopped)
        for name in sorted(self.taken):
            self.gate.take_manual(name, "operator")
        self.gate.manual.take_up(self.awaiting.values())
        self.gate.see(self.picture())

    @property
    def driven(self) -> set[str]:
        """Return who is under manual control, by the histories' own books."""
        return self.taken | self.reported

    def picture(self) -> Picture:
        """Return what the fleet reports, with what the station has marked."""
        shown = {n: SHOWN[n, n in self.reported or n in self.link.marked] for n in NAMES}
        return BASE.model_copy(update={"assets": shown})

    def step(self) -> None:
        """Let one thing happen, then hold what was sent against the books."""
        deeds = (
            (4, self.take), (5, self.give_back), (2, self.report), (5, self.grant),
            (6, self.send), (3, self.verify), (2, self.resend), (2, self.halt), (1, self.finish),
            (1, self.stop_or_release), (1, self.restart), (5, self.end_mission),
            (5, self.come_back),
        )  # fmt: skip
        weights, what = zip(*deeds, strict=True)
        deed = self.random.choices(what, weights)[0]
        before = len(self.link.sent)
        self.again = deed == self.resend
        deed()
        for command in self.link.sent[before:]:
            self.check(command)
        self.happened[deed.__name__] += 1

    def check(self, command: DeviceCommand) -> None:
        """Refuse what must never be sent."""
        if command in self.holds:
            self.happened["holds"] += command.agent in self.driven
            self.standing[command.agent] = command
            return
        assert command.agent not in self.driven, "to an asset under manual control"
        assert not self.stopped or command.verb in ("hold", "report")
        way = (command.verb, command.target) in SAFETY and command.agent in self.declared
        if self.again:
            assert self.standing.get(command.agent) == command, "sent again, and not the last one"
        elif command in self.approved:
            assert self.waits[command] <= self.verified, "before what it waits for is verified"
            self.approved.remove(command)
        else:
            assert self.halted, "decided before its asset was driven, or by nobody, or sent already"
            assert way
        self.standing[command.agent] = command
        self.happened["sent"] += 1

    def void(self, name: str) -> None:
        """Note that what was decided for an asset is worth nothing any more."""
        self.approved = [each for each in self.approved if each.agent != name]
        self.declared.discard(name)
        if self.standing.get(name) not in self.holds:
            self.standing.pop(name, None)

    def take(self) -> None:
        """The operator takes an asset, or tries to take it twice."""
        name = self.random.choice(NAMES)
        if name in self.taken:
            with pytest.raises(ValueError, match="already"):
                self.gate.take_manual(name, "operator")
            return
        self.gate.take_manual(name, "operator")
        self.taken.add(name)
        self.void(name)
        assert self.link.marked == self.taken

    def give_back(self) -> None:
        """The operator gives an asset back, or one that is not here to give."""
        name = self.random.choice(NAMES)
        if name not in self.taken:
            with pytest.raises(ValueError, match="manual control"):
                self.gate.end_manual(name)
            return
        self.gate.end_manual(name)
        self.taken.discard(name)
        self.gate.see(self.picture())

    def report(self) -> None:
        """Somebody takes an asset's controls on the spot, or lets go of them."""
        name = self.random.choice(NAMES)
        if name not in self.driven:
            self.void(name)
        self.reported ^= {name}
        self.gate.see(self.picture())

    def grant(self) -> None:
        """The operator, or a standing order unasked, approves a plan for some of them."""
        self.count += 1
        mission = f"M{self.count:03d}"
        agents = self.random.sample(NAMES, self.random.randrange(1, 4))
        after = [
            tuple(n for n in range(1, at + 1) if self.random.random() < 0.2)
            for at in range(len(agents))
        ]
        actions = tuple(
            Action(agent=agent, command=self.random.choice(COMMANDS), after=waits)
            for agent, waits in zip(agents, after, strict=True)
        )
        declared = tuple(Action(agent=a, command="move_to NorthGate") for a in agents)
        request = ev.ApprovalRequested(
            request_id=f"{mission}.1", attempt=1, plan=Plan(reason="r", actions=actions),
            if_halted=declared, state="approve", confidence=0.9,
        )  # fmt: skip
        by_order = self.random.random() < 0.3
        if by_order:
            self.orders.started(mission, Due(ORDER, StandingStart(order="Relieve Drone_T01.")))
        decision = Decision(kind="approve", standing_order="S1" if by_order else "")
        if self.stopped:
            with pytest.raises(ValueError, match="stopped"):
                self.gate.grant(request, decision, BOOK)
            return
        self.gate.grant(request, decision, BOOK)
        commands = device_commands(request.plan, request.request_id)
        self.approved = [each for each in commands if each.agent not in self.driven]
        self.plan, self.halted, self.verified = commands, False, set()
        self.waits = dict(zip(commands, map(set, after), strict=True))
        self.declared = {action.agent for action in declared} - self.driven

    def send(self) -> None:
        """Put something on the link: of a plan, all of it, what is past, what nobody decided."""
        if self.random.random() < 0.4 and self.approved:
            self.gate.send(self.approved, lambda _: None)
        stray = DeviceCommand(command_id="x", agent=self.random.choice(NAMES), verb="move_to",
                              target="WestGate")  # fmt: skip
        for command in (*self.plan, stray):
            if self.random.random() < 0.5:
                send(self.gate, command)

    def verify(self) -> None:
        """Telemetry shows an action of the plan done."""
        if self.plan:
            number = self.random.randrange(len(self.plan)) + 1
            self.gate.verified([number])
            self.verified.add(number)

    def resend(self) -> None:
        """Put on the link again what was sent, what was not yet, and holds of a stop."""
        for command in (*self.link.sent[-3:], *self.plan, *self.holds[:2]):
            self.gate.resend(command, 1)

    def halt(self) -> None:
        """Halt the plan, and send its ways to safety."""
        self.gate.halt()
        self.approved, self.halted = [], True
        last = self.standing.items()
        self.standing = {name: each for name, each in last if each not in self.plan}
        ways = tuple(Action(agent=each.agent, command="move_to NorthGate") for each in self.plan)
        safe = device_commands(Plan(reason="s", actions=ways), f"h{self.count}")
        self.gate.send(safe, lambda _: None)

    def finish(self) -> None:
        """Let the plan be over."""
        self.gate.finish()
        self.approved = []
        self.declared.clear()

    def stop_or_release(self) -> None:
        """Stop everything: each asset gets its hold, whoever drives it; or release the stop."""
        if self.stopped:
            self.gate.release()
            self.holds = []
        else:
            self.holds = [*self.gate.stop_all()]
            self.stops += 1
            before = len(self.link.sent)
            for command in self.link.sent[-3:]:
                assert self.gate.resend(command, 1) is None, "what was sent before is void"
            self.gate.send(self.holds, lambda _: None)
            reached = {command.agent for command in self.link.sent[before:]}
            assert reached == {*WORLD.assets}, "a stop leaves nobody out"
            self.gate.manual.forget()
            self.awaiting.clear()
            self.approved, self.declared, self.standing = [], set(), {}
        self.stopped = not self.stopped

    def restart(self) -> None:
        """The console is killed and opened again: what was decided is void, who drives is not."""
        self.approved, self.holds, self.declared, self.standing = [], [], set(), {}
        self.halted = False
        self.link.marked = frozenset()
        self.open()
        assert self.gate.manual.assets == self.driven
        assert self.link.marked == self.taken

    def end_mission(self) -> None:
        """A mission ends somehow, and may await an asset by that."""
        self.count += 1
        ordered = set(self.random.sample(NAMES, self.random.randrange(3)))
        text = self.random.choice(("Robot_T01 to the east gate.", "Fill the gap at EastGate."))
        mission = Mission(id=f"M{self.count:03d}", text=text, created=datetime.now(UTC))
        status = self.random.choice(ENDINGS)
        awaits = {*self.gate.manual.awaits(mission, status, ordered)}
        needed = self.driven & (ordered | {name for name in NAMES if name in text})
        assert awaits == (needed if status in ("unverified", "held") else set())
        if awaits:
            self.awaiting[mission.id] = (mission, awaits)

    def come_back(self) -> None:
        """Missions whose assets are all back are given anew, each once, and no others are."""
        due = {name for name, (_, assets) in self.awaiting.items() if not assets & self.driven}
        assert {back.mission.id for back in self.gate.manual.come_back()} == due
        for name in due:
            del self.awaiting[name]
        self.happened["given anew"] += len(due)
        assert {*self.gate.manual.awaiting} == {*self.awaiting}, "lost in silence"


def test_in_any_history_only_what_was_decided_passes_and_a_driven_asset_gets_a_stop_only() -> None:
    happened = Counter[str]()
    for seed in range(HISTORIES):
        history = History(Random(seed))
        for _ in range(STEPS):
            history.step()
        happened += history.happened
    for deed in ("sent", "holds", "given anew", "take", "verify", "restart"):
        assert happened[deed] > HISTORIES / 20, f"the histories hardly have any: {deed}"
