"""The states that lint searches: those of the rules' own examples, and drawn ones."""

import random
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from typing import NamedTuple

from pydantic import ValidationError

from pa_console.policy import example_state
from pa_console.policy.examples import (
    MISSION_TEXT,
    example_plan,
    example_rehearsal,
    example_sightings,
)
from pa_console.policy.lint_world import NOW_S, Situation, rehearsal_of
from pa_console.policy.sightings import Sighting, Sightings
from pa_console.schema.mission import Mission
from pa_console.schema.plan import COMMANDS, Action, Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.rule import Rule
from pa_console.schema.world import World

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


class State(NamedTuple):
    """A mission, a plan, and what it brings about."""

    plan: Plan
    rehearsal: Rehearsal
    mission: Mission
    world: World
    sightings: Sightings


def mission_of(text: str) -> Mission:
    """Return a mission of these words."""
    return Mission(id="lint", text=text, created=datetime(2000, 1, 1, tzinfo=UTC))


def example_states(rules: Iterable[Rule]) -> Iterator[State]:
    """Yield the state of every example with a plan that makes sense."""
    for rule in rules:
        for example in rule.examples:
            if example.moments:
                continue
            try:
                plan = example_plan(example)
                rehearsal = example_rehearsal(example, plan)
                seen = example_sightings(example, rehearsal.before.time_s)
            except (ValidationError, AttributeError, KeyError, TypeError, ValueError):
                continue  # `pa-console rules check` tells of it
            mission = mission_of(example.mission or MISSION_TEXT)
            yield State(plan, rehearsal, mission, example_state.WORLD, seen)


def drawn_states(world: World, texts: Sequence[str], count: int, seed: int) -> Iterator[State]:
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
        yield State(plan, rehearsal_of(world, situation, plan), mission, world, seen)


def draw_situation(world: World, dice: random.Random) -> Situation:
    """Draw what is out of the ordinary: some assets, and up to MOST_TRACKS tracks."""
    situation = Situation()
    for name in world.assets:
        if dice.random() < 0.25:
            facts = _some(_ASSET_FACTS, dice, 0.25)
            if dice.random() < 0.3:
                facts["at"] = dice.choice([None, *world.frames])
            if facts:
                situation.assets[name] = facts
    for number in range(dice.randint(0, MOST_TRACKS)):
        facts = _some(_TRACK_FACTS, dice, 0.4)
        situation.tracks[f"V{number + 1}"] = {"gate": dice.choice(world.gates), **facts}
    return situation


def draw_plan(world: World, situation: Situation, dice: random.Random) -> Plan:
    """Draw up to MOST_ORDERS orders, rather to where a track is; an asset may get two."""
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


def _seen(world: World, situation: Situation, dice: random.Random) -> Iterator[Sighting]:
    for name in (*situation.tracks, "V9"):
        if dice.random() < 0.3:
            place = dice.choice([*world.zones, *world.frames])
            gate = place if place in world.gates else dice.choice(world.gates)
            stamp_s = NOW_S - dice.choice((1.0, 30.0, 90.0))
            harmless = dice.random() < 0.5
            yield Sighting(name, place, gate, stamp_s, noncombatants=not harmless)
