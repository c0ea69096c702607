"""The steps of an order, which an autopilot is asked for one after another."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import cast

from pa_console.fleets.mavlink import commands
from pa_console.fleets.mavlink.commands import Cmd, Degrees, Kind, MavCommand, MavItem
from pa_console.fleets.mavlink.drone_state import DroneState, Fix
from pa_console.fleets.mavlink.vehicles_file import FlownVerb, MavlinkVehicles
from pa_console.schema.base import Point
from pa_console.schema.command import DeviceCommand
from pa_console.schema.world import AssetKind
from pa_console.sim.worlds.geography import Geography
from pa_console.sim.worlds.terrain import Terrain

UNANSWERED_S = 3.0
"""mavsdk has answered a hold within this time, or never will."""


@dataclass(frozen=True)
class Upload:
    """The step of replacing the mission."""

    items: tuple[MavItem, ...]


@dataclass(frozen=True)
class Climb:
    """The step of waiting until the drone has taken off, metres above home."""

    altitude_m: float


Step = MavCommand | Upload | Climb


@dataclass
class FlightOrder:
    """An order on its way; the first of `steps` is the one that is being carried out.

    Times are those of the flight's clock, seconds.
    """

    command: DeviceCommand
    steps: deque[Step]
    target: Point | None
    """The place where it ends; None for home, wherever the drone has that."""
    altitude_m: float
    since_s: float
    step_s: float | None = None
    """When the step was asked for, last; None if it has not been."""
    tries: int = 0
    refused: tuple[str, float] | None = None
    """The autopilot's refusal, and its time."""
    acknowledged: bool = False
    nearest_m: float = math.inf
    nearest_s: float = 0.0
    told_s: float = 0.0
    started_s: float = 0.0
    """When the autopilot had accepted all of it."""

    @property
    def arming(self) -> bool:
        """True while the order needs the drone armed."""
        return any(isinstance(s, MavCommand) and s.command == Cmd.ARM for s in self.steps)


@dataclass
class HoldOrder:
    """A hold, from when it is asked for until the drone stands."""

    command: DeviceCommand
    asked_s: float
    """When the autopilot was asked."""
    accepted_s: float | None = None
    accepted_at: datetime | None = None
    asked: bool = True
    """True while the autopilot has not answered."""
    refused: tuple[str, float] | None = None
    done: bool = False

    def waits(self, now: float) -> bool:
        """Return whether the autopilot has still to answer."""
        return self.asked and now - self.asked_s < UNANSWERED_S


@dataclass
class OrderPlanner:
    """Makes orders of the commands to the vehicle `agent`, at altitudes that `vehicles` gives."""

    agent: str
    terrain: Terrain
    geography: Geography
    vehicles: MavlinkVehicles
    others: Callable[[], Sequence[Point]]
    """Returns the places that other drones have, or are on their way to."""
    _looks: bool = field(default=False, init=False)
    """True while the drone looks at a region of interest."""

    @property
    def asset_kind(self) -> AssetKind:
        """The kind of the vehicle, by the file of the vehicles."""
        return self.vehicles.vehicles[self.agent].kind

    def plan(
        self, command: DeviceCommand, state: DroneState, fix: Fix, kind: Kind, now_s: float
    ) -> FlightOrder | str:
        """Return the order that carries `command` out from where the drone is, or why none does."""
        route: tuple[Point, ...] = ()
        altitude, flies = max(fix.altitude_m, self.vehicles.floor_m), self.asset_kind == "uav"
        # A ground vehicle's own way home is a straight line, through whatever stands there.
        if command.verb != "return_to_base" or not flies:
            if flies:
                altitude = self.vehicles.altitude(self.agent, cast("FlownVerb", command.verb))
            target = command.target or self.terrain.world.base
            place = self._place(target, fix)
            if place is None:
                return f"{target}: there is no free place for it"
            found = self.terrain.planner.route(self.asset_kind, fix.at, place)
            if found is None:
                return f"{target} cannot be reached"
            route = found
        steps: list[Step] = [commands.LOOK_AHEAD] if self._looks else []
        if flies:
            steps += self._flown(
                command, kind, state.landed, (altitude, fix.home_msl_m + altitude), route
            )
        else:
            steps += self._driven(kind, state, fix, route)
        self._looks = command.verb == "observe"
        return FlightOrder(command, deque(steps), route[-1] if route else None, altitude, now_s)

    def _place(self, frame: str, fix: Fix) -> Point | None:
        """Return where the drone is to stay at a frame: where it stands, else a free place."""
        if self.terrain.frame_at(*fix.at) == frame and fix.speed_mps == 0.0:
            return fix.at
        return self.terrain.free_place(frame, self.asset_kind, self.others())

    def _driven(
        self, kind: Kind, state: DroneState, fix: Fix, route: Sequence[Point]
    ) -> list[Step]:
        """Return the steps of a ground vehicle: it does not take off, and has no altitude."""
        way = [self.geography.degrees(at) for at in route]
        if len(way) > 1:
            items = commands.mission_of(kind, way, 0.0, None, on_ground=False)
            begin = commands.start_mission(kind, "ugv", disarmed=not state.armed)
            return [Upload(items), *begin]
        arming = () if state.armed else commands.arm(kind, "ugv")
        return [*arming, commands.reposition(way[-1], fix.msl_m)]

    def _flown(
        self,
        command: DeviceCommand,
        kind: Kind,
        on_ground: bool,
        heights_m: tuple[float, float],
        route: Sequence[Point],
    ) -> list[Step]:
        """Return the steps of a drone; its height is given above home and above sea level."""
        altitude, msl_m = heights_m
        interest = self._interest(command.target or "") if command.verb == "observe" else None
        way: list[Degrees] = [self.geography.degrees(at) for at in route]
        if route and (command.verb in self.vehicles.survives_lost_link or len(route) > 1):
            items = commands.mission_of(kind, way, altitude, interest, on_ground=on_ground)
            return [Upload(items), *commands.start_mission(kind, "uav", disarmed=on_ground)]
        steps: list[Step] = []
        if on_ground:
            steps += [*commands.start_flight(kind, altitude, msl_m), Climb(altitude)]
        if not way:
            return [*steps, commands.GO_HOME]
        if interest is not None:
            steps.append(commands.look_at(interest))
        return [*steps, commands.reposition(way[-1], msl_m)]

    def _interest(self, gate: str) -> Degrees:
        """Return where to look at a gate: at the end of its lane, where contacts wait."""
        lanes = self.terrain.lanes_to(gate)
        at = (
            self.terrain.lanes[lanes[0]].waiting_point
            if lanes
            else self.terrain.world.frames[gate].at
        )
        return self.geography.degrees(at)
