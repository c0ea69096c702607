"""The flight modes of ArduPilot, and its parameters on which the console relies."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from pa_console.fleets.link import LinkFinding
from pa_console.fleets.mavlink.vehicles_file import MavlinkVehicles
from pa_console.schema.world import AssetKind

ROVER_TYPES = frozenset((10, 11))
"""The MAV_TYPE numbers of the vehicles, on land and water, that run ArduPilot Rover."""

COPTER_MODES: Mapping[int, str] = {
    0: "STABILIZED", 1: "ACRO", 2: "ALTCTL", 3: "MISSION", 4: "GUIDED", 5: "LOITER", 6: "RTL",
    7: "CIRCLE", 9: "LAND", 11: "DRIFT", 13: "SPORT", 14: "FLIP", 15: "AUTOTUNE", 16: "POSCTL",
    17: "HOLD", 18: "THROW", 20: "GUIDED_NOGPS", 21: "SMART_RTL", 22: "FLOWHOLD", 23: "FOLLOW",
    24: "ZIGZAG", 27: "AUTO_RTL",
}  # fmt: skip
"""The modes of ArduPilot Copter by number, with PX4's names for modes that both have; 17 is BRAKE.

LOITER is a pilot's mode. In it, the drone sinks if the throttle stick is down, which is also its
position when there is no remote control.
"""

ROVER_MODES: Mapping[int, str] = {
    0: "MANUAL", 1: "ACRO", 3: "STEERING", 4: "HOLD", 5: "HOLD", 6: "FOLLOW", 7: "SIMPLE",
    10: "MISSION", 11: "RTL", 12: "SMART_RTL", 15: "GUIDED", 16: "INITIALISING",
}  # fmt: skip
"""The modes of ArduPilot Rover by number."""

GUIDED: Mapping[AssetKind, int] = {"uav": 4, "ugv": 15}
"""The mode for commands from a station. A copter can take off from the ground only in this mode."""

STANDS: Mapping[AssetKind, int] = {"uav": 17, "ugv": 4}
"""The mode in which a vehicle stops at once and keeps its place, regardless of a remote control."""

BATTERY = "BATT_MONITOR"
"""The parameter that enables reports of the battery level."""

POLYGON = 4
"""The bit of FENCE_TYPE for polygons."""

GOES_ON = 2
"""The bit of FS_OPTIONS with which a mission continues without a station."""

NO_FENCE = "it ignores its fence, so it may not start a flight"
LOST = "it does not notice that the console is gone"


def mode_name(vehicle_type: int, custom_mode: int) -> str:
    """Return the name of the mode with the given number in a heartbeat."""
    modes = ROVER_MODES if vehicle_type in ROVER_TYPES else COPTER_MODES
    return modes.get(custom_mode, f"MODE {custom_mode}")


def has_polygons(fence_type: float) -> bool:
    """Return whether the autopilot enforces polygons with the given value of FENCE_TYPE."""
    return bool(int(fence_type) & POLYGON)


@dataclass(frozen=True)
class Parameter:
    """One parameter with its correct values; `otherwise` is the consequence of a wrong value."""

    name: str
    good: Callable[[float], bool]
    wanted: str
    otherwise: str

    def finding(self, agent: str, values: Mapping[str, float]) -> LinkFinding:
        """Return the finding about this parameter in `values`; a missing value is not an error."""
        value = values.get(self.name)
        if value is None:
            return LinkFinding(agent, self.name, "not reported")
        finding = LinkFinding(agent, self.name, f"{value:g}")
        return finding.unless(self.good(value), self.wanted, self.otherwise)


def parameters(kind: AssetKind, vehicles: MavlinkVehicles, station: int) -> tuple[Parameter, ...]:
    """Return the parameters to check; `station` is the console's own system id."""
    polygon = f"a value that includes {POLYGON}"
    settings = [
        Parameter(BATTERY, lambda v: v > 0, "4", "its battery counts as low"),
        Parameter("BATT_FS_LOW_ACT", lambda v: v > 0, "2", "it continues with an empty battery"),
        Parameter("FENCE_ACTION", lambda v: v > 0, "1", NO_FENCE),
        Parameter("FENCE_TYPE", has_polygons, polygon, NO_FENCE),
        Parameter("FS_GCS_ENABLE", lambda v: v > 0, "1", LOST),
        Parameter("MAV_GCS_SYSID", lambda v: int(v) == station, str(station), LOST),
    ]
    if kind == "uav":
        ceiling, orders = vehicles.ceiling_m, ", ".join(vehicles.survives_lost_link)
        high = f"it breaches its fence on a flight at ceiling_m, {ceiling:g} m"
        settings.append(
            Parameter("FENCE_ALT_MAX", lambda v: v >= ceiling, f"{ceiling:g} or more", high)
        )
        if orders:
            cut = f"its failsafe ends '{orders}' when the link is lost"
            wanted = f"a value that includes {GOES_ON}"
            settings.append(Parameter("FS_OPTIONS", lambda v: bool(int(v) & GOES_ON), wanted, cut))
    return tuple(settings)
