"""Turns schema values into the plain values that CEL checks see.

An expression may use these variables:

plan      {reason, actions}.
actions   plan.actions, a list of {agent, command, verb, target, goes_to, kind, asset, outcome,
          tracks}. `target` is '' for a command without one; `goes_to` is the target, the base for
          return_to_base, and '' for hold and report; `kind` is '' and `asset` null for an unknown
          agent; `asset` is its entry in `assets`, `outcome` its entry in timeline.assets or null;
          `tracks` are those the action meets: at its gate, or inside the perimeter when it goes to
          a frame that is no gate. (CEL copies what a dot follows: `actions` is the quick way.)
before    the picture when the plan was made: {time_s, assets, tracks, gates}, each by name.
after     the picture when the rehearsed plan had ended, likewise.
timeline  what happened in between: {duration_s, gates, tracks, assets}, each by name.
tracks    list of before.tracks, each {id, kind, gate, position, speed_mps, distance_m, identity,
          intent, status, observed_by, observed, warned, defiant, noncombatants, seen_by,
          hostile_by, stamp_s, first_seen_s, age_s, stale, uncertainty_m, met, attended_by}. `age_s`
          is the time since its last detection; `intent` is hostile only when two sensors,
          `hostile_by`, have said so; `met` tells whether an action meets it; `attended_by` are the
          available assets that identify, warn or block at its gate already, and stay.
assets    list of before.assets, each {id, kind, at, post, position, speed_mps, status, task,
          battery_pct, low_battery, comms, available, stale, integrity, stamp_s, goes_to}: `goes_to`
          is its post once the plan has run; `at`, `post` and `goes_to` are '' for no frame.
gates     list of {name, by, unsure, covered_before, covered_after, longest_gap_s}; `unsure` are
          assets that were last reported there, by which alone no gate is covered.
sightings list of {track, place, gate, kind, identity, intent, noncombatants, stamp_s, age_s}: where
          each track was last detected within the past hour, also one that is no longer known. A
          `place` is a zone in which it was, or a frame within whose radius, else ''; a track has an
          entry for every place at which it has been. What was found out later counts.
mission   {id, text, words, source}; `words` is the text in lower case, with plain quotes,
          compatibility forms resolved, nothing hidden and single spaces. An expression that reads
          the mission must hold for every way to read its words (`mission_words`).
world     {gates, frames, zones, assets, base, standoff_m, coverage_grace_s, low_battery_pct,
          commands}; frames, zones and assets map names to kinds, commands verbs to kinds.

Stale or suspect values are values of which nothing is known: an asset with them is not available.
Names, not positions on the map, are what policies speak of: routes and polygons are left out.
`filter` and `map` copy what they have found so far at each hit: over `assets` use `exists`.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from typing import Any

from pa_console.policy.checks.plain_text import foldings, plain_words
from pa_console.policy.checks.sightings import Sightings
from pa_console.policy.expressions.expression import PLAN_VARIABLES
from pa_console.schema.command import COMMANDS
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.telemetry import AssetTelemetry, Picture, Task, Track
from pa_console.schema.world import World

Values = dict[str, Any]

_ASSET_FIELDS = (
    "id", "kind", "at", "post", "position", "speed_mps", "status", "task", "battery_pct",
    "low_battery", "comms", "available", "stale", "integrity", "stamp_s",
)  # fmt: skip
_ATTENDING: frozenset[Task] = frozenset(("identifying", "warning", "blocking"))


def plan_variables(  # noqa: PLR0917 - what a check may speak of, and of which of it
    plan: Plan,
    rehearsal: Rehearsal,
    mission: Mission,
    world: World,
    wanted: Collection[str] = PLAN_VARIABLES,
    sightings: Sightings | None = None,
) -> Values:
    """Return the `wanted` variables for judging a rehearsed plan.

    Without `sightings` nothing is known from before the plan.

    What nobody asks for is not converted: with many assets that takes most of the time.
    """
    before, timeline = rehearsal.before, rehearsal.timeline.model_dump()
    tracks = {name: _track(track, before.time_s) for name, track in before.tracks.items()}
    destinations = {action.agent: goes_to(action, world) for action in plan.actions}
    asked = before.assets if {"assets", "before"} & set(wanted) else destinations
    assets = {
        name: _asset(before.assets[name], destinations.get(name, ""))
        for name in asked
        if name in before.assets
    }
    actions = [_action(action, assets, tracks, timeline, world) for action in plan.actions]
    for met in (track for action in actions for track in action["tracks"]):
        met["met"] = True
    for gate, name in _attending(before, destinations):
        for track in tracks.values():
            if track["gate"] == gate:
                track["attended_by"].append(name)
    made: dict[str, Callable[[], Any]] = {
        "plan": lambda: {"reason": plan.reason, "actions": actions},
        "actions": lambda: actions,
        "before": lambda: _picture(before, assets, tracks),
        "after": lambda: _whole(rehearsal.after),
        "timeline": lambda: timeline,
        "tracks": lambda: list(tracks.values()),
        "assets": lambda: list(assets.values()),
        "gates": lambda: _gates(before, timeline),
        "mission": lambda: _mission(mission),
        "world": lambda: world_variables(world),
        "sightings": lambda: (sightings or Sightings(world)).at(before),
    }
    return {name: made[name]() for name in wanted}


def mission_variables(mission: Mission, world: World) -> Values:
    """Return what is known at intake: the mission and the world."""
    return {"mission": _mission(mission), "world": world_variables(world)}


def world_variables(world: World) -> Values:
    """Return the world by names and limits."""
    return {
        "gates": list(world.gates),
        "frames": {name: frame.kind for name, frame in world.frames.items()},
        "zones": {name: zone.kind for name, zone in world.zones.items()},
        "assets": {name: asset.kind for name, asset in world.assets.items()},
        "base": world.base,
        "standoff_m": world.standoff_m,
        "coverage_grace_s": world.coverage_grace_s,
        "low_battery_pct": world.low_battery_pct,
        "commands": {verb: sorted(spec.kinds) for verb, spec in COMMANDS.items()},
    }


def goes_to(action: Action, world: World) -> str:
    """Return the frame at which the action leaves its agent, '' when it stays where it is."""
    if action.verb == "return_to_base":
        return world.base
    return action.target or ""


def mission_words(mission: Mission) -> tuple[str, ...]:
    """Return the ways to read a mission's words: as they are read first, then as they were typed.

    Each may be read besides with what looks like a letter as that letter, and so on.
    """
    plain = dict.fromkeys(map(plain_words, (mission.text, mission.said)))
    return tuple(dict.fromkeys((*plain, *(other for words in plain for other in foldings(words)))))


def reworded(variables: Values, words: str) -> Values:
    """Return the `variables` of a mission with other `words` for it."""
    return variables | {"mission": variables["mission"] | {"words": words}}


def _mission(mission: Mission) -> Values:
    return {
        "id": mission.id,
        "text": mission.text,
        "words": plain_words(mission.text),
        "source": mission.source,
    }


def _asset(asset: AssetTelemetry, destination: str) -> Values:
    values: Values = {name: getattr(asset, name) for name in _ASSET_FIELDS}
    values["at"], values["post"] = asset.at or "", asset.post or ""
    values["goes_to"] = destination or asset.post or ""
    return values


def _track(track: Track, now_s: float) -> Values:
    known = track.model_dump(exclude={"heading_deg"})
    return known | {"age_s": now_s - track.stamp_s, "met": False, "attended_by": []}


def _attending(picture: Picture, destinations: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Yield the place and name of every asset that deals with tracks there, and stays."""
    for name, asset in picture.assets.items():
        place = destinations.get(name) or asset.post
        if asset.task in _ATTENDING and asset.available and place:
            yield place, name


