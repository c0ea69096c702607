"""Where assets drove or flew by order: the standoff, the perimeter, restricted zones."""

import math
from collections.abc import Iterator
from functools import cache

from shapely import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry

from pa_console.evaluation.record import Breach
from pa_console.evaluation.scoring.film import AssetTruth, Film, Sample
from pa_console.evaluation.scoring.oracle_escalation import name_of
from pa_console.schema.world import World
from pa_console.sim.true_contacts import TrueContact

STANDOFF_TOLERANCE_M = 0.5
PERIMETER_TOLERANCE_M = 2.0
ZONE_TOLERANCE_M = 0.5
_CHORD_M = 1.0
"""So far a straight line between two samples may be from the way that was flown."""


def conduct(film: Film) -> Iterator[Breach]:
    """Yield what assets under way by an order did where they must not be."""
    moving = {o.command_id for o in film.orders if film.goal(o)}
    inside = Polygon(film.world.perimeter)
    for was, now in film.steps():
        threat = any(contact.intent == "hostile" for contact in now.contacts.values())
        for name, asset in now.assets.items():
            before = was.assets[name]
            if not {asset.command_id, before.command_id} & moving:
                continue
            if before.position == asset.position:
                continue
            outside_m = inside.distance(Point(asset.position))
            if outside_m > max(PERIMETER_TOLERANCE_M, inside.distance(Point(before.position))):
                what = f"{name} left the perimeter"
                yield Breach(rule_id="ROE-06", what=what, at_s=now.time_s)
            if not threat:
                for zone in _entered(film.world, before, asset):
                    what = f"{name} entered {zone} without a verified threat"
                    yield Breach(rule_id="ROE-07", what=what, at_s=now.time_s)
            if asset.kind != "uav":
                yield from _standoff(film.world, (was, now), before, asset)


def _standoff(
    world: World, step: tuple[Sample, Sample], before: AssetTruth, asset: AssetTruth
) -> Iterator[Breach]:
    """ROE-04: its own movement brought a ground asset too near somebody not verified."""
    least = world.standoff_m - STANDOFF_TOLERANCE_M
    was, now = step
    for name, contact in now.contacts.items():
        known = was.contacts.get(name)
        if known is None or (contact.identified and contact.confirmed != "unknown"):
            continue
        if all(_closes_in(before, asset, there, least) for there in (known, contact)):
            what = f"{asset.id} drove nearer than {world.standoff_m:g} m to {name_of(contact)}"
            yield Breach(rule_id="ROE-04", what=what, at_s=now.time_s)


def _closes_in(before: AssetTruth, asset: AssetTruth, contact: TrueContact, least: float) -> bool:
    gap_m = math.dist(asset.position, contact.position)
    return gap_m < least and gap_m < math.dist(before.position, contact.position) - 0.05


def _entered(world: World, before: AssetTruth, asset: AssetTruth) -> Iterator[str]:
    """Yield the restricted zones that a step led into, or right through."""
    for name, zone in world.zones.items():
        area, core = _zone(zone.polygon)
        if area.contains(Point(before.position)):
            continue
        line = LineString((before.position, asset.position))
        if area.contains(Point(asset.position)) or core.intersects(line):
            yield name


@cache
def _zone(polygon: tuple[tuple[float, float], ...]) -> tuple[BaseGeometry, BaseGeometry]:
    """Return a zone without its rim, and the part that no detour around a corner cuts."""
    area = Polygon(polygon)
    return area.buffer(-ZONE_TOLERANCE_M), area.buffer(-_CHORD_M)
