"""The requests to an autopilot (commands and mission items), and the `Autopilot` protocol.

Numbers and units are those of the MAVLink common message set: degrees times 10^7, metres.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, Protocol

from pa_console.fleets.mavlink.ardupilot import GUIDED
from pa_console.schema.world import AssetKind

Kind = Literal["px4", "ardupilot", "other"]
Degrees = tuple[float, float]
"""Latitude and longitude, in degrees."""

GLOBAL, RELATIVE = 5, 6
"""The values of MAV_FRAME with integer degrees: altitude above sea level, and above home."""

KEEP = math.nan
"""The parameter value that keeps the vehicle's own value, such as its yaw."""

E7 = 10_000_000
_CUSTOM_MODE = 1.0


class Cmd(IntEnum):
    """The commands (MAV_CMD) that the console sends."""

    WAYPOINT = 16
    LOITER = 17
    RETURN_TO_LAUNCH = 20
    TAKEOFF = 22
    SET_MODE = 176
    REPOSITION = 192
    REGION_OF_INTEREST = 195
    NO_REGION_OF_INTEREST = 197
    FENCE_ENABLE = 207
    SET_MISSION_CURRENT = 224
    START_MISSION = 300
    RUN_PREARM_CHECKS = 401
    SET_MESSAGE_INTERVAL = 511
    ARM = 400
    FENCE_INSIDE = 5001
    FENCE_OUTSIDE = 5002


PLAINLY: dict[int, str] = {
    Cmd.RETURN_TO_LAUNCH: "return to launch",
    Cmd.TAKEOFF: "take off",
    Cmd.SET_MODE: "change of mode",
    Cmd.REPOSITION: "reposition",
    Cmd.REGION_OF_INTEREST: "region of interest",
    Cmd.NO_REGION_OF_INTEREST: "no region of interest",
    Cmd.SET_MISSION_CURRENT: "first item of the mission",
    Cmd.START_MISSION: "start of the mission",
    Cmd.ARM: "arm",
}
"""The names of commands in the reasons for a refusal."""

ACCEPTED, IN_PROGRESS = 0, 5
RESULTS: dict[int, str] = {
    1: "temporarily rejected",
    2: "denied",
    3: "unsupported",
    4: "failed",
    6: "cancelled",
}
"""The results (MAV_RESULT) of a command that is not carried out."""


@dataclass(frozen=True)
class MavCommand:
    """A COMMAND_LONG or, if it has a place, a COMMAND_INT whose last parameters are the place."""

    command: Cmd
    params: tuple[float, ...] = ()
    place: Degrees | None = None
    altitude_m: float = 0.0
    frame: int = GLOBAL
    optional: bool = False
    """True if the order continues even if this command is refused."""


@dataclass(frozen=True)
class MavItem:
    """One item (MISSION_ITEM_INT) of a mission or a geofence; x and y are degrees times 10^7."""

    command: int
    x: int
    y: int
    z: float = 0.0
    params: tuple[float, float, float, float] = (0.0, 0.0, 0.0, KEEP)
    frame: int = RELATIVE


class Autopilot(Protocol):
    """One vehicle on a link. No member waits or raises; the vehicle's `Flight` gets the results."""

    @property
    def kind(self) -> Kind:
        """The family of the autopilot, by its heartbeat."""
        ...

    def send(self, command: MavCommand, times: int) -> None:
        """Send a command once; `times` is the number of earlier attempts."""
        ...

    def hold(self) -> None:
        """Change to the mode that keeps the place; the request is repeated until it is answered."""
        ...

    def upload_mission(self, items: Sequence[MavItem]) -> None:
        """Replace the vehicle's mission."""
        ...

    def cancel_upload(self) -> None:
        """Cancel the upload of a mission."""
        ...

    def upload_fence(self, items: Sequence[MavItem]) -> None:
        """Replace the vehicle's geofence."""
        ...

    def read_fence(self) -> None:
        """Request the vehicle's geofence."""
        ...

    def enforce_fence(self) -> None:
        """Make the vehicle enforce its geofence, or check that it does."""
        ...

    def ask_again(self) -> None:
        """Request every message again, because the vehicle may have lost the earlier requests."""
        ...


