"""The states that lint searches: situations in a reduced copy of a world.

Nothing is simulated: after the plan, every asset that can move is at its destination.
"""

import random
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import NamedTuple

from pydantic import ValidationError

from pa_console.policy.authoring.examples import (
    MISSION_TEXT,
    WORLD,
    example_plan,
    example_rehearsal,
    example_sightings,
    rehearsal_in,
)
from pa_console.policy.rule_variables import Sightings, TrackSighting
from pa_console.schema.command import COMMANDS
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.rule import Rule
from pa_console.schema.world import World

GATES = 4
POSTS = 1
EACH_KIND = 3
NOW_S = 100.0

MOST_ORDERS = 3

MOST_TRACKS = 2

_ASSET_FACTS: tuple[tuple[str, tuple[object, ...]], ...] = (
    ("status", ("failed", "degraded")),
    ("battery_pct", (0.0, 12.0)),
    ("comms", ("degraded", "lost")),
    ("stale", (True,)),
    ("integrity", ("suspect",)),
    ("task", ("identifying", "warning", "blocking", "charging", "moving")),
)

_TRACK_FACTS: tuple[tuple[str, tuple[object, ...]], ...] = (
    ("kind", ("person",)),
    ("identity", ("authorized", "unauthorized")),
    ("intent", ("benign", "hostile")),
    ("status", ("stopped", "leaving", "inside")),
    ("observed", (True,)),
    ("warned", (True,)),
    ("defiant", (True,)),
    ("noncombatants", (True,)),
    ("stale", (True,)),
)

_ASSET_COURSE: tuple[tuple[str, tuple[object, ...]], ...] = (
    ("finished", (False,)),
    ("left_perimeter", (True,)),
    ("least_battery_pct", (0.0, 8.0)),
)

_TRACK_COURSE: tuple[tuple[str, tuple[object, ...]], ...] = (
    ("observed_s", (5.0, 40.0)),
    ("identified_s", (20.0, 50.0)),
    ("least_distance_m", (1.0, 30.0)),
)


def small_world(world: World, named: Collection[str]) -> World:
    """Return `world` with few gates, posts and assets; the `named` ones are kept first.

    An asset whose post is removed gets the first gate that is kept as its post.
    """
    base = [world.base]
    posts = [name for name, frame in world.frames.items() if frame.kind == "post"]
    kept = [*base, *_first(world.gates, named, GATES), *_first(posts, named, POSTS)]
    frames = {name: frame for name, frame in world.frames.items() if name in kept}
    assets = {
        name: asset if asset.post in frames else asset.model_copy(update={"post": kept[1]})
        for kind in world.platforms
        for name in _first([n for n, a in world.assets.items() if a.kind == kind], named, EACH_KIND)
        for asset in (world.assets[name],)
    }
    lanes = {name: lane for name, lane in world.lanes.items() if lane.gate in frames}
    cameras = {name: camera for name, camera in world.cameras.items() if camera.gate in frames}
    update = {"frames": frames, "assets": assets, "lanes": lanes, "cameras": cameras}
    return world.model_copy(update=update)


def _first(names: Iterable[str], named: Collection[str], most: int) -> list[str]:
    ordered = sorted(names, key=lambda name: name not in named)
    mentioned = sum(name in named for name in ordered)
    return ordered[: max(most, mentioned)]


@dataclass
class LintSituation:
    """The unusual facts of one moment, and the events of its rehearsal.

    Values are model fields by name; fields that are not listed have their usual values.
    """

    assets: dict[str, dict[str, object]] = field(default_factory=dict[str, dict[str, object]])
    tracks: dict[str, dict[str, object]] = field(default_factory=dict[str, dict[str, object]])
    course: dict[str, dict[str, object]] = field(default_factory=dict[str, dict[str, object]])
    """The events during the rehearsal, by asset and track."""

    @property
    def words(self) -> str:
        """A description of the situation for a person."""
        parts = [
            f"{name} {' '.join(f'{key}={value}' for key, value in facts.items())}"
            for group in (self.assets, self.tracks)
            for name, facts in group.items()
        ]
        return "; ".join(parts) or "nothing out of the ordinary"


def rehearsal_of(world: World, situation: LintSituation, plan: Plan) -> Rehearsal:
    """Return the picture of `situation` and the consequences of `plan` in it."""
    course = {
        "assets": {name: situation.course.get(name, {}) for name in plan.agents},
        "tracks": {name: situation.course.get(name, {}) for name in situation.tracks},
    }
    given = {"assets": situation.assets, "tracks": situation.tracks, "timeline": course}
    return rehearsal_in(world, given, plan)


