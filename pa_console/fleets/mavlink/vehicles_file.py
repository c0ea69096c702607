"""The file of a MAVLink link, with its vehicles and the altitudes of the drones.

connection: udp://0.0.0.0:14540
floor_m: 10
ceiling_m: 60
altitude_m: 20
vehicles:
  Drone_T01: {system_id: 1}
  Drone_T02: {system_id: 2, altitude_m: 25, altitudes_m: {observe: 40}}
  Ugv_T01: {system_id: 3, kind: ugv}
"""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from pa_console.schema.base import Name, Positive, StrictModel
from pa_console.schema.document import Document
from pa_console.schema.world import Origin, World

FlownVerb = Literal["move_to", "observe"]
"""The orders with an altitude from the console; the autopilot sets the altitude of a return."""

Altitude = Annotated[float, Field(gt=0.0, le=500.0)]
"""An altitude in metres above the place where the drone was armed."""

MOST_VEHICLES = 200


class VehicleSpec(StrictModel):
    """One vehicle: its MAVLink system id, its kind, and its own altitudes if it is a drone."""

    system_id: int = Field(ge=1, le=244)
    kind: Literal["uav", "ugv"] = "uav"
    altitude_m: Altitude | None = None
    altitudes_m: dict[FlownVerb, Altitude] = {}


class MavlinkVehicles(StrictModel):
    """The vehicles of one link; altitudes are in metres above the place of arming."""

    connection: str | tuple[str, ...] = Field(
        default="", description="one or several, used when the file itself is the address"
    )
    origin: Origin | None = Field(default=None, description="for a world that has no origin")
    floor_m: Altitude = 5.0
    ceiling_m: Altitude = 100.0
    altitude_m: Altitude = 20.0
    altitudes_m: dict[FlownVerb, Altitude] = {}
    survives_lost_link: tuple[FlownVerb, ...] = Field(
        default=("observe",), description="orders that are flown as an uploaded mission"
    )
    fence_check_s: Positive = Field(default=10.0, ge=1.0, le=600.0)
    vehicles: dict[Name, VehicleSpec] = Field(min_length=1, max_length=MOST_VEHICLES)

    def altitude(self, agent: str, verb: FlownVerb) -> float:
        """Return the altitude from the most specific setting for `agent` and `verb`."""
        own = self.vehicles[agent]
        fallback = self.altitudes_m.get(verb, self.altitude_m)
        return own.altitudes_m.get(verb, own.altitude_m or fallback)


def read_vehicles(path: Path, world: World) -> MavlinkVehicles:
    """Return the vehicles in the file at `path`; raises DocumentError, a ValueError, if invalid."""
    document = Document.read(path)
    vehicles = document.parse(MavlinkVehicles)
    if vehicles.floor_m > vehicles.ceiling_m:
        problem = f"{vehicles.floor_m:g} m is above ceiling_m, {vehicles.ceiling_m:g} m: lower it"
        raise document.error(("floor_m",), problem)
    owners: dict[int, str] = {}
    for agent, vehicle in vehicles.vehicles.items():
        field = ("vehicles", agent)
        asset = world.assets.get(agent)
        if asset is None:
            names = ", ".join(n for n, spec in world.assets.items() if spec.kind == vehicle.kind)
            problem = (
                f"the world {world.name!r} has no such asset; its assets of the kind "
                f"{vehicle.kind}: {names or 'none'}"
            )
            raise document.error(field, problem)
        if asset.kind != vehicle.kind:
            remedy = "only drones and ground vehicles are driven over MAVLink"
            if asset.kind in ("uav", "ugv"):
                remedy = f"give it 'kind: {asset.kind}'"
            problem = (
                f"is a {asset.kind} in the world {world.name!r}, not a {vehicle.kind}: {remedy}"
            )
            raise document.error(field, problem)
        if (other := owners.setdefault(vehicle.system_id, agent)) != agent:
            problem = f"{vehicle.system_id} is the system id of {other} too: give each one its own"
            raise document.error((*field, "system_id"), problem)
        for verb in ("move_to", "observe") if vehicle.kind == "uav" else ():
            height = vehicles.altitude(agent, verb)
            if not vehicles.floor_m <= height <= vehicles.ceiling_m:
                raise document.error(
                    field,
                    f"{verb} at {height:g} m is outside {vehicles.floor_m:g} to "
                    f"{vehicles.ceiling_m:g} m: change the altitude, or floor_m and ceiling_m",
                )
    return vehicles
