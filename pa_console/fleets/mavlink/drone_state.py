"""The state of one vehicle according to its MAVLink messages, in the world's frame."""

import math
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Any

from pa_console.schema.base import Point
from pa_console.schema.telemetry import AssetStatus
from pa_console.sim.worlds.geography import Geography

FAR_M = 10_000.0
"""The largest accepted distance of a position from the world's origin, in metres.

A larger distance means a wrong origin, or a position that was reported without GPS.
"""

STANDS_MPS = 0.3
"""The speed up to which a vehicle counts as stopped, because a hovering drone drifts."""

DRIFT = 1e-4
"""The largest drift of an autopilot's clock, as a fraction of the time."""

REBOOT_S = 5.0
"""The decrease of a drone's time since boot, in seconds, that shows a restart."""

NO_PLACE = "no longer knows where it is"
MOST_TEXT = 200
"""The largest number of characters of a status text."""

PILOT_MODES = frozenset(
    ("MANUAL", "ALTCTL", "POSCTL", "ACRO", "STABILIZED", "RATTITUDE", "LOITER", "DRIFT", "SPORT",
     "FLIP", "AUTOTUNE", "FLOWHOLD", "ZIGZAG", "STEERING", "SIMPLE")
)  # fmt: skip
"""The flight modes in which a pilot steers with a remote control."""

PREARM = "PreArm:"
"""The beginning of the texts in which ArduPilot reports reasons for not arming."""

PREARM_S = 12.0
"""The time for which a reported reason is valid, in seconds; reasons are requested every 5 s."""

CRITICAL, EMERGENCY, TERMINATING = 5, 6, 8
"""System states (MAV_STATE) in a heartbeat."""


class BootClock:
    """The conversion of a drone's time since boot to the station's time.

    The message with the shortest delay determines the time of the boot. Therefore, the age of
    every later message is known, even if the message was delayed.
    """

    def __init__(self) -> None:
        self._began: datetime | None = None
        self._latest_s = 0.0
        self._moved: datetime | None = None
        self._sent: datetime | None = None

    def sent(self, boot_s: float, arrived: datetime) -> datetime | None:
        """Return the time at which a message was sent; None if it is older than the last message.

        After a restart, the time of the boot is determined again. The result is never earlier than
        the last result.
        """
        began = arrived - timedelta(seconds=boot_s)
        if self._began is None or self._moved is None or boot_s < self._latest_s - REBOOT_S:
            self._began = began
        elif boot_s < self._latest_s:
            return None
        else:
            drift_s = (arrived - self._moved).total_seconds() * DRIFT
            self._began = min(began, self._began + timedelta(seconds=max(drift_s, 0.0)))
        self._latest_s, self._moved = boot_s, arrived
        sent = min(arrived, self._began + timedelta(seconds=boot_s))
        self._sent = sent if self._sent is None else max(sent, self._sent)
        return self._sent

    def restarted(self, boot_s: float) -> bool:
        """Return whether a message with this time since boot shows that the drone restarted."""
        return self._began is not None and boot_s < self._latest_s - REBOOT_S


@dataclass(frozen=True)
class Fix:
    """A drone's position; `altitude_m` is above its home, `msl_m` above sea level."""

    at: Point
    sent: datetime
    altitude_m: float
    msl_m: float
    heading_deg: float
    speed_mps: float

    @property
    def home_msl_m(self) -> float:
        """The height of the drone's home above sea level."""
        return self.msl_m - self.altitude_m


@dataclass(frozen=True)
class StatusText:
    """A status text of the drone, with the station's time; severity 0 is the most severe."""

    at_s: float
    severity: int
    text: str


