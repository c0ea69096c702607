"""Draws who comes to a gate, how near, and how far the station has got with them already."""

import random
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from pa_console.schema.incident import Incident, PlaceAsset, SpawnTrack
from pa_console.schema.plan import Action

Known = Literal["arrived", "observed", "identified", "warned", "watched"]
"""How much is known: nothing yet; seen by a drone; and identified; and warned; watched long."""

WATCHED_S = (11.0, 14.0)
"""Watched so long at close range, sensors have an opinion of the intent (ROE-10)."""


@dataclass(frozen=True)
class Visit:
    """A contact with its set-up, the `orders` since, and the assets that these need."""

    incidents: tuple[Incident, ...]
    orders: tuple[tuple[Action, ...], ...] = ()
    wait_s: float = 0.0
    helpers: frozenset[str] = frozenset()


def draw_visit(
    rng: random.Random,
    gate: str,
    drones: Sequence[str],
    robots: Sequence[str],
    there: Sequence[str],
    *,
    history: bool,
) -> Visit:
    """Return who comes to `gate`; `drones` and `robots` are spare, `there` who guards it.

    Without `history` nobody is identified or warned yet: that takes orders.
    """
    known = _known(rng, history=history)
    incidents: list[Incident] = [_arrival(rng, gate, near=known != "arrived")]
    if rng.random() < 0.12:
        incidents.append(_arrival(rng, gate, near=known != "arrived"))
    helpers: list[str] = []
    if known != "arrived" and drones:
        helpers.append(rng.choice(drones))
    if known in ("identified", "warned", "watched") and robots:
        helpers.append(rng.choice(robots))
    robot = next((name for name in helpers if name in robots), "")
    orders: list[tuple[Action, ...]] = []
    if robot and (helpers[0] not in robots or any(name in drones for name in there)):
        orders.append((Action(agent=robot, command=f"identify {gate}"),))
        if known == "warned" or (known == "watched" and rng.random() < 0.4):
            orders.append((Action(agent=robot, command=f"warn {gate}"),))
    places = (PlaceAsset(asset=name, frame=gate) for name in helpers)
    wait_s = rng.uniform(*WATCHED_S) if known == "watched" else 0.0
    return Visit((*places, *incidents), tuple(orders), wait_s, frozenset(helpers))


def _known(rng: random.Random, *, history: bool) -> Known:
    every: tuple[Known, ...] = ("arrived", "observed", "identified", "warned", "watched")
    weights = (44, 18, 12, 8, 18) if history else (65, 35, 0, 0, 0)
    return rng.choices(every, weights)[0]


def _arrival(rng: random.Random, gate: str, *, near: bool) -> SpawnTrack:
    """Return a vehicle or person, peaceful or not, far, near or waiting at the gate already."""
    person = rng.random() < 0.25
    speed = rng.uniform(1.0, 1.8) if person else rng.uniform(2.5, 7.0)
    far = rng.choices((None, rng.uniform(45.0, 80.0), rng.uniform(15.0, 40.0), 1.0), (2, 3, 4, 4))
    distance = rng.choice((1.0, 1.0, rng.uniform(12.0, 30.0))) if near else far[0]
    noncombatants = rng.random() < 0.12
    hostile = not noncombatants and rng.random() < 0.35
    authorized = not hostile and rng.random() < 0.45
    reactions = (20, 15, 65) if hostile else (70, 22, 8)
    return SpawnTrack(
        gate=gate,
        track="person" if person else "vehicle",
        identity="authorized" if authorized else "unauthorized",
        intent="hostile" if hostile else "benign",
        speed_mps=round(speed, 1),
        distance_m=round(distance, 1) if distance is not None else None,
        when_warned=rng.choices(("leave", "stop", "go_on"), reactions)[0],
        noncombatants=noncombatants,
    )
