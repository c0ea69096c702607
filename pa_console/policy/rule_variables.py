"""The variables of CEL checks, made from schema values.

An expression may use these variables:

plan      {reason, actions}.
actions   plan.actions, a list of {agent, command, verb, target, goes_to, kind, asset, outcome,
          tracks}. `target` is '' for a command without one; `goes_to` is the target, the base for
          return_to_base, and '' for hold and report; `kind` is '' and `asset` null for an unknown
          agent; `asset` is its entry in `assets`, `outcome` its entry in timeline.assets or null;
          `tracks` are those that the action meets: at its gate or, if it goes to a frame that is
          not a gate, inside the perimeter. (CEL copies the value before a dot, so `actions` is
          faster than `plan.actions`.)
before    the picture at the time of planning: {time_s, assets, tracks, gates}, each by name.
after     the picture at the end of the rehearsed plan, in the same form.
timeline  the events in between: {duration_s, gates, tracks, assets}, each by name.
tracks    list of before.tracks, each {id, kind, gate, position, speed_mps, distance_m, identity,
          intent, status, observed_by, observed, warned, defiant, noncombatants, seen_by,
          hostile_by, identity_claims, stamp_s, first_seen_s, age_s, stale, uncertainty_m, met,
          attended_by}. `age_s` is the time since its last detection; `intent` is hostile only if
          two sensors, `hostile_by`, have reported so; `identity_claims` maps sources to their
          claims about a disputed identity; `met` is true if an action meets it; `attended_by` are
          the available assets that already identify, warn or block at its gate, and stay.
assets    list of before.assets, each {id, kind, at, post, position, speed_mps, status, task,
          battery_pct, low_battery, comms, available, stale, integrity, stamp_s, goes_to}: `goes_to`
          is its post after the plan; `at`, `post` and `goes_to` are '' for no frame.
gates     list of {name, by, unsure, covered_before, covered_after, longest_gap_s}; `unsure` are
          assets that were last reported at the gate, but do not cover it by themselves.
sightings list of {track, place, gate, kind, identity, intent, noncombatants, stamp_s, age_s}: where
          each track was last detected within the past hour, including tracks that are no longer
          known. A `place` is a zone that contained the track, a frame within whose radius it was,
          or ''; a track has an entry for every place at which it has been. Facts found out later
          apply to earlier entries.
mission   {id, text, words, source}; `words` is the text in lower case, with plain quotes,
          compatibility forms resolved, no invisible characters and single spaces. An expression
          that reads the mission must hold for every way to read its words (`mission_words`).
world     {gates, frames, zones, assets, base, standoff_m, coverage_grace_s, low_battery_pct,
          commands}; frames, zones and assets map names to kinds, commands verbs to kinds.

Stale or suspect values count as unknown: an asset with such values is not available. Policies refer
to names, not to positions on the map, so routes and polygons are left out. At each hit, `filter`
and `map` copy their results so far, so use `exists` over `assets`.
"""

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import cached_property
from typing import Any, NamedTuple

from shapely import Point, Polygon

from pa_console.policy.expressions.expression import PLAN_VARIABLES
from pa_console.policy.expressions.fields import (
    Fields,
    Many,
    Record,
    Shape,
    Shapes,
    everything,
    flat,
    names_of,
    within,
)
from pa_console.policy.plain_text import foldings, plain_words
from pa_console.schema.base import StrictModel
from pa_console.schema.command import ATTENDING_TASKS, COMMANDS
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import AssetTimeline, GateTimeline, Rehearsal, TrackTimeline
from pa_console.schema.telemetry import AssetTelemetry, GateCover, Identity, Intent, Picture, Track
from pa_console.schema.world import World

Values = dict[str, Any]


KEPT_S = 3600.0
"""Simulated seconds for which a sighting is kept."""

_ASSET = flat(
    ("id", "kind", "at", "post", "position", "speed_mps", "status", "task", "battery_pct",
     "low_battery", "comms", "available", "stale", "integrity", "stamp_s", "goes_to")
)  # fmt: skip

_TRACK = flat((*(Track.model_fields.keys() - {"heading_deg"}), "age_s", "met", "attended_by"))

_OUTCOME = flat(AssetTimeline.model_fields)

_ACTION = Record(
    dict.fromkeys(("agent", "command", "verb", "target", "goes_to", "kind"))
    | {"asset": _ASSET, "outcome": _OUTCOME, "tracks": Many(_TRACK)}
)

_PICTURE = Record(
    {
        "time_s": None,
        "assets": Many(_ASSET, keyed=True),
        "tracks": Many(_TRACK, keyed=True),
        "gates": Many(flat(GateCover.model_fields), keyed=True),
    }
)

