"""The last gate before the link: what passes it, when, and what never does."""

import pytest

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.mission.gate import CommandGate, Passage
from pa_console.mission.rehearse import device_commands
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.command import DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision
from pa_console.schema.plan import Action, Plan
from pa_console.session.log.journal import Journal
from tests.mission.gate import WORLD, Link, gate_on, send

pytestmark = pytest.mark.invariant

APPROVE = Decision(kind="approve")
RULES = Rulebook("none", "", ())


def actions(*orders: tuple[str, str]) -> tuple[Action, ...]:
    return tuple(Action(agent=agent, command=command) for agent, command in orders)


def request(
    number: int, *orders: tuple[str, str], safety: tuple[tuple[str, str], ...] = ()
) -> ev.ApprovalRequested:
    return ev.ApprovalRequested(
        request_id=f"M1.{number}",
        attempt=number,
        plan=Plan(reason="r", actions=actions(*orders)),
        if_halted=actions(*safety),
    )


RELIEF = request(
    1,
    ("Drone_T01", "move_to EastGate"),
    ("Drone_T04", "move_to WestGate"),
    safety=(("Drone_T01", "move_to WestGate"), ("Drone_T04", "hold")),
)
ORDERS = device_commands(RELIEF.plan, RELIEF.request_id)
HOME = DeviceCommand(command_id="x", agent="Drone_T01", verb="move_to", target="WestGate")


@pytest.mark.parametrize(
    ("asked", "decision"),
    [
        (RELIEF, Decision(kind="reject")),
        (RELIEF, Decision(kind="choose", asked="x")),
        (RELIEF, Decision(kind="approve", request_id="M1.2")),
        (RELIEF.model_copy(update={"blocked_by": ("ROE-01",)}), APPROVE),
        (RELIEF.model_copy(update={"acknowledge": ("WF-06",)}), APPROVE),
        (RELIEF.model_copy(update={"needs_override": True}), APPROVE),
    ],
)
def test_a_plan_that_was_not_approved_is_not_granted(
    asked: ev.ApprovalRequested, decision: Decision
) -> None:
    link = Link()
    gate = gate_on(link)
    with pytest.raises(ValueError, match=r"\S"):
        gate.grant(asked, decision, RULES)
    assert isinstance(send(gate, ORDERS[0]), ev.CommandRefused)
    assert not link.sent


def test_each_command_of_an_approved_plan_passes_once_and_no_other_does() -> None:
    link = Link()
    gate = gate_on(link)
    gate.grant(RELIEF, APPROVE, RULES)
    elsewhere = ORDERS[0].model_copy(update={"target": "NorthGate"})
    for command in (elsewhere, HOME):
        refused = send(gate, command)
        assert isinstance(refused, ev.CommandRefused)
        assert "no approved plan" in refused.reason
    assert all(isinstance(send(gate, command), ev.CommandSent) for command in ORDERS)
    assert isinstance(send(gate, ORDERS[0]), ev.CommandRefused)
    assert link.sent == list(ORDERS)


def test_a_halted_plan_may_be_brought_to_its_declared_safety_and_nowhere_else() -> None:
    link = Link()
    gate = gate_on(link)
    gate.grant(RELIEF, APPROVE, RULES)
    send(gate, ORDERS[0])
    gate.halt()
    assert isinstance(send(gate, ORDERS[1]), ev.CommandRefused), "the plan goes on no more"
    assert gate.resend(ORDERS[0], 1) is None
    elsewhere = HOME.model_copy(update={"target": "SouthGate"})
    other = HOME.model_copy(update={"agent": "Drone_T04"})
    stranger = DeviceCommand(command_id="y", agent="Ugv_T02", verb="hold")
    for command in (elsewhere, other, stranger):
        assert isinstance(send(gate, command), ev.CommandRefused)
    assert isinstance(send(gate, HOME), ev.CommandSent)
    hold = DeviceCommand(command_id="z", agent="Drone_T01", verb="hold")
    assert isinstance(send(gate, hold), ev.CommandSent), "it may always hold instead"
    assert gate.resend(HOME, 1) is None, "the hold came after it"
    assert gate.resend(hold, 1) is not None


