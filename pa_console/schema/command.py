"""Messages between the orchestrator and a device over the link (paper, Section IV-G)."""

from typing import Literal

from pa_console.schema.base import Name, StrictModel
from pa_console.schema.plan import Verb

ReplyStatus = Literal["acknowledged", "refused", "progress", "done", "failed"]
FINAL_REPLIES: frozenset[ReplyStatus] = frozenset(("refused", "done", "failed"))


class DeviceCommand(StrictModel):
    """One command for one agent; a device carries out a `command_id` at most once."""

    command_id: str
    agent: Name
    verb: Verb
    target: Name | None = None


class CommandReply(StrictModel):
    """What a device says about a command, at simulated time `tick`."""

    command_id: str
    agent: Name
    status: ReplyStatus
    tick: int
    detail: str = ""
