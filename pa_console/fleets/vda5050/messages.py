"""The messages of VDA 5050 3.0.0 that a station and its robots exchange.

Other fields of the standard (loads, trajectories to follow, requests for zones and edges) are
neither sent nor read.
"""

import math
from typing import Annotated, ClassVar, Literal

from pydantic import Field, JsonValue

from pa_console.fleets.vda5050.wire import MOST_ITEMS, Count, Finite, Header, Id, Items, Text, Wire

Angle = Annotated[float, Field(ge=-3.1415926536, le=3.1415926536)]
"""An angle in radians: 0 is east, a quarter turn is north."""
Charge = Annotated[float, Field(ge=0.0, le=100.0)]
STANDS_MPS = 0.05
"""The speed up to which a robot counts as stopped, because measured speeds are never quite zero."""

MAP = "site"
"""The only map; all positions are on it."""

MANUAL = frozenset(("MANUAL", "INTERVENED", "TEACH_IN"))
"""The operating modes in which a person drives the robot and it accepts no orders."""

ConnectionState = Literal["ONLINE", "OFFLINE", "HIBERNATING", "CONNECTION_BROKEN"]


class RobotConnection(Header):
    """The state of a robot's connection to the bus, retained and also sent as its last will."""

    TOPIC: ClassVar[str] = "connection"
    connection_state: ConnectionState


class ActionParameter(Wire):
    """One named value of an action."""

    key: Id
    value: JsonValue


class RobotAction(Wire):
    """One action of a robot, identified by `action_id`."""

    action_id: Id
    action_type: Id
    blocking_type: Literal["NONE", "SOFT", "SINGLE", "HARD"]
    action_parameters: Items[ActionParameter] = Field(default=(), max_length=32)

    def parameter(self, key: str) -> JsonValue:
        """Return the value of a parameter; None if the action does not have it."""
        return next((item.value for item in self.action_parameters if item.key == key), None)


class InstantActions(Header):
    """Actions that a robot carries out as soon as they arrive."""

    TOPIC: ClassVar[str] = "instantActions"
    actions: Items[RobotAction] = Field(max_length=MOST_ITEMS)


class ControlPoint(Wire):
    """A point of a trajectory or a corner of a zone, in metres."""

    x: Finite
    y: Finite


class Position(ControlPoint):
    """A place on the map, in metres."""

    map_id: Id = MAP


class NodeState(Wire):
    """A node that a robot has not reached yet."""

    node_id: Id
    sequence_id: Count
    released: bool
    node_position: Position | None = None


class Node(NodeState):
    """A place on a robot's route, and the actions to carry out there."""

    actions: Items[RobotAction] = Field(default=(), max_length=MOST_ITEMS)


class EdgeState(Wire):
    """An edge that a robot has not traversed yet."""

    edge_id: Id
    sequence_id: Count
    released: bool


class Edge(EdgeState):
    """The connection from one node to the next."""

    actions: Items[RobotAction] = Field(default=(), max_length=MOST_ITEMS)


class Order(Header):
    """A route for a robot; a repeated order has the same `order_id`."""

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
    """A path; with degree 1, it is straight from each point to the next."""

    degree: Annotated[int, Field(ge=1, le=100)] = 1
    control_points: Items[ControlPoint] = Field(max_length=MOST_ITEMS)


class PlannedPath(Wire):
    """The path that a robot plans to take from its position."""

    trajectory: Trajectory


class RobotPosition(ControlPoint):
    """A robot's estimate of its position, which is reliable only if `localized`."""

    theta: Angle
    map_id: Id = MAP
    localized: bool


class Velocity(Wire):
    """The velocity of a robot, forward and to its left, in metres per second."""

    vx: Finite | None = None
    vy: Finite | None = None


class PowerSupply(Wire):
    """The state of a robot's battery, with its charge in percent."""

    state_of_charge: Charge
    charging: bool


class InfoReference(Wire):
    """The subject of an error, such as the id of an order."""

    reference_key: Id
    reference_value: Text


ErrorLevel = Literal["WARNING", "URGENT", "CRITICAL", "FATAL"]


class Error(Wire):
    """A fault of a robot, or the reason for a refusal (a WARNING with the id of the action)."""

    error_type: Id
    error_level: ErrorLevel
    error_references: Items[InfoReference] = Field(default=(), max_length=MOST_ITEMS)
    error_description: Text | None = None

    def refers_to(self, value: str) -> bool:
        """Return whether the error is about the order or action with this id."""
        return any(reference.reference_value == value for reference in self.error_references)


