"""Draws what a situation is made of: who came to a gate, and what has happened before a command."""

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeVar

from pa_console.schema.incident import (
    DegradeAsset,
    FailAsset,
    Incident,
    PlaceAsset,
    SensorFault,
    SetBattery,
    SetComms,
    SetWeather,
    SpawnTrack,
)
from pa_console.schema.plan import Action
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import AssetKind, World

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


PastIncident = Literal[
    "contact", "failed", "battery", "comms", "weather", "moved", "slow", "camera", "under_way"
]
"""What kinds of things can be the matter."""

Item = TypeVar("Item")
QUIET = 0.25
_NUMBERS = ((1, 55), (2, 30), (3, 15))
_WEIGHTS: dict[PastIncident, int] = {
    "contact": 42,
    "failed": 14,
    "battery": 14,
    "comms": 9,
    "weather": 4,
    "moved": 14,
    "slow": 4,
    "camera": 4,
    "under_way": 5,
}


@dataclass(frozen=True)
class OrderHistory:
    """What was ordered since the set-up: stages one after another, then some still under way."""

    orders: tuple[tuple[Action, ...], ...] = ()
    under_way: tuple[Action, ...] = ()
    wait_s: float = 0.0


NO_HISTORY = OrderHistory()


@dataclass(frozen=True)
class Drawn:
    """A set-up and a history that make the `troubles`."""

    incidents: tuple[Incident, ...]
    history: OrderHistory
    troubles: tuple[PastIncident, ...]


@dataclass
class _Draft:
    """A situation in the making; `busy` names assets and gates that something has happened to."""

    rng: random.Random
    world: World
    picture: Picture
    history: bool
    incidents: list[Incident] = field(default_factory=list[Incident])
    visits: list[Visit] = field(default_factory=list[Visit])
    under_way: list[Action] = field(default_factory=list[Action])
    busy: set[str] = field(default_factory=set[str])

    def assets(self, kind: AssetKind | None = None, *, spare: bool | None = None) -> list[str]:
        """Return the assets nothing has happened to; `spare`: whether no gate needs them."""
        sole = {cover.by[0] for cover in self.picture.gates.values() if len(cover.by) == 1}
        return [
            name
            for name, asset in self.picture.assets.items()
            if name not in self.busy
            and kind in (None, asset.kind)
            and spare in (None, name not in sole)
        ]

    def take(self, names: list[str]) -> str:
        """Return one of `names`, '' if there is none, and note that something happens to it."""
        if not names:
            return ""
        name = self.rng.choice(names)
        self.busy.add(name)
        return name


def draw_past_incidents(
    rng: random.Random, world: World, picture: Picture, *, history: bool = True
) -> Drawn:
    """Return what is the matter in `world`, whose `picture` shows it before anything happened."""
    draft = _Draft(rng, world, picture, history)
    number = 0 if rng.random() < QUIET else _weighted(rng, dict(_NUMBERS))
    troubles: list[PastIncident] = [trouble for _ in range(number) for trouble in _happen(draft)]
    return Drawn(
        tuple(_in_order(draft)),
        OrderHistory(
            tuple(stage for visit in draft.visits for stage in visit.orders),
            tuple(draft.under_way),
            max((visit.wait_s for visit in draft.visits), default=0.0)
            or (rng.uniform(1.5, 4.0) if draft.under_way else 0.0),
        ),
        tuple(troubles),
    )


def _happen(draft: _Draft) -> list[PastIncident]:
    """Let one thing happen, mostly one that is possible at once."""
    for _ in range(4):
        trouble = _weighted(draft.rng, _WEIGHTS)
        if _MAKERS[trouble](draft):
            return [trouble]
    return []


def _in_order(draft: _Draft) -> list[Incident]:
    """Return the incidents, those first that place assets: a contact keeps clear of them."""
    every = [*draft.incidents, *(each for visit in draft.visits for each in visit.incidents)]
    return sorted(every, key=lambda incident: incident.kind != "place")