@dataclass
class DroneState:
    """The latest reports of one vehicle; a `ground_bound` vehicle never flies."""

    geography: Geography
    ground_bound: bool = False
    clock: BootClock = field(default_factory=BootClock)
    fix: Fix | None = None
    mode: str = "UNKNOWN"
    mode_s: float = 0.0
    """The time of the last report of the mode."""
    beats: bool = False
    """True if a heartbeat has arrived."""
    armed: bool = False
    system_state: int = 0
    on_ground: bool | None = None
    healthy: bool = True
    may_arm: bool | None = None
    """False while the vehicle's own checks prevent arming; None while they are unknown."""
    prearm: dict[str, float] = field(default_factory=dict[str, float])
    """The reported reasons for not arming, each with the time of its last report."""
    battery_pct: float | None = None
    home: Point | None = None
    texts: deque[StatusText] = field(default_factory=lambda: deque[StatusText](maxlen=32))
    _chunks: dict[int, str] = field(default_factory=dict[int, str])

    @property
    def manual(self) -> bool:
        """True while a pilot steers the vehicle."""
        return self.armed and self.mode in PILOT_MODES

    @property
    def landed(self) -> bool:
        """True if the vehicle is on the ground, or if this is unknown and it is disarmed."""
        unheard = self.on_ground is None and not self.armed
        return self.ground_bound or self.on_ground is True or unheard

    @property
    def parked(self) -> bool:
        """True if the vehicle is on the ground and disarmed."""
        return self.landed and not self.armed

    def prearm_problem(self, now_s: float) -> str:
        """Return why the vehicle's own checks prevent arming; '' if they do not."""
        if self.armed or self.may_arm is not False:
            self.prearm.clear()
            return ""
        fresh = [text for text, at_s in self.prearm.items() if now_s - at_s < PREARM_S]
        return "; ".join(fresh[:3]) or "its checks before arming have not passed"

    @property
    def status(self) -> AssetStatus:
        """The status of the vehicle in the picture."""
        if self.system_state in (EMERGENCY, TERMINATING):
            return "failed"
        return "ok" if self.healthy and self.system_state != CRITICAL else "degraded"

    def positioned(self, message: Mapping[str, Any], arrived: datetime) -> str:
        """Process a GLOBAL_POSITION_INT; return why the position is refused, or '' if it is not."""
        latitude, longitude = int(message["lat"]) / 1e7, int(message["lon"]) / 1e7
        if not (-90.0 <= latitude <= 90.0 and -180.0 <= longitude <= 180.0):
            return "reports a position that is not on the earth"
        if latitude == 0.0 and longitude == 0.0:
            return NO_PLACE if self.fix is not None else ""
        at = self.geography.near(latitude, longitude)
        if at is None or math.hypot(*at) > FAR_M:
            return (
                f"reports a position far from the world ({latitude:.5f}, {longitude:.5f}): "
                "check the world's origin"
            )
        sent = self.clock.sent(int(message["time_boot_ms"]) / 1e3, arrived)
        if sent is None:
            return ""
        vx, vy, vz = (int(message[name]) / 100.0 for name in ("vx", "vy", "vz"))
        speed = math.hypot(vx, vy, vz)
        course = int(message["hdg"])
        before_deg = self.fix.heading_deg if self.fix is not None else 0.0
        heading = self.geography.heading(course / 100.0) if 0 <= course < 36_000 else before_deg
        self.fix = Fix(
            at,
            sent,
            int(message["relative_alt"]) / 1e3,
            int(message["alt"]) / 1e3,
            round(heading, 1),
            round(speed, 2) if speed >= STANDS_MPS else 0.0,
        )
        return ""

    def said(self, message: Mapping[str, Any], now_s: float) -> StatusText | None:
        """Process a STATUSTEXT and return its text so far; None if there is none.

        A long text arrives in parts.
        """
        part = "".join(c if c.isprintable() else " " for c in str(message["text"])).strip()
        number, sequence = int(message.get("id", 0)), int(message.get("chunk_seq", 0))
        if number and sequence:
            part = f"{self._chunks.get(number, '')}{part}"
        if number:
            self._chunks.clear()
            self._chunks[number] = part[:MOST_TEXT]
        severity = int(message["severity"])
        if not part or not 0 <= severity <= 7:
            return None
        line = StatusText(now_s, severity, part[:MOST_TEXT])
        if sequence and self.texts:
            self.texts.pop()
        self.texts.append(line)
        if line.text.startswith(PREARM):
            self.prearm[line.text] = now_s
        return line

    def reasons(self, since_s: float) -> Iterator[str]:
        """Yield the texts since `since_s` that may explain a refusal, the latest first."""
        notice = 5
        for line in reversed(self.texts):
            if line.at_s < since_s:
                return
            if line.severity <= notice:
                yield line.text