def e7(degrees: float) -> int:
    """Return degrees as MAVLink's integer, which is degrees times 10^7."""
    return round(degrees * E7)


def start_flight(kind: Kind, altitude_m: float, msl_m: float) -> tuple[MavCommand, ...]:
    """Return the commands that arm a drone and make it take off to `altitude_m` above its home.

    `msl_m` is the same altitude above sea level.
    """
    # PX4 expects the altitude of this command above sea level, ArduPilot above home.
    height = msl_m if kind == "px4" else altitude_m
    take_off = MavCommand(Cmd.TAKEOFF, (0.0, 0.0, 0.0, KEEP, KEEP, KEEP, height))
    if kind == "ardupilot":
        take_off = MavCommand(Cmd.TAKEOFF, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height))
    return (*arm(kind, "uav"), take_off)


def arm(kind: Kind, asset: AssetKind) -> tuple[MavCommand, ...]:
    """Return the commands that arm a vehicle; an ArduPilot is first put in GUIDED mode."""
    guided = MavCommand(Cmd.SET_MODE, (_CUSTOM_MODE, float(GUIDED[asset])))
    return (*((guided,) if kind == "ardupilot" else ()), MavCommand(Cmd.ARM, (1.0,)))


def reposition(place: Degrees, altitude_msl_m: float) -> MavCommand:
    """Return the command to go to a place and stay there."""
    changes_mode = 1.0
    return MavCommand(Cmd.REPOSITION, (-1.0, changes_mode, 0.0, KEEP), place, altitude_msl_m)


def look_at(place: Degrees) -> MavCommand:
    """Return the command to point the camera, or the nose, at a place on the ground."""
    return MavCommand(Cmd.REGION_OF_INTEREST, (0.0, 0.0, 0.0, 0.0), place, 0.0, RELATIVE)


LOOK_AHEAD = MavCommand(Cmd.NO_REGION_OF_INTEREST, optional=True)
GO_HOME = MavCommand(Cmd.RETURN_TO_LAUNCH)
CHECK_AGAIN = MavCommand(Cmd.RUN_PREARM_CHECKS)


def mission_of(
    kind: Kind,
    way: Sequence[Degrees],
    altitude_m: float,
    interest: Degrees | None,
    *,
    on_ground: bool,
) -> tuple[MavItem, ...]:
    """Return a mission that follows `way`, looks at `interest`, and stays at the end."""
    (last_x, last_y) = (e7(degrees) for degrees in way[-1])
    items: list[MavItem] = []
    if kind == "ardupilot":  # ArduPilot replaces the first item by its home position
        items.append(MavItem(Cmd.WAYPOINT, last_x, last_y, 0.0))
    if on_ground:
        items.append(MavItem(Cmd.TAKEOFF, last_x, last_y, altitude_m))
    items += [MavItem(Cmd.WAYPOINT, e7(at[0]), e7(at[1]), altitude_m) for at in way]
    if interest is not None:
        looks = (0.0, 0.0, 0.0, 0.0)
        items.append(MavItem(Cmd.REGION_OF_INTEREST, e7(interest[0]), e7(interest[1]), 0.0, looks))
    items.append(MavItem(Cmd.LOITER, last_x, last_y, altitude_m))
    return tuple(items)


def start_mission(kind: Kind, asset: AssetKind, *, disarmed: bool) -> tuple[MavCommand, ...]:
    """Return the commands that start the uploaded mission at its first item."""
    first = 1.0 if kind == "ardupilot" else 0.0
    return (
        MavCommand(Cmd.SET_MISSION_CURRENT, (first,), optional=True),
        *(arm(kind, asset) if disarmed else ()),
        MavCommand(Cmd.START_MISSION, (0.0, 0.0)),
    )
