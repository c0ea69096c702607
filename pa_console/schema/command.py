"""The commands of devices, and the messages that carry them over the link (paper, IV-G)."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple

from pa_console.schema.base import Name, StrictModel
from pa_console.schema.world import AssetKind

Verb = Literal[
    "hold", "move_to", "observe", "identify", "warn", "block", "return_to_base", "report"
]


class CommandSpec(NamedTuple):
    """The asset kinds that may carry a command out, and whether it names a frame."""

    kinds: frozenset[AssetKind]
    takes_frame: bool


_ALL: frozenset[AssetKind] = frozenset(("uav", "ugv", "robot"))

COMMANDS: Mapping[Verb, CommandSpec] = MappingProxyType(
    {
        "hold": CommandSpec(_ALL, False),
        "move_to": CommandSpec(_ALL, True),
        "observe": CommandSpec(frozenset(("uav",)), True),
        "identify": CommandSpec(frozenset(("robot",)), True),
        "warn": CommandSpec(frozenset(("robot",)), True),
        "block": CommandSpec(frozenset(("ugv",)), True),
        "return_to_base": CommandSpec(_ALL, False),
        "report": CommandSpec(_ALL, False),
    }
)
"""The whole vocabulary. It has no command for force, and none is ever added (ROE-01)."""

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
