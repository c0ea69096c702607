"""The robot's side of the protocol, which accepts or refuses orders and reports their progress.

This side needs no transport and no motors. An accepted order becomes a device command, at most once
even if the order is repeated. The state follows from the orders and from the device's replies.
"""

from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from datetime import datetime

from pydantic import JsonValue

from pa_console.fleets.vda5050.messages import (
    ActionState,
    ActionStatus,
    EdgeState,
    Error,
    InfoReference,
    InstantActions,
    Node,
    NodeState,
    Order,
    RobotAction,
)
from pa_console.fleets.vda5050.wire import Header, Identity, in_milliseconds
from pa_console.schema.command import STILL, CommandReply, DeviceCommand, ReplyStatus, Verb

Verify = Callable[[str | None, DeviceCommand], str]
"""A function that returns why a command with this token is refused; "" if it is accepted."""

AUTHORIZATION, TARGET = "authorization", "target"
PAUSE, CANCEL, RESUME = "startPause", "cancelOrder", "stopPause"
STOPPING = (PAUSE, CANCEL, "hold")
"""The instant actions that stop a robot; they are carried out each time, even with a known id."""

STATE_REQUEST, FACTSHEET_REQUEST = "stateRequest", "factsheetRequest"
EXPIRY_S = 10.0
"""The time for which an order is valid after it was sent, in seconds, for the broker and robots."""

MOST_KNOWN = 65_536
"""The number of recent action ids that are remembered, so that no order is carried out twice."""

MOST_TOLD = 32
"""The largest number of ended actions in the state, and of refusals."""

MOST_OPEN = 256
"""The largest number of actions in the state."""

ENDED = ("FINISHED", "FAILED")
REFUSED_S = 30.0
"""The time for which a refusal is part of the state, in seconds."""

_STATUS: dict[ReplyStatus, ActionStatus] = {
    "acknowledged": "WAITING",
    "progress": "RUNNING",
    "done": "FINISHED",
    "refused": "FAILED",
    "failed": "FAILED",
}


def anybody(_token: str | None, _command: DeviceCommand) -> str:
    """Accept every command, for a site without keys."""
    return ""


@dataclass(frozen=True)
class _TakenAction:
    """An accepted action; `device_id` is the id of the device command that carries it out.

    `command` is that command; None if it was made for another action of the same message.
    """

    state: ActionState
    device_id: str
    instant: bool
    command: DeviceCommand | None
    answered: bool = False


@dataclass(frozen=True)
class _Refusal:
    error: Error
    at: datetime