def test_nothing_of_a_plan_that_has_ended_passes() -> None:
    gate = gate_on(Link())
    gate.grant(RELIEF, APPROVE, RULES)
    gate.finish()
    gate.halt()
    for command in (*ORDERS, HOME):
        assert isinstance(send(gate, command), ev.CommandRefused)


def test_nothing_of_a_plan_passes_while_the_log_cannot_be_written() -> None:
    link, journal = Link(), Journal()
    gate = gate_on(link, journal)
    gate.grant(RELIEF, APPROVE, RULES)
    journal.problem = "no space left on device"
    told = send(gate, ORDERS[0])
    assert isinstance(told, ev.CommandRefused)
    assert told.reason == "no space left on device"
    assert not link.sent
    gate.halt()
    assert isinstance(send(gate, HOME), ev.CommandSent), "the way to safety passes all the same"
    assert all(isinstance(send(gate, hold), ev.CommandSent) for hold in gate.stop_all())


def test_a_simulation_takes_what_passes() -> None:
    gate = CommandGate(SimulatedFleet.start(WORLD), Journal())
    gate.grant(RELIEF, APPROVE, RULES)
    assert isinstance(send(gate, ORDERS[0]), ev.CommandSent)


def test_a_plan_of_which_one_command_was_never_decided_goes_out_not_at_all() -> None:
    link = Link()
    gate = gate_on(link)
    gate.grant(RELIEF, APPROVE, RULES)
    stranger = DeviceCommand(command_id="y", agent="Ugv_T02", verb="move_to", target="EastGate")
    emitted: list[Passage] = []
    gate.send((ORDERS[0], stranger), emitted.append)
    assert [type(passage) for passage in emitted] == [ev.CommandRefused]
    assert not link.sent


class Disk(Journal):
    """A journal that notes what is on the disk, and may refuse to write."""

    def __init__(self, refuses: str = "") -> None:
        super().__init__()
        self.refuses = refuses
        self.pending: list[DeviceCommand] = []
        self.on_disk: list[DeviceCommand] = []

    def note(self, passage: Passage) -> None:
        """Take an event as the station emits it."""
        if isinstance(passage, ev.CommandSent):
            self.pending.append(passage.command)

    def commit(self) -> str:
        """Have what is pending on the disk, unless it refuses."""
        self.problem = self.refuses
        if not self.problem:
            self.on_disk += self.pending
            self.pending.clear()
        return self.problem


class Watched(Link):
    """A link that notes whether a command was on the disk when it went out."""

    disk: Disk

    def send(self, command: DeviceCommand) -> None:
        """Note the command; what moves an asset for a plan is logged by now."""
        assert command in self.disk.on_disk
        super().send(command)


def test_a_plan_s_command_is_on_the_disk_before_it_is_on_the_link() -> None:
    link, disk = Watched(), Disk()
    link.disk = disk
    gate = gate_on(link, disk)
    gate.grant(RELIEF, APPROVE, RULES)
    gate.send(ORDERS, disk.note)
    assert link.sent == list(ORDERS)


def test_what_the_disk_refuses_at_the_last_moment_does_not_go_out_nor_is_it_sent_again() -> None:
    link, disk = Link(), Disk("no space left on device")
    gate = gate_on(link, disk)
    gate.grant(RELIEF, APPROVE, RULES)
    passages = gate.send(ORDERS, disk.note)
    assert isinstance(passages[-1], ev.CommandRefused)
    assert gate.resend(ORDERS[0], 1) is None
    assert not link.sent
    gate.send(gate.stop_all(), disk.note)
    assert {command.verb for command in link.sent} == {"hold"}, "a stop waits for no disk"


def test_nothing_is_told_again_to_move_while_the_log_cannot_be_written() -> None:
    link, disk = Link(), Disk()
    gate = gate_on(link, disk)
    gate.grant(RELIEF, APPROVE, RULES)
    gate.send(ORDERS, disk.note)
    disk.problem = "no space left on device"
    assert gate.resend(ORDERS[0], 1) is None
    disk.problem = ""
    assert gate.resend(ORDERS[0], 1) is not None