_TIMELINE = Record(
    {
        "duration_s": None,
        "gates": Many(flat(GateTimeline.model_fields), keyed=True),
        "tracks": Many(flat(TrackTimeline.model_fields), keyed=True),
        "assets": Many(_OUTCOME, keyed=True),
    }
)

_GATE = flat(("name", "by", "unsure", *GateTimeline.model_fields))

_MISSION = flat(("id", "text", "words", "source"))

_WORLD = flat(
    ("gates", "frames", "zones", "assets", "base", "standoff_m", "coverage_grace_s",
     "low_battery_pct", "commands")
)  # fmt: skip

PLAN_SHAPES: Shapes = {
    "plan": Record({"reason": None, "actions": Many(_ACTION)}),
    "actions": Many(_ACTION),
    "before": _PICTURE,
    "after": _PICTURE,
    "timeline": _TIMELINE,
    "tracks": Many(_TRACK),
    "assets": Many(_ASSET),
    "gates": Many(_GATE),
    "mission": _MISSION,
    "world": _WORLD,
    "sightings": None,
}
"""The structure of each variable."""

WORLD_SHAPE: Shape = _WORLD

EVERYTHING = everything(PLAN_VARIABLES)

_COMMANDS = {verb: sorted(spec.kinds) for verb, spec in COMMANDS.items()}

_UNCOVERED = GateCover(covered=False)

_COVER = ("by", "unsure")


class TrackSighting(NamedTuple):
    """The last detection of a track at a place, with its simulated time and the known facts."""

    track: str
    place: str
    gate: str
    stamp_s: float
    kind: str = "vehicle"
    identity: Identity = "unknown"
    intent: Intent = "unknown"
    noncombatants: bool = False


class Sightings:
    """The last detection of each track at each place, kept for KEPT_S seconds.

    Facts found out later also apply to earlier sightings: a vehicle that turns out to carry
    noncombatants carried them before, too.
    """

    def __init__(self, world: World, past: Iterable[TrackSighting] = ()) -> None:
        """Begin with the sightings in `past`, oldest first."""
        self._world = world
        self._posts = [name for name in world.frames if name not in world.gates]
        self._last = {(seen.track, seen.place): seen for seen in past}

    @cached_property
    def _zones(self) -> list[tuple[str, Polygon]]:
        return [(name, Polygon(zone.polygon)) for name, zone in self._world.zones.items()]

    def look(self, picture: Picture) -> None:
        """Update from `picture`: new detections, and new facts about tracks."""
        for track in picture.tracks.values():
            for place in self._places(track):
                key = (track.id, place)
                last = self._last.get(key)
                if last is None or last.stamp_s < track.stamp_s:
                    self._last.pop(key, None)  # the latest come last
                    self._last[key] = _sighting(track, place, track.stamp_s)
        for key, seen in self._last.items():
            if (track := picture.tracks.get(seen.track)) is not None:
                self._last[key] = _sighting(track, seen.place, seen.stamp_s)
        old = [key for key, seen in self._last.items() if picture.time_s - seen.stamp_s > KEPT_S]
        for key in old:
            del self._last[key]

    def at(self, picture: Picture) -> list[Values]:
        """Return the variable `sightings` for checks of `picture`, as plain values.

        Detections in `picture` are included, but they are not stored.
        """
        now = Sightings(self._world, self._last.values())
        now.look(picture)
        return [
            seen._asdict() | {"age_s": picture.time_s - seen.stamp_s} for seen in now._last.values()
        ]

    def copy(self) -> "Sightings":
        """Return an independent copy."""
        return Sightings(self._world, self._last.values())

    def _places(self, track: Track) -> Iterator[str]:
        """Yield the track's places: zones, its gate, and frames that are not gates."""
        names = [name for name, area in self._zones if area.covers(Point(track.position))]
        for name in (track.gate, *self._posts):
            frame = self._world.frames.get(name)
            if frame is not None and math.dist(frame.at, track.position) <= frame.radius_m:
                names.append(name)
        yield from names or [""]


def _sighting(track: Track, place: str, stamp_s: float) -> TrackSighting:
    return TrackSighting(
        track=track.id,
        place=place,
        gate=track.gate,
        stamp_s=stamp_s,
        kind=track.kind,
        identity=track.identity,
        intent=track.intent,
        noncombatants=track.noncombatants,
    )


