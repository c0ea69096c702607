"""The conversion between the telemetry of an asset and the state message of a robot."""

import math
from collections.abc import Iterator, Mapping
from datetime import datetime
from typing import get_args

from pa_console.fleets.vda5050.messages import (
    ActionState,
    ControlPoint,
    Error,
    Info,
    KnownZoneSet,
    PlannedPath,
    PowerSupply,
    RobotPosition,
    RobotState,
    SafetyState,
    Trajectory,
    Velocity,
)
from pa_console.fleets.vda5050.vehicle import ENDED, Vehicle
from pa_console.schema.base import Point
from pa_console.schema.command import COMMANDS
from pa_console.schema.telemetry import AssetStatus, AssetTelemetry, Task
from pa_console.schema.world import AssetKind
from pa_console.sim.worlds.terrain import Terrain

BROKEN, IMPAIRED, TASK = "BROKEN_DOWN", "IMPAIRED", "task"
TASKS: Mapping[str, Task] = {task: task for task in get_args(Task)}
_DOING: Mapping[str, Task] = {
    **{verb: spec.task for verb, spec in COMMANDS.items() if spec.contact and spec.task},
    "return_to_base": "returning",
}
"""The task of a robot that has stopped, by its current action."""


def state_of(
    report: AssetTelemetry,
    vehicle: Vehicle,
    header_id: int,
    sent: datetime,
    zone_sets: tuple[KnownZoneSet, ...] = (),
) -> RobotState:
    """Return the state message of `vehicle`, from its own `report`, sent at `sent` (UTC)."""
    nodes, edges = vehicle.way_ahead()
    errors = list(vehicle.errors)
    if report.status == "failed":
        errors.append(Error(error_type=BROKEN, error_level="FATAL"))
    elif report.status == "degraded":
        errors.append(Error(error_type=IMPAIRED, error_level="URGENT"))
    path = None
    if report.route:
        points = tuple(ControlPoint(x=x, y=y) for x, y in (report.position, *report.route))
        path = PlannedPath(trajectory=Trajectory(control_points=points))
    return RobotState(
        header_id=header_id,
        timestamp=sent,
        manufacturer=vehicle.identity.manufacturer,
        serial_number=vehicle.identity.serial_number,
        order_id=vehicle.order_id,
        order_update_id=0,
        last_node_id=report.post or "",
        last_node_sequence_id=0,
        node_states=nodes,
        edge_states=edges,
        driving=report.speed_mps > 0.0,
        paused=vehicle.paused,
        action_states=vehicle.action_states,
        instant_action_states=vehicle.instant_action_states,
        power_supply=PowerSupply(
            state_of_charge=report.battery_pct, charging=report.task == "charging"
        ),
        operating_mode="MANUAL" if report.manual else "AUTOMATIC",
        errors=tuple(errors),
        safety_state=SafetyState(),
        planned_path=path,
        mobile_robot_position=RobotPosition(
            x=report.position[0],
            y=report.position[1],
            theta=math.remainder(math.radians(report.heading_deg), math.tau),
            localized=True,
        ),
        velocity=Velocity(vx=report.speed_mps, vy=0.0),
        zone_sets=zone_sets,
        information=(Info(info_type=TASK, info_descriptor=report.task),),
    )


def telemetry_of(
    state: RobotState, name: str, kind: AssetKind, terrain: Terrain, stamp_s: float
) -> AssetTelemetry | None:
    """Return the telemetry of the asset `name` in `state`, as of `stamp_s` on the station's clock.

    Returns None if the robot has no valid position.
    """
    place = state.mobile_robot_position
    if place is None or not place.localized:
        return None
    low_pct, battery_pct = terrain.world.low_battery_pct, state.power_supply.state_of_charge
    velocity = state.velocity or Velocity()
    speed = math.hypot(velocity.vx or 0.0, velocity.vy or 0.0)
    status, manual = _status(state), state.manual
    at = terrain.frame_at(place.x, place.y)
    running = next((a for a in reversed(state.action_states) if a.action_status not in ENDED), None)
    return AssetTelemetry.of_valid(
        {
            "id": name,
            "kind": kind,
            "at": at,
            "post": _post(state, terrain),
            "position": (place.x, place.y),
            "heading_deg": round(math.degrees(place.theta), 1),
            "speed_mps": round(speed, 3),
            "status": status,
            "task": "none" if status == "failed" else _task(state, running),
            "battery_pct": battery_pct,
            "low_battery": battery_pct < low_pct,
            "comms": "ok",
            "available": status != "failed" and battery_pct > 0.0 and not manual,
            "stale": False,
            "integrity": "ok",
            "route": _route(state),
            "command_id": running.action_id if running is not None else None,
            "stamp_s": stamp_s,
            "manual": manual,
            "battery_known": True,
        }
    )


def faults_of(state: RobotState) -> Iterator[str]:
    """Yield the faults because of which a robot counts as failed."""
    if state.operating_mode in ("STARTUP", "SERVICE"):
        yield f"its operating mode is {state.operating_mode}"
    if (stop := state.safety_state.active_emergency_stop) != "NONE":
        yield f"its own stop is active ({stop})"
    for error in state.errors:
        if error.error_level in ("CRITICAL", "FATAL"):
            yield f"{error.error_type} ({error.error_level})"


def _status(state: RobotState) -> AssetStatus:
    if any(faults_of(state)):
        return "failed"
    urgent = any(error.error_level == "URGENT" for error in state.errors)
    return "degraded" if urgent else "ok"


def _post(state: RobotState, terrain: Terrain) -> str | None:
    """Return the frame where the robot is or to which it goes; None if the world lacks it."""
    name = state.node_states[-1].node_id if state.node_states else state.last_node_id
    return name if name in terrain.world.frames else None


def _task(state: RobotState, running: ActionState | None) -> Task:
    """Return the robot's task: the one that it reports, else the one that its state implies."""
    for info in state.information:
        task = TASKS.get(info.info_descriptor or "") if info.info_type == TASK else None
        if task is not None:
            return task
    doing = running.action_type if running is not None else None
    if state.driving:
        return "returning" if doing == "return_to_base" else "moving"
    if state.power_supply.charging:
        return "charging"
    return _DOING.get(doing or "", "holding" if state.paused else "idle")


def _route(state: RobotState) -> tuple[Point, ...]:
    """Return the remaining waypoints: the planned path without its first point, or the nodes."""
    path = state.planned_path.trajectory if state.planned_path is not None else None
    if path is not None and path.degree == 1:
        return tuple((point.x, point.y) for point in path.control_points[1:])
    places = (node.node_position for node in state.node_states)
    return tuple((place.x, place.y) for place in places if place is not None)
