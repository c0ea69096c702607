"""The commands for devices, and the messages that carry them over the link (paper, IV-G)."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple

from pa_console.schema.base import Name, StrictModel
from pa_console.schema.telemetry import Task
from pa_console.schema.world import AssetKind

Verb = Literal[
    "hold", "move_to", "observe", "identify", "warn", "block", "return_to_base", "report"
]

_ALL: frozenset[AssetKind] = frozenset(("uav", "ugv", "robot"))
_UAV: frozenset[AssetKind] = frozenset(("uav",))
_UGV: frozenset[AssetKind] = frozenset(("ugv",))
_ROBOT: frozenset[AssetKind] = frozenset(("robot",))


class CommandSpec(NamedTuple):
    """The properties of a command that rules, simulator, bus, prompts and screen use."""

    kinds: frozenset[AssetKind]
    """The kinds of assets that may carry out the command."""
    takes_frame: bool
    task: Task | None
    """The task of an asset while it carries out the command; None leaves its task unchanged."""
    moves: bool = True
    """True if the command may take the asset to another place."""
    contact: Literal["", "watches", "addresses", "obstructs"] = ""
    """The kind of encounter with a track at the frame; '' for none."""
    plainly: str = ""
    """The verb for the asset's activity at its place; '' if the asset only moves or stays."""


COMMANDS: Mapping[Verb, CommandSpec] = MappingProxyType(
    {
        "hold": CommandSpec(_ALL, False, "holding", moves=False),
        "move_to": CommandSpec(_ALL, True, "holding"),
        "observe": CommandSpec(_UAV, True, "observing", True, "watches", "observes"),
        "identify": CommandSpec(_ROBOT, True, "identifying", True, "addresses", "identifies"),
        "warn": CommandSpec(_ROBOT, True, "warning", True, "addresses", "warns"),
        "block": CommandSpec(_UGV, True, "blocking", True, "obstructs", "blocks"),
        "return_to_base": CommandSpec(_ALL, False, "charging"),
        "report": CommandSpec(_ALL, False, None, moves=False, plainly="reports"),
    }
)
"""The whole vocabulary. It has no command for force, and none will be added (ROE-01)."""

STILL: frozenset[Verb] = frozenset(verb for verb, spec in COMMANDS.items() if not spec.moves)
"""The commands that move nothing: to hold and to report."""
ENCOUNTERS: tuple[Verb, ...] = tuple(verb for verb, spec in COMMANDS.items() if spec.contact)
"""The commands that deal with a contact at a gate."""
ADDRESSING: frozenset[Verb] = frozenset(
    verb for verb in ENCOUNTERS if COMMANDS[verb].contact == "addresses"
)
"""The commands that need a contact at the frame and spend time with it."""
ATTENDING: frozenset[Verb] = frozenset(
    verb for verb in ENCOUNTERS if COMMANDS[verb].contact != "watches"
)
"""The commands during which an asset stands in front of a contact."""
ATTENDING_TASKS: frozenset[Task] = frozenset(
    task for verb in ATTENDING if (task := COMMANDS[verb].task)
)
BUSY_TASKS: frozenset[Task] = frozenset((*ATTENDING_TASKS, "charging"))
"""The tasks during which an asset is not free to leave."""

ReplyStatus = Literal["acknowledged", "refused", "progress", "done", "failed"]
FINAL_REPLIES: frozenset[ReplyStatus] = frozenset(("refused", "done", "failed"))


class DeviceCommand(StrictModel):
    """One command for one agent; a device carries out a `command_id` at most once."""

    command_id: str
    agent: Name
    verb: Verb
    target: Name | None = None


class CommandReply(StrictModel):
    """A device's reply to a command, at simulated time `tick`."""

    command_id: str
    agent: Name
    status: ReplyStatus
    tick: int
    detail: str = ""
