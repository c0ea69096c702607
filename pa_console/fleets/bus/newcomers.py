"""Robots that are on a bus and not in the world: they join it, if their factsheet fits in."""

from collections.abc import Mapping

from pydantic import TypeAdapter, ValidationError

from pa_console.fleets.bus.joining import Joined
from pa_console.fleets.vda5050.factsheet import Factsheet
from pa_console.schema.base import Name
from pa_console.schema.command import COMMANDS
from pa_console.schema.world import AssetKind, AssetSpec, World

_NAME: TypeAdapter[str] = TypeAdapter(Name)


def with_newcomers(world: World, joined: Joined) -> tuple[World, tuple[str, ...]]:
    """Return `world` with the robots that are on the bus and not in it, and a line about each.

    Each becomes an asset of the kind that its factsheet shows, with that kind's platform.
    """
    added: dict[str, AssetSpec] = {}
    told: list[str] = []
    for identity, sheet in sorted(joined.factsheets.items()):
        name = identity.serial_number
        if identity not in joined.online:
            continue
        if name in world.assets or name in world.cameras or name in added:
            continue
        kind = kind_of(sheet)
        try:
            _NAME.validate_python(name)
        except ValidationError:
            told.append(f"{name} cannot join: its serial number is no name, such as Robot_T03")
            continue
        if kind not in world.platforms:
            told.append(f"{name} cannot join: this world has no platform for a {kind}")
            continue
        added[name] = AssetSpec(kind=kind, post=world.base)
        told.append(f"{name} of {identity.manufacturer} joins as a {kind}")
    if not added:
        return world, tuple(told)
    return world.model_copy(update={"assets": {**world.assets, **added}}), tuple(told)


def kind_of(sheet: Factsheet) -> AssetKind:
    """Return which kind of asset a robot is: as its class says, else by what it can do."""
    said = sheet.type_specification.mobile_robot_class.lower()
    named: Mapping[str, AssetKind] = {"uav": "uav", "ugv": "ugv", "robot": "robot"}
    if said in named:
        return named[said]
    special: tuple[AssetKind, ...] = ("uav", "ugv")
    for kind in special:
        alone = frozenset((kind,))
        if any(sheet.offers(verb) for verb, spec in COMMANDS.items() if spec.kinds == alone):
            return kind
    return "robot"