class Info(Wire):
    """Further information from a robot, on which no behaviour may depend."""

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
    """The complete state of a robot, reported at each change and periodically."""

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
    def manual(self) -> bool:
        """True while a person drives the robot."""
        return self.operating_mode in MANUAL

    @property
    def moves(self) -> bool:
        """True if the robot reports that it drives or that it has a speed."""
        velocity = self.velocity or Velocity()
        speed_mps = math.hypot(velocity.vx or 0.0, velocity.vy or 0.0)
        return self.driving or speed_mps > STANDS_MPS


class VdaZone(Wire):
    """An area that robots may not enter."""

    zone_id: Id
    zone_type: Literal["BLOCKED"]
    vertices: Items[ControlPoint] = Field(min_length=3, max_length=MOST_ITEMS)


class Zones(Wire):
    """The zones of one map."""

    map_id: Id = MAP
    zone_set_id: Id
    zones: Items[VdaZone] = Field(max_length=MOST_ITEMS)


class ZoneSet(Header):
    """The message with the zones for a robot."""

    TOPIC: ClassVar[str] = "zoneSet"
    zone_set: Zones


Scope = Literal["INSTANT", "NODE", "EDGE", "ZONE"]
Metres = Annotated[float, Field(ge=-1e4, le=1e4)]
NonNegative = Annotated[float, Field(ge=0.0, le=1e7)]
REPLACES = "order.replacement"
"""The optional parameter of robots that replace their current order with a new one themselves."""


class TypeSpecification(Wire):
    """The type of a robot; `mobile_robot_class` is uav, ugv or robot if the kind is known."""

    series_name: Text
    series_description: Text | None = None
    mobile_robot_kinematics: Id
    mobile_robot_class: Id
    maximum_load_mass: NonNegative
    localization_types: Items[Id] = Field(max_length=MOST_ITEMS)
    navigation_types: Items[Id] = Field(max_length=MOST_ITEMS)
    supported_zones: tuple[Id, ...] | None = Field(default=None, max_length=MOST_ITEMS)


class PhysicalParameters(Wire):
    """The speed, acceleration and size of a robot, in metres and seconds."""

    minimum_speed: NonNegative
    maximum_speed: NonNegative
    maximum_acceleration: NonNegative
    maximum_deceleration: Metres
    minimum_height: Metres
    maximum_height: Metres
    width: Metres
    length: Metres


class Timing(Wire):
    """The shortest intervals between orders and between states, in seconds."""

    minimum_order_interval: NonNegative
    minimum_state_interval: NonNegative
    default_state_interval: NonNegative | None = None


class ProtocolLimits(Wire):
    """The limits of a robot, which are not read because the console's messages are short."""

    maximum_string_lengths: dict[Id, int | bool] = {}
    maximum_array_lengths: dict[Id, int] = {}
    timing: Timing


class OptionalParameter(Wire):
    """An optional part of the protocol that a robot supports or requires."""

    parameter: Id
    support: Literal["SUPPORTED", "REQUIRED"]
    description: Text | None = None


class ParameterSpecification(Wire):
    """A parameter of an offered action."""

    key: Id
    value_data_type: Literal["BOOL", "NUMBER", "INTEGER", "STRING", "OBJECT", "ARRAY"]
    is_optional: bool | None = None


class OfferedAction(Wire):
    """An action that a robot can carry out."""

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
    """A part that is sent empty and not read."""


class Factsheet(Header):
    """The type and the capabilities of a robot."""

    TOPIC: ClassVar[str] = "factsheet"
    type_specification: TypeSpecification
    physical_parameters: PhysicalParameters
    protocol_limits: ProtocolLimits
    protocol_features: ProtocolFeatures
    mobile_robot_geometry: Unread = Unread()
    load_specification: Unread = Unread()

    def offers(self, action_type: str) -> bool:
        """Return whether the robot offers actions of that type."""
        offered = self.protocol_features.mobile_robot_actions
        return any(action.action_type == action_type for action in offered)

    @property
    def replaces_orders(self) -> bool:
        """True if a new order replaces the current one without a cancellation."""
        optional = self.protocol_features.optional_parameters
        return any(parameter.parameter == REPLACES for parameter in optional)