def _whole(picture: Picture) -> Values:
    """Return a picture after which nothing is ordered any more."""
    tracks = {name: _track(track, picture.time_s) for name, track in picture.tracks.items()}
    return _picture(picture, {n: _asset(asset, "") for n, asset in picture.assets.items()}, tracks)


def _picture(picture: Picture, assets: Values, tracks: Values) -> Values:
    gates = {name: cover.model_dump() for name, cover in picture.gates.items()}
    return {"time_s": picture.time_s, "assets": assets, "tracks": tracks, "gates": gates}


def _gates(before: Picture, timeline: Values) -> list[Values]:
    """Return every gate of the timeline with who covered it when the plan was made."""
    nobody: Values = {"by": (), "unsure": ()}
    by = {name: {"by": cover.by, "unsure": cover.unsure} for name, cover in before.gates.items()}
    return [
        {"name": name, **by.get(name, nobody), **cover} for name, cover in timeline["gates"].items()
    ]


def _action(
    action: Action, assets: Values, tracks: Values, timeline: Values, world: World
) -> Values:
    spec = world.assets.get(action.agent)
    destination = goes_to(action, world)
    return {
        "agent": action.agent,
        "command": action.command,
        "verb": action.verb,
        "target": action.target or "",
        "goes_to": destination,
        "kind": spec.kind if spec is not None else "",
        "asset": assets.get(action.agent),
        "outcome": timeline["assets"].get(action.agent),
        "tracks": _met(destination, tracks.values(), world),
    }


def _met(frame: str, tracks: Iterable[Values], world: World) -> list[Values]:
    """Return the tracks at the gate `frame`; elsewhere, those that are inside the perimeter."""
    if not frame:
        return []
    if frame in world.gates:
        return [track for track in tracks if track["gate"] == frame]
    return [track for track in tracks if track["status"] == "inside"]
