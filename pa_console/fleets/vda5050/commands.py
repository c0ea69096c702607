"""The conversion of commands to orders and instant actions, and the robots' answers to them."""

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

from pa_console.fleets.vda5050.messages import (
    ActionParameter,
    ActionState,
    ConnectionState,
    Edge,
    Factsheet,
    Node,
    Position,
    RobotAction,
    RobotState,
)
from pa_console.fleets.vda5050.vehicle import AUTHORIZATION, CANCEL, ENDED, PAUSE, RESUME, TARGET
from pa_console.fleets.vda5050.wire import Identity
from pa_console.schema.base import Point
from pa_console.schema.command import FINAL_REPLIES, STILL, DeviceCommand, ReplyStatus
from pa_console.schema.world import World

START = "start"
"""The id of the first node of an order if the robot has not reported one."""

MOST_ASKED = 512
"""The number of recent commands of a robot whose answers are tracked."""


class RobotAnswer(NamedTuple):
    """A robot's answer to a command."""

    status: ReplyStatus
    detail: str = ""


def is_order(command: DeviceCommand) -> bool:
    """Return whether a command moves a robot, and is therefore sent as an order."""
    return command.verb not in STILL


def actions_at_once(command: DeviceCommand, token: str | None) -> tuple[RobotAction, ...]:
    """Return the instant actions for `hold` (pause and cancel) or `report`."""
    if command.verb == "hold":
        return (
            _action(command.command_id, PAUSE, "NONE"),
            _action(f"{command.command_id}.cancel", CANCEL, "NONE"),
        )
    return (_action(command.command_id, command.verb, "NONE", _parameters(None, token)),)


def cancel_before(command: DeviceCommand) -> RobotAction:
    """Return the action that cancels a robot's current order before `command` can be sent."""
    return _action(f"{command.command_id}.before", CANCEL, "NONE")


def resume_for(command: DeviceCommand) -> RobotAction:
    """Return the action that ends a robot's pause, so that it can carry out `command`."""
    return _action(f"{command.command_id}.resume", RESUME, "NONE")


def order_of(
    command: DeviceCommand, world: World, at: Point | None, node_id: str, token: str | None
) -> tuple[tuple[Node, ...], tuple[Edge, ...]]:
    """Return the nodes and edges of an order, from the robot's position `at` to the command's goal.

    `node_id` is the last node that the robot reported. Without a position, the goal is the only
    node.
    """
    goal = command.target or world.base
    action = _action(command.command_id, command.verb, "HARD", _parameters(command.target, token))
    there = world.frames[goal].at if goal in world.frames else None
    last = Node(
        node_id=goal,
        sequence_id=2 if at is not None else 0,
        released=True,
        node_position=_position(there),
        actions=(action,),
    )
    if at is None:
        return (last,), ()
    first = Node(
        node_id=node_id or START, sequence_id=0, released=True, node_position=_position(at)
    )
    edge = Edge(edge_id=f"to-{goal}", sequence_id=1, released=True)
    return (first, last), (edge,)


def answer_of(command_id: str, verb: str, state: RobotState) -> RobotAnswer | None:
    """Return the answer to a command in `state`; None if the state does not mention the command.

    A hold is done when the pause has begun, no order is left, and the same state shows that the
    robot has stopped. An acknowledgement alone is not enough.
    """
    for error in reversed(state.errors):
        if error.refers_to(command_id) and error.error_level == "WARNING":
            return RobotAnswer("refused", error.error_description or error.error_type)
    states = (*state.action_states, *state.instant_action_states)
    action = _find(states, command_id)
    if action is None:
        return None
    detail = action.action_result or ""
    match action.action_status:
        case "FAILED":
            return RobotAnswer("failed", detail)
        case "FINISHED":
            left = _left_of_hold(command_id, state) if verb == "hold" else None
            return (
                RobotAnswer("done", detail) if left is None else RobotAnswer("acknowledged", left)
            )
        case "RUNNING" | "PAUSED" | "RETRIABLE":
            return RobotAnswer("progress", detail)
        case "WAITING" | "INITIALIZING":
            return RobotAnswer("acknowledged", detail)