class SearchState(NamedTuple):
    """A mission, a plan, and the plan's consequences."""

    plan: Plan
    rehearsal: Rehearsal
    mission: Mission
    world: World
    sightings: Sightings


def mission_of(text: str) -> Mission:
    """Return a mission with this text."""
    return Mission(id="lint", text=text, created=datetime(2000, 1, 1, tzinfo=UTC))


def example_states(rules: Iterable[Rule]) -> Iterator[SearchState]:
    """Yield the state of every consistent example with a plan."""
    for rule in rules:
        for example in rule.examples:
            if example.moments:
                continue
            try:
                plan = example_plan(example)
                rehearsal = example_rehearsal(example, plan)
                seen = example_sightings(example, rehearsal.before.time_s)
            except (ValidationError, AttributeError, KeyError, TypeError, ValueError):
                continue  # `pa-console rules check` reports it
            mission = mission_of(example.mission or MISSION_TEXT)
            yield SearchState(plan, rehearsal, mission, WORLD, seen)


def drawn_states(
    world: World, texts: Sequence[str], count: int, seed: int
) -> Iterator[SearchState]:
    """Yield `count` states of the small `world`; equal seeds give equal states."""
    dice = random.Random(seed)
    for _ in range(count):
        situation = draw_situation(world, dice)
        plan = draw_plan(world, situation, dice)
        for name in plan.agents:
            situation.course[name] = _some(_ASSET_COURSE, dice, 0.15)
            if world.zones and dice.random() < 0.2:
                situation.course[name]["entered_zones"] = (dice.choice(sorted(world.zones)),)
        for name in situation.tracks:
            situation.course[name] = _some(_TRACK_COURSE, dice, 0.4)
        seen = Sightings(world, _seen(world, situation, dice))
        mission = mission_of(dice.choice(texts))
        yield SearchState(plan, rehearsal_of(world, situation, plan), mission, world, seen)


def draw_situation(world: World, dice: random.Random) -> LintSituation:
    """Draw a situation: unusual facts of some assets, and up to MOST_TRACKS tracks."""
    situation = LintSituation()
    for name in world.assets:
        if dice.random() < 0.25:
            facts = _some(_ASSET_FACTS, dice, 0.25)
            if dice.random() < 0.3:
                facts["at"] = dice.choice([None, *world.frames])
            if "stale" in facts or "integrity" in facts:
                facts["available"] = False
            if facts:
                situation.assets[name] = facts
    for number in range(dice.randint(0, MOST_TRACKS)):
        facts = _some(_TRACK_FACTS, dice, 0.4)
        situation.tracks[f"V{number + 1}"] = {"gate": dice.choice(world.gates), **facts}
    return situation


def draw_plan(world: World, situation: LintSituation, dice: random.Random) -> Plan:
    """Draw up to MOST_ORDERS orders, preferably to places with tracks; an asset may get two."""
    places = [str(facts["gate"]) for facts in situation.tracks.values()]
    orders: list[Action] = []
    for _ in range(dice.randint(0, MOST_ORDERS)):
        agent, verb = dice.choice(sorted(world.assets)), dice.choice(sorted(COMMANDS))
        frame = dice.choice(places if places and dice.random() < 0.6 else sorted(world.frames))
        command = f"{verb} {frame}" if COMMANDS[verb].takes_frame else verb
        orders.append(Action(agent=agent, command=command))
    reason = dice.choice(["the track is there; the gate has no cover", ""])
    return Plan(reason=reason, actions=tuple(orders))


def _some(
    facts: Sequence[tuple[str, tuple[object, ...]]], dice: random.Random, likely: float
) -> dict[str, object]:
    return {name: dice.choice(values) for name, values in facts if dice.random() < likely}


def _seen(world: World, situation: LintSituation, dice: random.Random) -> Iterator[TrackSighting]:
    for name in (*situation.tracks, "V9"):
        if dice.random() < 0.3:
            place = dice.choice([*world.zones, *world.frames])
            gate = place if place in world.gates else dice.choice(world.gates)
            stamp_s = NOW_S - dice.choice((1.0, 30.0, 90.0))
            harmless = dice.random() < 0.5
            yield TrackSighting(name, place, gate, stamp_s, noncombatants=not harmless)