class Vehicle:
    """One robot; `offers` are the verbs that it can carry out, and `now` is its own clock (UTC).

    A stop is carried out each time it arrives, so that a used id cannot block a stop. After a stop,
    no order that was sent before it is carried out.

    With `relays`, the robot represents a device behind a lossy radio. It then reports on a command
    only after the device has reported, and forwards repetitions until the command has ended. Such a
    device must also carry out each id only once.
    """

    def __init__(
        self,
        identity: Identity,
        offers: frozenset[Verb],
        now: Callable[[], datetime],
        verify: Verify = anybody,
        *,
        relays: bool = False,
    ) -> None:
        self.identity, self.paused, self._relays = identity, False, relays
        self._offers, self._now, self._verify = offers, now, verify
        self._began = in_milliseconds(now())
        self._known: OrderedDict[str, _TakenAction | None] = OrderedDict()
        """The progress of each action, by its id; None if the action was refused."""
        self._told: list[str] = []
        self._refusals: list[_Refusal] = []
        self._order: Order | None = None
        self._held_back: DeviceCommand | None = None
        """An order that was accepted during a pause; it is verified when the pause ends."""
        self._held_token: str | None = None
        self._stopped = self._began
        """The time at which the latest stop was sent, by the station's clock, but not after now."""

    def take_order(self, order: Order) -> Iterator[DeviceCommand]:
        """Accept `order`, or refuse it in the state; yield the command for the device."""
        actions = [action for node in order.nodes for action in node.actions]
        actions += [action for edge in order.edges for action in edge.actions]
        ids = [action.action_id for action in actions]
        if any(action_id in self._known for action_id in ids):
            yield from self._again(ids)
            return
        about = (("orderId", order.order_id), *(("actionId", action_id) for action_id in ids))
        if why := self._objection(order):
            self._refuse("INVALID_ORDER", why, about)
        elif len(actions) != 1 or not ids[0] or not order.nodes or not order.nodes[-1].actions:
            why = "an order must have one action, at its last node"
            self._refuse("VALIDATION_FAILURE", why, about)
        else:
            command = self._command(actions[0], order.nodes[-1])
            problem = f"it cannot {actions[0].action_type}" if command is None else ""
            token = _token(actions[0])
            if command is None:
                self._refuse("INVALID_ORDER_ACTION", problem, about)
            elif not self.paused and (why := self._verify(token, command)):
                self._refuse("INVALID_ORDER", why, about)
            else:
                self._end_held_back("superseded")
                self._order = order
                self._note(actions[0], "WAITING", command)
                if self.paused:
                    self._held_back, self._held_token = command, token
                else:
                    yield command

    def take_actions(self, message: InstantActions) -> Iterator[DeviceCommand]:
        """Accept instant actions and yield the commands for the device.

        A refusal is reported in the next `state` message.
        """
        misdirected = self._misdirected(message)
        stopping = ""
        for action in message.actions:
            stops = action.action_type in STOPPING
            if action.action_id in self._known and not stops:
                yield from self._again((action.action_id,))
                continue
            about = (("actionId", action.action_id),)
            if misdirected or not action.action_id:
                self._refuse("INVALID_INSTANT_ACTION", misdirected or "it has no id", about)
            elif stops:
                self._end_held_back("cancelled")
                self._stopped = max(self._stopped, min(message.timestamp, self._now()))
                self.paused = self.paused or action.action_type == PAUSE
                if not stopping:
                    stopping = action.action_id
                    hold = DeviceCommand(
                        command_id=stopping, agent=self.identity.serial_number, verb="hold"
                    )
                    self._note(action, "WAITING", hold)
                    yield hold
                else:
                    self._note(action, "WAITING", stopping)
            elif why := self._objection(message):
                self._refuse("INVALID_INSTANT_ACTION", why, about)
            elif action.action_type in (STATE_REQUEST, FACTSHEET_REQUEST):
                self._note(action, "FINISHED", action.action_id)
            elif action.action_type == RESUME:
                self._note(action, "FINISHED", action.action_id)
                self.paused = False
                yield from self._released()
            elif action.action_type == "report" and "report" in self._offers:
                command = DeviceCommand(
                    command_id=action.action_id, agent=self.identity.serial_number, verb="report"
                )
                if why := self._verify(_token(action), command):
                    self._refuse("INVALID_INSTANT_ACTION", why, about)
                else:
                    self._note(action, "WAITING", command)
                    yield command
            else:
                why = f"it cannot {action.action_type} at once"
                self._refuse("INVALID_INSTANT_ACTION", why, about)

    def reject(self, why: str) -> None:
        """Report in the state that a message could not be read."""
        self._refuse("VALIDATION_FAILURE", why, ())

    def hear(self, reply: CommandReply) -> None:
        """Process the device's reply to a command."""
        for action_id in self._told:
            taken = self._known.get(action_id)
            if taken is None or taken.device_id != reply.command_id:
                continue
            update = {
                "action_status": _STATUS[reply.status],
                "action_result": reply.detail or taken.state.action_result,
            }
            state = taken.state.model_copy(update=update)
            self._known[action_id] = replace(taken, state=state, answered=True)
            if reply.status == "refused":
                about = (("actionId", action_id),)
                self._refuse("INVALID_ORDER", reply.detail, about, keep=True)

    @property
    def action_states(self) -> tuple[ActionState, ...]:
        """The progress of the orders' actions, the latest last."""
        return tuple(action.state for action in self._recent() if not action.instant)

    @property
    def instant_action_states(self) -> tuple[ActionState, ...]:
        """The progress of instant actions, the latest last."""
        return tuple(action.state for action in self._recent() if action.instant)

    @property
    def errors(self) -> tuple[Error, ...]:
        """The reasons for recent refusals."""
        now = self._now()
        self._refusals = [r for r in self._refusals if (now - r.at).total_seconds() < REFUSED_S]
        return tuple(refusal.error for refusal in self._refusals)

    @property
    def order_id(self) -> str:
        """The id of the last accepted order; "" if there is none."""
        return self._order.order_id if self._order is not None else ""

    @property
    def active(self) -> bool:
        """True if the latest order has not ended."""
        return any(state.action_status not in ENDED for state in self.action_states)

    def way_ahead(self) -> tuple[tuple[NodeState, ...], tuple[EdgeState, ...]]:
        """Return the node to which the robot goes, and the edge to it; both empty if it is idle."""
        if self._order is None or not self.active:
            return (), ()
        last = self._order.nodes[-1]
        node = NodeState(
            node_id=last.node_id,
            sequence_id=last.sequence_id,
            released=True,
            node_position=last.node_position,
        )
        edges = (
            EdgeState(edge_id=edge.edge_id, sequence_id=edge.sequence_id, released=True)
            for edge in self._order.edges[-1:]
        )
        return (node,), tuple(edges)

    def _recent(self) -> list[_TakenAction]:
        actions = (self._known.get(action_id) for action_id in self._told)
        return [k for k in actions if k is not None and (k.answered or not self._relays)]

    def _misdirected(self, message: Header) -> str:
        if (message.manufacturer, message.serial_number) != self.identity:
            return f"it is for {message.manufacturer}/{message.serial_number}"
        return ""

    def _objection(self, message: Header) -> str:
        """Return why a message that may move the robot is refused; "" if it is accepted.

        It must be for this robot, and neither too old nor older than the last stop.
        """
        age_s = (self._now() - message.timestamp).total_seconds()
        if why := self._misdirected(message):
            return why
        if message.timestamp < self._began:
            return "it was sent before this robot started"
        if message.timestamp < self._stopped:
            return "it was sent before this robot was stopped"
        if age_s > EXPIRY_S:
            return f"it was sent {age_s:.0f} s ago and has expired"
        if age_s < -EXPIRY_S:
            return f"its time is {-age_s:.0f} s in the future"
        return ""

    def _command(self, action: RobotAction, node: Node) -> DeviceCommand | None:
        """Return the command for `action`; None if the robot does not offer it."""
        offered: dict[str, Verb] = {verb: verb for verb in self._offers if verb != "hold"}
        verb = offered.get(action.action_type)
        if verb is None:
            return None
        target: JsonValue = action.parameter(TARGET)
        if target is not None and target != node.node_id:
            return None
        try:
            return DeviceCommand(
                command_id=action.action_id,
                agent=self.identity.serial_number,
                verb=verb,
                target=node.node_id if target is not None else None,
            )
        except ValueError:
            return None

    def _again(self, ids: Iterable[str]) -> Iterator[DeviceCommand]:
        """Yield a repeated command again, unchanged, for a device that may not have received it."""
        for action_id in ids:
            action = self._known[action_id]
            if not self._relays or action is None or action.command is None:
                continue
            if action.state.action_status not in ENDED and action.command is not self._held_back:
                yield action.command

    def _note(
        self, action: RobotAction, status: ActionStatus, carried_by: DeviceCommand | str
    ) -> None:
        """Record an accepted action; `carried_by` is its device command, or the id of one."""
        state = ActionState(
            action_id=action.action_id, action_type=action.action_type, action_status=status
        )
        alone = isinstance(carried_by, str)
        taken = _TakenAction(
            state,
            carried_by if alone else carried_by.command_id,
            instant=alone or carried_by.verb in STILL,
            command=None if alone else carried_by,
            answered=status in ENDED,
        )
        self._remember(action.action_id, taken)
        if action.action_id in self._told:
            self._told.remove(action.action_id)
        self._told.append(action.action_id)
        reported = ((action_id, self._known.get(action_id)) for action_id in self._told)
        ended = [t for t, k in reported if k is None or k.state.action_status in ENDED]
        for action_id in ended[:-MOST_TOLD]:
            self._told.remove(action_id)
        del self._told[:-MOST_OPEN]

    def _remember(self, action_id: str, action: _TakenAction | None) -> None:
        self._known[action_id] = action
        if len(self._known) > MOST_KNOWN:
            self._known.popitem(last=False)

    def _refuse(
        self, kind: str, why: str, about: tuple[tuple[str, str], ...], *, keep: bool = False
    ) -> None:
        """Report the reason for a refusal in the state; unless `keep`, the id stays refused."""
        if not keep:
            for key, value in about:
                if key == "actionId" and value:
                    self._remember(value, None)
        references = (
            InfoReference(reference_key=key, reference_value=value) for key, value in about
        )
        error = Error(
            error_type=kind,
            error_level="WARNING",
            error_references=tuple(references),
            error_description=why[:500],
        )
        self._refusals = [*self._refusals, _Refusal(error, self._now())][-MOST_TOLD:]

    def _released(self) -> Iterator[DeviceCommand]:
        """Yield the order that waited for the end of the pause, if it passes verification now."""
        waiting = self._held_back
        if waiting is None:
            return
        if why := self._verify(self._held_token, waiting):
            self._end_held_back(why)
            self._refuse("INVALID_ORDER", why, (("actionId", waiting.command_id),), keep=True)
            return
        self._held_back = None
        yield waiting

    def _end_held_back(self, why: str) -> None:
        """End an order that waits for the end of the pause, without carrying it out."""
        if (waiting := self._held_back) is not None:
            self._held_back = None
            self.hear(
                CommandReply(
                    command_id=waiting.command_id,
                    agent=waiting.agent,
                    status="failed",
                    tick=0,
                    detail=why,
                )
            )


def _token(action: RobotAction) -> str | None:
    token = action.parameter(AUTHORIZATION)
    return token if isinstance(token, str) else None
