"""ArduPilot's own words: its flight modes, and the parameters that the console relies on."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from pa_console.fleets.mavlink.vehicles_file import MavlinkVehicles
from pa_console.schema.world import AssetKind, World

ROVER_TYPES = frozenset((10, 11))
"""MAV_TYPE of vehicles that ArduPilot's Rover drives, on the ground and on water."""

COPTER_MODES: Mapping[int, str] = {
    0: "STABILIZED", 1: "ACRO", 2: "ALTCTL", 3: "MISSION", 4: "GUIDED", 5: "LOITER", 6: "RTL",
    7: "CIRCLE", 9: "LAND", 11: "DRIFT", 13: "SPORT", 14: "FLIP", 15: "AUTOTUNE", 16: "POSCTL",
    17: "HOLD", 18: "THROW", 20: "GUIDED_NOGPS", 21: "SMART_RTL", 22: "FLOWHOLD", 23: "FOLLOW",
    24: "ZIGZAG", 27: "AUTO_RTL",
}  # fmt: skip
"""Its modes by number, by PX4's names where both have one; 17 is BRAKE.

LOITER is a mode of the pilot: a stick that is down, as without any remote control, makes it sink.
"""

ROVER_MODES: Mapping[int, str] = {
    0: "MANUAL", 1: "ACRO", 3: "STEERING", 4: "HOLD", 5: "HOLD", 6: "FOLLOW", 7: "SIMPLE",
    10: "MISSION", 11: "RTL", 12: "SMART_RTL", 15: "GUIDED", 16: "INITIALISING",
}  # fmt: skip

GUIDED: Mapping[AssetKind, int] = {"uav": 4, "ugv": 15}
"""The mode for commands from a station; a copter takes off from the ground in it only."""

STANDS: Mapping[AssetKind, int] = {"uav": 17, "ugv": 4}
"""The mode in which it stops at once and keeps its place, whatever a remote control does."""


def mode_name(vehicle_type: int, custom_mode: int) -> str:
    """Return the name of a mode as a heartbeat has it."""
    modes = ROVER_MODES if vehicle_type in ROVER_TYPES else COPTER_MODES
    return modes.get(custom_mode, f"MODE {custom_mode}")


@dataclass(frozen=True)
class Parameter:
    """One parameter and its value as it should be; `otherwise` is the consequence if it is not."""

    name: str
    good: Callable[[float], bool]
    wanted: str
    otherwise: str


def parameters(
    kind: AssetKind, vehicles: MavlinkVehicles, world: World, station: int
) -> tuple[Parameter, ...]:
    """Return the parameters to look at; `station` is the console's own system id."""
    found = [
        Parameter(BATTERY, lambda v: v > 0, "4", "its battery counts as low"),
        Parameter(
            "BATT_FS_LOW_ACT", lambda v: v > 0, "2", "an empty battery does not bring it down safely"
        ),
        Parameter("FENCE_ACTION", lambda v: v > 0, "1", "it would not act on its geofence: it starts no flight"),
        Parameter(
            "FENCE_TYPE",
            lambda v: bool(int(v) & POLYGON),
            f"one with {POLYGON} in it",
            "it does not keep to the perimeter: it starts no flight",
        ),
        Parameter("FS_GCS_ENABLE", lambda v: v > 0, "1", f"{LOST}; the world says {world.lost_link}"),
        Parameter("MAV_GCS_SYSID", lambda v: int(v) == station, str(station), LOST),
    ]
    if kind == "uav":
        ceiling = vehicles.ceiling_m
        found.append(
            Parameter(
                "FENCE_ALT_MAX",
                lambda v: v >= ceiling,
                f"{ceiling:g} or more",
                f"flights up to ceiling_m, {ceiling:g} m, break its fence",
            )
        )
    return tuple(found)


BATTERY = "BATT_MONITOR"
"""The parameter that brings the battery's level."""

POLYGON = 4
"""The bit of FENCE_TYPE for polygons."""

LOST = "it does not notice that the console is gone"
