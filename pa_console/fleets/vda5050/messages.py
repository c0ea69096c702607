"""The messages of VDA 5050 3.0.0 that a station and its robots exchange.

What the standard has beyond these fields (loads, trajectories to follow, requests for zones and
edges) is neither sent nor read.
"""

import math
from typing import Annotated, ClassVar, Literal

from pydantic import Field, JsonValue

from pa_console.fleets.vda5050.wire import MOST_ITEMS, Count, Finite, Header, Id, Items, Text, Wire

Angle = Annotated[float, Field(ge=-3.1415926536, le=3.1415926536)]
"""Radians; 0 east, a quarter turn north."""
Charge = Annotated[float, Field(ge=0.0, le=100.0)]
STANDS_MPS = 0.05
"""A robot that reports no more than this stands: measured speeds are never quite zero."""

MAP = "site"
"""The one map that every position is on."""

ConnectionState = Literal["ONLINE", "OFFLINE", "HIBERNATING", "CONNECTION_BROKEN"]


class RobotConnection(Header):
    """The connection of a robot to the bus; retained, and left as its last will."""

    TOPIC: ClassVar[str] = "connection"
    connection_state: ConnectionState


class ActionParameter(Wire):
    """One named value of an action."""

    key: Id
    value: JsonValue


class RobotAction(Wire):
    """One action of a robot, with its `action_type` and its `action_id`."""

    action_id: Id
    action_type: Id
    blocking_type: Literal["NONE", "SOFT", "SINGLE", "HARD"]
    action_parameters: Items[ActionParameter] = Field(default=(), max_length=32)

    def parameter(self, key: str) -> JsonValue:
        """Return a parameter's value, None when the action has none of that name."""
        return next((item.value for item in self.action_parameters if item.key == key), None)


class InstantActions(Header):
    """Actions that a robot is to carry out as soon as they arrive."""

    TOPIC: ClassVar[str] = "instantActions"
    actions: Items[RobotAction] = Field(max_length=MOST_ITEMS)


class ControlPoint(Wire):
    """A point of a trajectory, or a corner of a zone, metres."""

    x: Finite
    y: Finite


class Position(ControlPoint):
    """A place on the map, metres."""

    map_id: Id = MAP


class NodeState(Wire):
    """A node that a robot has still to pass."""

    node_id: Id
    sequence_id: Count
    released: bool
    node_position: Position | None = None


class Node(NodeState):
    """A place on a robot's way, and the actions to carry out there."""

    actions: Items[RobotAction] = Field(default=(), max_length=MOST_ITEMS)


class EdgeState(Wire):
    """A way that a robot has still to go."""

    edge_id: Id
    sequence_id: Count
    released: bool


class Edge(EdgeState):
    """The way from one node to the next."""

    actions: Items[RobotAction] = Field(default=(), max_length=MOST_ITEMS)


class Order(Header):
    """The way that a robot is to go; `order_id` makes it the same order when it comes again."""

    TOPIC: ClassVar[str] = "order"
    order_id: Id
    order_update_id: Count
    nodes: Items[Node] = Field(max_length=MOST_ITEMS)
    edges: Items[Edge] = Field(max_length=MOST_ITEMS)


ActionStatus = Literal[
    "WAITING", "INITIALIZING", "RUNNING", "PAUSED", "RETRIABLE", "FINISHED", "FAILED"
]


class ActionState(Wire):
    """The progress of one action."""

    action_id: Id
    action_type: Id | None = None
    action_status: ActionStatus
    action_result: Text | None = None


class Trajectory(Wire):
    """A way: of degree 1, straight from one point to the next."""

    degree: Annotated[int, Field(ge=1, le=100)] = 1
    control_points: Items[ControlPoint] = Field(max_length=MOST_ITEMS)


class PlannedPath(Wire):
    """The way that a robot means to go, from where it is."""

    trajectory: Trajectory


class RobotPosition(ControlPoint):
    """A robot's estimate of its place; reliable only if `localized`."""

    theta: Angle
    map_id: Id = MAP
    localized: bool


class Velocity(Wire):
    """The velocity of a robot, metres a second, forward and to its left."""

    vx: Finite | None = None
    vy: Finite | None = None


class PowerSupply(Wire):
    """A robot's battery, percent."""

    state_of_charge: Charge
    charging: bool


class InfoReference(Wire):
    """The subject of an error or of an information."""

    reference_key: Id
    reference_value: Text


ErrorLevel = Literal["WARNING", "URGENT", "CRITICAL", "FATAL"]


class Error(Wire):
    """A fault of a robot, or the reason of a refusal (then a WARNING, with the id)."""

    error_type: Id
    error_level: ErrorLevel
    error_references: Items[InfoReference] = Field(default=(), max_length=MOST_ITEMS)
    error_description: Text | None = None

    def refers_to(self, value: str) -> bool:
        """Return whether the error is about the order or action of this id."""
        return any(reference.reference_value == value for reference in self.error_references)


class Info(Wire):
    """Further information of a robot; nothing may depend on it."""

    info_type: Id
    info_level: Literal["INFO", "DEBUG"] = "INFO"
    info_descriptor: Text | None = None


class SafetyState(Wire):
    """The state of a robot's own safety devices."""

    active_emergency_stop: Literal["MANUAL", "REMOTE", "NONE"] = "NONE"
    field_violation: bool = False


class KnownZoneSet(Wire):
    """A set of zones that a robot has."""

    zone_set_id: Id
    map_id: Id
    zone_set_status: Literal["ENABLED", "DISABLED"]


