"""Names for generated worlds: gates, posts, zones and teams as people would call them."""

import random

from pa_console.schema.world import AssetKind

_GATE_WORDS = """
Abbey Airfield Anchor Ash Barn Bay Beacon Bell Birch Bridge Brook Canal Castle Cedar Chapel Cliff
Coal Copper Creek Dock Dune Eagle Elm Falcon Farm Ferry Field Ford Forest Forge Foundry Fox
Garden Garrison Glen Granite Grove Harbor Harvest Hawthorn Heath Heron Highland Hill Iron Island
Kiln Lagoon Lake Larch Lighthouse Lime Lock Maple Market Marsh Meadow Mill Moor Oak Ocean Orchard
Pasture Pier Pine Pond Poplar Port Prairie Quarry Rail Ridge River Sand Shore Silver Slate
Spring Station Stone Summit Sunset Thistle Timber Tower Tunnel Valley Viaduct Village Vineyard
Walnut Warehouse Water Wharf Willow Wind Wolf
"""
_POSTS = (
    "Checkpoint", "Plaza", "Crossroads", "ControlPoint", "Yard", "Courtyard", "Hub", "Rotunda",
    "InspectionArea", "Square", "Terrace", "Junction",
)  # fmt: skip
_BASES = ("Base", "Depot", "Hangar", "Garage", "MotorPool", "Barracks")
_ZONES = ("Magazine", "FuelStore", "Substation", "Laboratory", "Vault", "Archive")
_TEAMS: tuple[dict[AssetKind, str], ...] = (
    {"uav": "Drone", "ugv": "Ugv", "robot": "Robot"},
    {"uav": "Uav", "ugv": "Rover", "robot": "Walker"},
    {"uav": "Kestrel", "ugv": "Mule", "robot": "Sentry"},
    {"uav": "Quad", "ugv": "Truck", "robot": "Guard"},
    {"uav": "Skyeye", "ugv": "Bulwark", "robot": "Warden"},
)

MOST_GATES = len(_GATE_WORDS.split())
MOST_POSTS = len(_POSTS)


def gates(rng: random.Random, count: int) -> list[str]:
    """Return `count` names of gates, all different."""
    return [f"{word}Gate" for word in rng.sample(_GATE_WORDS.split(), count)]


def posts(rng: random.Random, count: int) -> list[str]:
    """Return `count` names of posts, all different."""
    return rng.sample(_POSTS, count)


def base(rng: random.Random) -> str:
    """Return the name of a base."""
    return rng.choice(_BASES)


def zones(rng: random.Random, count: int) -> list[str]:
    """Return `count` names of restricted zones, all different."""
    return rng.sample(_ZONES, count)


def team(rng: random.Random) -> dict[AssetKind, str]:
    """Return how a team calls its assets of each kind, before `_Tnn`."""
    return rng.choice(_TEAMS)
