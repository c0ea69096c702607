"""The factsheet of a simulated asset, from its platform."""

from typing import Any

from pa_console.fleets.vda5050.factsheet import (
    REPLACES,
    Factsheet,
    OfferedAction,
    OptionalParameter,
    ParameterSpecification,
    PhysicalParameters,
    ProtocolFeatures,
    ProtocolLimits,
    Scope,
    Timing,
    TypeSpecification,
)
from pa_console.fleets.vda5050.vehicle import AUTHORIZATION, CANCEL, PAUSE, RESUME, TARGET
from pa_console.schema.command import COMMANDS, Verb
from pa_console.schema.world import AssetKind, Platform, World

AT_ONCE: tuple[str, ...] = (PAUSE, RESUME, CANCEL, "report")
ACCELERATION_MPS2 = 1.0
HEIGHT_M = 1.0


def offers(kind: AssetKind) -> frozenset[Verb]:
    """Return the verbs that an asset of `kind` can carry out."""
    return frozenset(verb for verb, spec in COMMANDS.items() if kind in spec.kinds)


def factsheet_of(kind: AssetKind, world: World, header: dict[str, Any]) -> Factsheet:
    """Return the factsheet of an asset of `kind` in `world`."""
    platform = world.platforms[kind]
    moves = tuple(_offered(verb, "NODE") for verb in COMMANDS if _goes(verb, kind))
    at_once = tuple(_offered(action, "INSTANT") for action in AT_ONCE)
    return Factsheet(
        **header,
        type_specification=TypeSpecification(
            series_name=f"{world.name} {kind}",
            mobile_robot_kinematics="OMNIDIRECTIONAL" if kind == "uav" else "DIFFERENTIAL",
            mobile_robot_class=kind,
            maximum_load_mass=0.0,
            localization_types=("GNSS",),
            navigation_types=("AUTONOMOUS",),
            supported_zones=("BLOCKED",),
        ),
        physical_parameters=_physical(platform),
        protocol_limits=ProtocolLimits(
            timing=Timing(
                minimum_order_interval=0.0,
                minimum_state_interval=world.dt_s,
                default_state_interval=world.telemetry_period_s,
            )
        ),
        protocol_features=ProtocolFeatures(
            optional_parameters=(OptionalParameter(parameter=REPLACES, support="SUPPORTED"),),
            mobile_robot_actions=(*moves, *at_once),
        ),
    )


def _goes(verb: Verb, kind: AssetKind) -> bool:
    return verb not in ("hold", "report") and kind in COMMANDS[verb].kinds


def _offered(action: str, scope: Scope) -> OfferedAction:
    keys = (TARGET, AUTHORIZATION) if scope == "NODE" else ()
    return OfferedAction(
        action_type=action,
        action_scopes=(scope,),
        action_parameters=tuple(
            ParameterSpecification(key=key, value_data_type="STRING", is_optional=True)
            for key in keys
        ),
        pause_allowed=True,
        cancel_allowed=True,
    )


def _physical(platform: Platform) -> PhysicalParameters:
    return PhysicalParameters(
        minimum_speed=0.0,
        maximum_speed=platform.speed_mps,
        maximum_acceleration=ACCELERATION_MPS2,
        maximum_deceleration=ACCELERATION_MPS2,
        minimum_height=HEIGHT_M,
        maximum_height=HEIGHT_M,
        width=2 * platform.radius_m,
        length=2 * platform.radius_m,
    )