class RobotState(Header):
    """The whole state of a robot, reported when something changes and periodically."""

    TOPIC: ClassVar[str] = "state"
    order_id: Id
    order_update_id: Count
    last_node_id: Id
    last_node_sequence_id: Count
    node_states: Items[NodeState] = Field(max_length=MOST_ITEMS)
    edge_states: Items[EdgeState] = Field(max_length=MOST_ITEMS)
    driving: bool
    action_states: Items[ActionState] = Field(max_length=MOST_ITEMS)
    instant_action_states: Items[ActionState] = Field(max_length=MOST_ITEMS)
    power_supply: PowerSupply
    operating_mode: Literal[
        "STARTUP", "AUTOMATIC", "SEMIAUTOMATIC", "INTERVENED", "MANUAL", "SERVICE", "TEACH_IN"
    ]
    errors: Items[Error] = Field(max_length=MOST_ITEMS)
    safety_state: SafetyState
    paused: bool = False
    planned_path: PlannedPath | None = None
    mobile_robot_position: RobotPosition | None = None
    velocity: Velocity | None = None
    zone_sets: tuple[KnownZoneSet, ...] | None = Field(default=None, max_length=MOST_ITEMS)
    information: Items[Info] = Field(default=(), max_length=MOST_ITEMS)

    @property
    def moves(self) -> bool:
        """True if the robot drives, or has a speed, by its own report."""
        velocity = self.velocity or Velocity()
        speed_mps = math.hypot(velocity.vx or 0.0, velocity.vy or 0.0)
        return self.driving or speed_mps > STANDS_MPS


class VdaZone(Wire):
    """An area with a meaning; BLOCKED: not to be entered."""

    zone_id: Id
    zone_type: Literal["BLOCKED"]
    vertices: Items[ControlPoint] = Field(min_length=3, max_length=MOST_ITEMS)


class Zones(Wire):
    """The zones of one map."""

    map_id: Id = MAP
    zone_set_id: Id
    zones: Items[VdaZone] = Field(max_length=MOST_ITEMS)


class ZoneSet(Header):
    """The zones that a robot is to know."""

    TOPIC: ClassVar[str] = "zoneSet"
    zone_set: Zones


Scope = Literal["INSTANT", "NODE", "EDGE", "ZONE"]
Metres = Annotated[float, Field(ge=-1e4, le=1e4)]
NonNegative = Annotated[float, Field(ge=0.0, le=1e7)]
REPLACES = "order.replacement"
"""The optional parameter of a robot that drops its running order for a new one by itself."""


class TypeSpecification(Wire):
    """The kind of a robot; `mobile_robot_class` is uav, ugv or robot where we know it."""

    series_name: Text
    series_description: Text | None = None
    mobile_robot_kinematics: Id
    mobile_robot_class: Id
    maximum_load_mass: NonNegative
    localization_types: Items[Id] = Field(max_length=MOST_ITEMS)
    navigation_types: Items[Id] = Field(max_length=MOST_ITEMS)
    supported_zones: tuple[Id, ...] | None = Field(default=None, max_length=MOST_ITEMS)


class PhysicalParameters(Wire):
    """The speed and size of a robot: metres, metres a second, and a second squared."""

    minimum_speed: NonNegative
    maximum_speed: NonNegative
    maximum_acceleration: NonNegative
    maximum_deceleration: Metres
    minimum_height: Metres
    maximum_height: Metres
    width: Metres
    length: Metres


class Timing(Wire):
    """The shortest intervals between orders and between states, seconds."""

    minimum_order_interval: NonNegative
    minimum_state_interval: NonNegative
    default_state_interval: NonNegative | None = None


class ProtocolLimits(Wire):
    """The limits of a robot; our messages are few and short, so the limits are not read."""

    maximum_string_lengths: dict[Id, int | bool] = {}
    maximum_array_lengths: dict[Id, int] = {}
    timing: Timing


class OptionalParameter(Wire):
    """An optional part of the protocol that it supports or needs."""

    parameter: Id
    support: Literal["SUPPORTED", "REQUIRED"]
    description: Text | None = None


class ParameterSpecification(Wire):
    """A parameter of an action that it offers."""

    key: Id
    value_data_type: Literal["BOOL", "NUMBER", "INTEGER", "STRING", "OBJECT", "ARRAY"]
    is_optional: bool | None = None


class OfferedAction(Wire):
    """An action that it can carry out."""

    action_type: Id
    action_scopes: Items[Scope] = Field(max_length=8)
    action_parameters: Items[ParameterSpecification] = Field(default=(), max_length=32)
    pause_allowed: bool
    cancel_allowed: bool


class ProtocolFeatures(Wire):
    """The parts of the protocol that a robot offers."""

    optional_parameters: Items[OptionalParameter] = Field(max_length=MOST_ITEMS)
    mobile_robot_actions: Items[OfferedAction] = Field(max_length=MOST_ITEMS)


class Unread(Wire):
    """A part that we send empty and do not read."""


class Factsheet(Header):
    """The kind and the abilities of a robot."""

    TOPIC: ClassVar[str] = "factsheet"
    type_specification: TypeSpecification
    physical_parameters: PhysicalParameters
    protocol_limits: ProtocolLimits
    protocol_features: ProtocolFeatures
    mobile_robot_geometry: Unread = Unread()
    load_specification: Unread = Unread()

    def offers(self, action_type: str) -> bool:
        """Return whether the robot offers such an action."""
        offered = self.protocol_features.mobile_robot_actions
        return any(action.action_type == action_type for action in offered)

    @property
    def replaces_orders(self) -> bool:
        """True if a new order replaces the running one without a cancellation."""
        optional = self.protocol_features.optional_parameters
        return any(parameter.parameter == REPLACES for parameter in optional)
