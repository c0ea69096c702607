"""The factsheet: what a robot is and which actions it offers, retained on the bus."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from pa_console.fleets.vda5050.wire import MOST_ITEMS, Header, Id, Items, Text, Wire

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