class _RehearsedPlan:
    """A rehearsed plan, and the values of assets and tracks that follow from it."""

    def __init__(self, plan: Plan, rehearsal: Rehearsal, world: World) -> None:
        self._plan, self._rehearsal, self._world = plan, rehearsal, world
        self._before, self._timeline = rehearsal.before, rehearsal.timeline
        self._destinations = {action.agent: goes_to(action, world) for action in plan.actions}
        self._met = {action: self._meets(goes_to(action, world)) for action in plan.actions}
        self._met_ids = {name for names in self._met.values() for name in names}
        self._attended: dict[str, list[str]] = {}
        for gate, name in _attending(self._before, self._destinations):
            self._attended.setdefault(gate, []).append(name)

    def plan(self, fields: Fields | None) -> Values:
        made: dict[str, Callable[[], Any]] = {
            "reason": lambda: self._plan.reason,
            "actions": lambda: self.actions(within(fields, "actions")),
        }
        return {name: made[name]() for name in names_of(fields, made)}

    def actions(self, fields: Fields | None) -> list[Values]:
        return [self._action(action, fields) for action in self._plan.actions]

    def before(self, fields: Fields | None) -> Values:
        return _picture(self._before, fields, self._asset, self._track)

    def tracks(self, fields: Fields | None) -> list[Values]:
        return [self._track(*item, fields) for item in self._before.tracks.items()]

    def assets(self, fields: Fields | None) -> list[Values]:
        return [self._asset(*item, fields) for item in self._before.assets.items()]

    def gates(self, fields: Fields | None) -> list[Values]:
        """Return every gate of the timeline with its cover at the time of planning."""
        covers = self._before.gates
        return [
            {
                field: name
                if field == "name"
                else getattr(covers.get(name, _UNCOVERED) if field in _COVER else gap, field)
                for field in names_of(fields, _GATE.fields)
            }
            for name, gap in self._timeline.gates.items()
        ]

    def _action(self, action: Action, fields: Fields | None) -> Values:
        spec = self._world.assets.get(action.agent)
        asset = self._before.assets.get(action.agent)
        outcome = self._timeline.assets.get(action.agent)
        tracks = self._before.tracks
        made: dict[str, Callable[[], Any]] = {
            "agent": lambda: action.agent,
            "command": lambda: action.command,
            "verb": lambda: action.verb,
            "target": lambda: action.target or "",
            "goes_to": lambda: goes_to(action, self._world),
            "kind": lambda: spec.kind if spec is not None else "",
            "asset": lambda: (
                None if asset is None else self._asset(action.agent, asset, within(fields, "asset"))
            ),
            "outcome": lambda: (
                None if outcome is None else _flat(outcome, within(fields, "outcome"))
            ),
            "tracks": lambda: [
                self._track(name, tracks[name], within(fields, "tracks"))
                for name in self._met[action]
            ],
        }
        return {name: made[name]() for name in names_of(fields, made)}

    def _asset(self, name: str, asset: AssetTelemetry, fields: Fields | None) -> Values:
        return _asset(asset, self._destinations.get(name, ""), fields)

    def _track(self, name: str, track: Track, fields: Fields | None) -> Values:
        return _track(
            track,
            self._before.time_s,
            fields,
            met=name in self._met_ids,
            attended_by=self._attended.get(track.gate, []),
        )

    def _meets(self, frame: str) -> list[str]:
        """Return the tracks at the gate `frame`; for other frames, those inside the perimeter."""
        if not frame:
            return []
        tracks = self._before.tracks.items()
        if frame in self._world.gates:
            return [name for name, track in tracks if track.gate == frame]
        return [name for name, track in tracks if track.status == "inside"]


def plan_variables(  # noqa: PLR0917 - the sources of a check's variables
    plan: Plan,
    rehearsal: Rehearsal,
    mission: Mission,
    world: World,
    wanted: Fields = EVERYTHING,
    sightings: Sightings | None = None,
) -> Values:
    """Return the variables for checking a rehearsed plan, with only the `wanted` fields.

    Without `sightings`, there are no earlier detections. Fields that are not wanted are not
    converted: with many assets, the conversion takes most of the time.
    """
    rehearsed = _RehearsedPlan(plan, rehearsal, world)
    made: dict[str, Callable[[Fields | None], Any]] = {
        "plan": rehearsed.plan,
        "actions": rehearsed.actions,
        "before": rehearsed.before,
        "after": lambda fields: _whole(rehearsal.after, fields),
        "timeline": lambda fields: _timeline(rehearsal, fields),
        "tracks": rehearsed.tracks,
        "assets": rehearsed.assets,
        "gates": rehearsed.gates,
        "mission": lambda fields: _mission(mission, fields),
        "world": lambda fields: world_variables(world, fields),
        "sightings": lambda _: (sightings or Sightings(world)).at(rehearsal.before),
    }
    return {name: made[name](fields) for name, fields in wanted.items()}


