"""The station's record of each robot on its bus, and of the commands sent to it."""

from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from datetime import datetime

from pa_console.fleets.vda5050.commands import Answer, answer_of
from pa_console.fleets.vda5050.factsheet import Factsheet
from pa_console.fleets.vda5050.messages import ConnectionState, State
from pa_console.fleets.vda5050.topics import Identity
from pa_console.fleets.vda5050.vehicle import ENDED
from pa_console.schema.command import FINAL_REPLIES, DeviceCommand

MOST_ASKED = 512


@dataclass(frozen=True)
class _Asked:
    """A command as the station knows it, and what its robot answered last."""

    command: DeviceCommand
    said: Answer | None = None


@dataclass
class Robot:
    """One robot of the fleet; `name` is its serial number and its name in the world."""

    identity: Identity
    factsheet: Factsheet | None = None
    connection: ConnectionState = "OFFLINE"
    state: State | None = None
    latest: datetime | None = None
    """When the state that was taken in last was sent."""
    held: bool = False
    """True if the robot got a hold after its last order."""
    waiting: DeviceCommand | None = None
    """An order that goes out once its running one is cancelled."""
    asked: OrderedDict[str, _Asked] = field(default_factory=OrderedDict[str, _Asked])
    """Commands sent, by action id on the wire."""

    @property
    def name(self) -> str:
        """The name of the asset that it is."""
        return self.identity.serial_number

    @property
    def busy(self) -> bool:
        """True if the robot reports an order."""
        if self.state is None:
            return False
        running = any(a.action_status not in ENDED for a in self.state.action_states)
        return running or bool(self.state.node_states)

    def cannot(self, command: DeviceCommand) -> str:
        """Return why it cannot carry out `command` by its own factsheet, "" when it can."""
        if command.verb == "hold" or self.factsheet is None:
            return ""
        if self.factsheet.offers(command.verb):
            return ""
        return f"its factsheet does not offer {command.verb}"

    def ask(self, action_id: str, command: DeviceCommand) -> None:
        """Note that `command` goes out as `action_id`; a repeated one is answered anew."""
        self.asked[action_id] = _Asked(command)
        self.asked.move_to_end(action_id)
        if len(self.asked) > MOST_ASKED:
            self.asked.popitem(last=False)

    def command_id(self, action_id: str | None) -> str | None:
        """Return the id of the command that went out as `action_id`, or an unknown one itself."""
        asked = self.asked.get(action_id) if action_id is not None else None
        return asked.command.command_id if asked is not None else action_id

    def answers(self, state: State) -> Iterator[tuple[DeviceCommand, Answer]]:
        """Take in `state`; yield what is new in it of the commands that were sent."""
        self.state = state
        for action_id, asked in list(self.asked.items()):
            if asked.said is not None and asked.said.status in FINAL_REPLIES:
                continue
            said = answer_of(action_id, asked.command.verb, state)
            if said is not None and said != asked.said:
                self.asked[action_id] = replace(asked, said=said)
                yield asked.command, said