def _contact(draft: _Draft) -> bool:
    """Somebody comes to a gate, or two of them to two gates; nobody has come to it before."""
    gates = [lane.gate for lane in draft.world.lanes.values() if lane.gate not in draft.busy]
    gate = draft.take(list(dict.fromkeys(gates)))
    if not gate:
        return False
    drones, robots = draft.assets("uav", spare=True), draft.assets("robot", spare=True)
    there = draft.picture.gates[gate].by
    visit = draw_visit(draft.rng, gate, drones, robots, there, history=draft.history)
    draft.busy.update(visit.helpers)
    draft.visits.append(visit)
    return True


def _failed(draft: _Draft) -> bool:
    """An asset breaks down: as often a gate's only guard as another one."""
    spare = draft.rng.random() < 0.5
    name = draft.take(draft.assets(spare=spare) or draft.assets())
    if name:
        draft.incidents.append(FailAsset(asset=name))
    return bool(name)


def _battery(draft: _Draft) -> bool:
    """A battery is low, more often a guard's."""
    name = draft.take(draft.assets(spare=draft.rng.random() < 0.4) or draft.assets())
    low = draft.world.low_battery_pct
    percent = float(round(draft.rng.uniform(min(8.0, low / 2), max(1.0, low - 1.0))))
    if name:
        draft.incidents.append(SetBattery(asset=name, percent=percent))
    return bool(name)


def _comms(draft: _Draft) -> bool:
    """A link is poor, or lost."""
    name = draft.take(draft.assets())
    if name:
        comms = "degraded" if draft.rng.random() < 0.65 else "lost"
        draft.incidents.append(SetComms(asset=name, comms=comms))
    return bool(name)


def _weather(draft: _Draft) -> bool:
    """It rains, or there is fog."""
    if any(incident.kind == "weather" for incident in draft.incidents):
        return False
    draft.incidents.append(SetWeather(weather=draft.rng.choice(("rain", "fog"))))
    return True


def _moved(draft: _Draft) -> bool:
    """One to three spare assets stand elsewhere: as reinforcement at gates, or anywhere."""
    frames = list(draft.world.frames)
    moved = False
    for _ in range(draft.rng.choices((1, 2, 3), (6, 3, 1))[0]):
        name = draft.take(draft.assets(spare=True))
        if name:
            gate = draft.rng.random() < 0.75
            frame = draft.rng.choice(draft.world.gates if gate else frames)
            moved = moved or frame != draft.world.assets[name].post
            draft.incidents.append(PlaceAsset(asset=name, frame=frame))
    return moved


def _slow(draft: _Draft) -> bool:
    """An asset goes on at a part of its speed."""
    name = draft.take(draft.assets())
    if name:
        factor = round(draft.rng.uniform(0.3, 0.7), 2)
        draft.incidents.append(DegradeAsset(asset=name, speed_factor=factor))
    return bool(name)


def _camera(draft: _Draft) -> bool:
    """A gate's camera is blind."""
    name = draft.take([name for name in draft.world.cameras if name not in draft.busy])
    if name:
        draft.incidents.append(SensorFault(sensor=name))
    return bool(name)


def _under_way(draft: _Draft) -> bool:
    """A spare asset is on its way somewhere by an earlier order."""
    name = draft.take(draft.assets(spare=True)) if draft.history else ""
    if name:
        elsewhere = [f for f in draft.world.frames if f != draft.world.assets[name].post]
        command = f"move_to {draft.rng.choice(elsewhere)}"
        draft.under_way.append(Action(agent=name, command=command))
    return bool(name)


_MAKERS: dict[PastIncident, Callable[[_Draft], bool]] = {
    "contact": _contact,
    "failed": _failed,
    "battery": _battery,
    "comms": _comms,
    "weather": _weather,
    "moved": _moved,
    "slow": _slow,
    "camera": _camera,
    "under_way": _under_way,
}


def _weighted(rng: random.Random, weights: dict[Item, int]) -> Item:
    return rng.choices(list(weights), list(weights.values()))[0]
