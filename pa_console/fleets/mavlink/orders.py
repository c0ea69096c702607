"""Orders to one vehicle, and the planner that divides a command into steps for the autopilot."""

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
"""The longest wait for the answer of mavsdk to a hold, in seconds; no answer arrives later."""


@dataclass(frozen=True)
class Upload:
    """A step that replaces the mission of the autopilot."""

    items: tuple[MavItem, ...]


@dataclass(frozen=True)
class Climb:
    """A step that waits until the drone has taken off."""

    altitude_m: float
    """The altitude in metres above home."""


Step = MavCommand | Upload | Climb


@dataclass
class FlightOrder:
    """An order in progress; the first of `steps` is the current one.

    Times are in seconds on the flight's clock.
    """

    command: DeviceCommand
    steps: deque[Step]
    target: Point | None
    """The place where the order ends; None for the home position of the drone."""
    altitude_m: float
    since_s: float
    """The time at which the order was planned."""
    step_s: float | None = None
    """The time of the last request for the current step; None if there was none yet."""
    tries: int = 0
    """The number of requests for the current step."""
    refused: tuple[str, float] | None = None
    """The autopilot's refusal and its time."""
    acknowledged: bool = False
    nearest_m: float = math.inf
    """The shortest distance to the target so far."""
    nearest_s: float = 0.0
    """The time at which `nearest_m` was reached."""
    told_s: float = 0.0
    """The time of the last progress answer."""
    started_s: float = 0.0
    """The time at which the last step was completed."""

    @property
    def arming(self) -> bool:
        """True while a command to arm is among the remaining steps."""
        return any(isinstance(s, MavCommand) and s.command == Cmd.ARM for s in self.steps)


@dataclass
class HoldOrder:
    """A hold, from its request until the vehicle has stopped."""

    command: DeviceCommand
    asked_s: float
    """The time of the request to the autopilot."""
    accepted_s: float | None = None
    accepted_at: datetime | None = None
    asked: bool = True
    """True until the autopilot answers."""
    refused: tuple[str, float] | None = None
    done: bool = False

    def waits(self, now: float) -> bool:
        """Return whether an answer of the autopilot is still expected."""
        return self.asked and now - self.asked_s < UNANSWERED_S


@dataclass
class OrderPlanner:
    """The planner that turns commands to the vehicle `agent` into orders.

    The altitudes are those in `vehicles`.
    """

    agent: str
    terrain: Terrain
    geography: Geography
    vehicles: MavlinkVehicles
    others: Callable[[], Sequence[Point]]
    """A function that returns the places that other vehicles occupy or are on their way to."""
    _looks: bool = field(default=False, init=False)
    """True while the drone has a region of interest."""

    @property
    def asset_kind(self) -> AssetKind:
        """The kind of the vehicle in the file."""
        return self.vehicles.vehicles[self.agent].kind

    def plan(
        self, command: DeviceCommand, state: DroneState, fix: Fix, kind: Kind, now_s: float
    ) -> FlightOrder | str:
        """Return the order that carries out `command` from `fix`, or the reason why none can."""
        route: tuple[Point, ...] = ()
        altitude, flies = max(fix.altitude_m, self.vehicles.floor_m), self.asset_kind == "uav"
        # A drone returns with its autopilot's own function. A ground vehicle would drive home in a
        # straight line, through any obstacle, so it gets a route.
        if command.verb != "return_to_base" or not flies:
            if flies:
                altitude = self.vehicles.altitude(self.agent, cast("FlownVerb", command.verb))
            target = command.target or self.terrain.world.base
            place = self._place(target, fix)
            if place is None:
                return f"{target}: there is no free place for it"
            planned = self.terrain.planner.route(self.asset_kind, fix.at, place)
            if planned is None:
                return f"{target} cannot be reached"
            route = planned
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
        """Return the place for the vehicle at a frame; None if no place is free.

        A vehicle that has stopped at the frame keeps its place.
        """
        if self.terrain.frame_at(*fix.at) == frame and fix.speed_mps == 0.0:
            return fix.at
        return self.terrain.free_place(frame, self.asset_kind, self.others())

    def _driven(
        self, kind: Kind, state: DroneState, fix: Fix, route: Sequence[Point]
    ) -> list[Step]:
        """Return the steps for a ground vehicle, without a takeoff or altitudes."""
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
        """Return the steps for a drone; `heights_m` are heights above home and above sea level."""
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
        """Return the place to look at for a gate: the end of its lane, where contacts wait."""
        lanes = self.terrain.lanes_to(gate)
        at = (
            self.terrain.lanes[lanes[0]].waiting_point
            if lanes
            else self.terrain.world.frames[gate].at
        )
        return self.geography.degrees(at)
