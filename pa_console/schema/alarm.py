"""Alarms: what the picture shows that needs somebody to act (paper, Section IV-C)."""

from typing import Literal

from pydantic import Field

from pa_console.schema.base import Name, NonNegative, StrictModel
from pa_console.schema.mission import Mission

AlarmKind = Literal[
    "hostile_track", "defiant_track", "unknown_track", "unauthorized_track",
    "coverage_lost", "coverage_unknown", "asset_failed", "link_lost", "low_battery",
    "camera_lost", "suspect_telemetry", "many_contacts",
]  # fmt: skip
AlarmPriority = Literal["emergency", "high", "medium", "low"]
ALARM_PRIORITIES: tuple[AlarmPriority, ...] = ("emergency", "high", "medium", "low")


class Alarm(StrictModel):
    """One thing that needs a response; it stays open until its cause is gone.

    `command` is the mission that answers it, in plain language; empty when an operator's eye is
    the whole response.
    """

    id: str
    kind: AlarmKind
    priority: AlarmPriority
    subject: Name = Field(description="the track, asset, gate, camera or sensor it is about")
    gate: Name | None = None
    text: str
    command: str = ""
    raised_s: NonNegative
    distance_m: NonNegative | None = Field(default=None, description="of a track to its gate")


class QueueEntry(StrictModel):
    """One mission that waits, and why it stands where it stands (WF-04, WF-05)."""

    mission: Mission
    priority: AlarmPriority
    distance_m: NonNegative | None = None
    deferred: bool = False
    reason: str