def _left_of_hold(command_id: str, state: RobotState) -> str | None:
    """Return why the hold of a paused robot is not done yet; None once it is."""
    cancelled = _find(state.instant_action_states, f"{command_id}.cancel")
    if cancelled is not None and cancelled.action_status not in ENDED:
        return "its order is being cancelled"
    if state.node_states:
        return "it still has an order"
    return "it still moves" if state.moves else None


def _find(states: Sequence[ActionState], action_id: str) -> ActionState | None:
    return next((state for state in reversed(states) if state.action_id == action_id), None)


def _action(
    action_id: str,
    action_type: str,
    blocking: Literal["NONE", "HARD"],
    parameters: tuple[ActionParameter, ...] = (),
) -> RobotAction:
    return RobotAction(
        action_id=action_id,
        action_type=action_type,
        blocking_type=blocking,
        action_parameters=parameters,
    )


def _parameters(target: str | None, token: str | None) -> tuple[ActionParameter, ...]:
    given = ((TARGET, target), (AUTHORIZATION, token))
    return tuple(ActionParameter(key=key, value=value) for key, value in given if value is not None)


def _position(at: Point | None) -> Position | None:
    return None if at is None else Position(x=at[0], y=at[1])


@dataclass(frozen=True)
class _PendingCommand:
    """A command of the station, and the last answer of its robot."""

    command: DeviceCommand
    answer: RobotAnswer | None = None


@dataclass
class Robot:
    """One robot of the fleet; `name` is both its serial number and its name in the world."""

    identity: Identity
    factsheet: Factsheet | None = None
    connection: ConnectionState = "OFFLINE"
    state: RobotState | None = None
    held: bool = False
    """True if the robot has had a hold since its last order."""
    waiting: DeviceCommand | None = None
    """An order that is sent once the current order is cancelled."""
    asked: OrderedDict[str, _PendingCommand] = field(
        default_factory=OrderedDict[str, _PendingCommand]
    )
    """The commands that were sent, by action id on the bus."""

    @property
    def name(self) -> str:
        """The name of the asset."""
        return self.identity.serial_number

    @property
    def busy(self) -> bool:
        """True if the robot reports an order."""
        if self.state is None:
            return False
        running = any(a.action_status not in ENDED for a in self.state.action_states)
        return running or bool(self.state.node_states)

    def cannot(self, command: DeviceCommand) -> str:
        """Return why the robot's factsheet excludes `command`; "" if it does not."""
        if command.verb == "hold" or self.factsheet is None:
            return ""
        if self.factsheet.offers(command.verb):
            return ""
        return f"its factsheet does not offer {command.verb}"

    def ask(self, action_id: str, command: DeviceCommand) -> None:
        """Record that `command` is sent as `action_id`; a repeated command gets a new answer."""
        self.asked[action_id] = _PendingCommand(command)
        self.asked.move_to_end(action_id)
        if len(self.asked) > MOST_ASKED:
            self.asked.popitem(last=False)

    def command_id(self, action_id: str | None) -> str | None:
        """Return the id of the command sent as `action_id`; if unknown, `action_id` itself."""
        asked = self.asked.get(action_id) if action_id is not None else None
        return asked.command.command_id if asked is not None else action_id

    def answers(self, state: RobotState) -> Iterator[tuple[DeviceCommand, RobotAnswer]]:
        """Store `state`; yield each command that was sent with its new answer in `state`."""
        self.state = state
        for action_id, asked in list(self.asked.items()):
            if asked.answer is not None and asked.answer.status in FINAL_REPLIES:
                continue
            answer = answer_of(action_id, asked.command.verb, state)
            if answer is not None and answer != asked.answer:
                self.asked[action_id] = replace(asked, answer=answer)
                yield asked.command, answer