def mission_variables(mission: Mission, world: World) -> Values:
    """Return the variables known at intake: the mission and the world."""
    return {"mission": _mission(mission, None), "world": world_variables(world)}


def world_variables(world: World, fields: Fields | None = None) -> Values:
    """Return the names and limits of the world, only the `fields` if they are given."""
    made: dict[str, Callable[[], Any]] = {
        "gates": lambda: list(world.gates),
        "frames": lambda: {name: frame.kind for name, frame in world.frames.items()},
        "zones": lambda: {name: zone.kind for name, zone in world.zones.items()},
        "assets": lambda: {name: asset.kind for name, asset in world.assets.items()},
        "base": lambda: world.base,
        "standoff_m": lambda: world.standoff_m,
        "coverage_grace_s": lambda: world.coverage_grace_s,
        "low_battery_pct": lambda: world.low_battery_pct,
        "commands": lambda: _COMMANDS,
    }
    return {name: made[name]() for name in names_of(fields, made)}


def goes_to(action: Action, world: World) -> str:
    """Return the frame where the agent is after the action; '' if the agent does not move."""
    if action.verb == "return_to_base":
        return world.base
    return action.target or ""


def mission_words(mission: Mission) -> tuple[str, ...]:
    """Return the ways to read a mission's words: as the console reads them, then as typed.

    Foldings of both follow, such as lookalike signs read as letters.
    """
    plain = dict.fromkeys(map(plain_words, (mission.text, mission.said)))
    return tuple(dict.fromkeys((*plain, *(other for words in plain for other in foldings(words)))))


def reworded(variables: Values, words: str) -> Values:
    """Return the `variables` of a mission with its `words` replaced."""
    return variables | {"mission": variables["mission"] | {"words": words}}


def _mission(mission: Mission, fields: Fields | None) -> Values:
    return {
        name: plain_words(mission.text) if name == "words" else getattr(mission, name)
        for name in names_of(fields, _MISSION.fields)
    }


def _flat(model: StrictModel, fields: Fields | None) -> Values:
    """Return the `fields` of a model without nested models."""
    return {name: getattr(model, name) for name in names_of(fields, type(model).model_fields)}


def _asset(asset: AssetTelemetry, destination: str, fields: Fields | None) -> Values:
    values: Values = {}
    for name in names_of(fields, _ASSET.fields):
        value = destination or asset.post if name == "goes_to" else getattr(asset, name)
        values[name] = "" if value is None else value
    return values


def _track(
    track: Track, now_s: float, fields: Fields | None, *, met: bool, attended_by: Collection[str]
) -> Values:
    values: Values = {}
    for name in names_of(fields, _TRACK.fields):
        match name:
            case "age_s":
                values[name] = now_s - track.stamp_s
            case "met":
                values[name] = met
            case "attended_by":
                values[name] = list(attended_by)
            case _:
                values[name] = getattr(track, name)
    return values


def _attending(picture: Picture, destinations: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Yield the place and the name of every asset that deals with tracks there and stays."""
    for name, asset in picture.assets.items():
        place = destinations.get(name) or asset.post
        if asset.task in ATTENDING_TASKS and asset.available and place:
            yield place, name


def _whole(picture: Picture, fields: Fields | None) -> Values:
    """Return a picture as the values of `after`, when no orders are left."""
    return _picture(
        picture,
        fields,
        lambda _, asset, inner: _asset(asset, "", inner),
        lambda _, track, inner: _track(track, picture.time_s, inner, met=False, attended_by=()),
    )


def _picture(
    picture: Picture,
    fields: Fields | None,
    asset: Callable[[str, AssetTelemetry, Fields | None], Values],
    track: Callable[[str, Track, Fields | None], Values],
) -> Values:
    values: Values = {}
    for name in names_of(fields, _PICTURE.fields):
        inner = within(fields, name)
        match name:
            case "assets":
                values[name] = {n: asset(n, state, inner) for n, state in picture.assets.items()}
            case "tracks":
                values[name] = {n: track(n, state, inner) for n, state in picture.tracks.items()}
            case "gates":
                values[name] = {n: _flat(state, inner) for n, state in picture.gates.items()}
            case _:
                values[name] = picture.time_s
    return values


def _timeline(rehearsal: Rehearsal, fields: Fields | None) -> Values:
    timeline, values = rehearsal.timeline, Values()
    for name in names_of(fields, _TIMELINE.fields):
        value, inner = getattr(timeline, name), within(fields, name)
        nested = name != "duration_s"
        values[name] = {n: _flat(entry, inner) for n, entry in value.items()} if nested else value
    return values
