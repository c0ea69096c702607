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
tracks    list of before.tracks, each with `age_s`: the age of the last report of it.
assets    list of before.assets, each with `goes_to`: its post once the plan has run. `at`, `post`
          and `goes_to` are '' for no frame.
gates     list of {name, by, covered_before, covered_after, longest_gap_s}.
mission   {id, text, words, source}; `words` is the text in lower case, with plain quotes,
          compatibility forms resolved and single spaces.
world     {gates, frames, zones, assets, base, standoff_m, coverage_grace_s, low_battery_pct,
          commands}; frames, zones and assets map names to kinds, commands verbs to kinds.

Names, not positions on the map, are what policies speak of: routes and polygons are left out.
"""

import unicodedata
from collections.abc import Iterable
from typing import Any

from pa_console.schema.mission import Mission
from pa_console.schema.plan import COMMANDS, Action, Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World

Values = dict[str, Any]

_ASSET_FIELDS_LEFT_OUT = {"assets": {"__all__": {"route", "heading_deg", "command_id"}}}
_QUOTES = str.maketrans({"’": "'", "‘": "'", "“": '"', "”": '"', "–": "-", "—": "-"})


def plan_variables(
    plan: Plan, rehearsal: Rehearsal, mission: Mission, world: World
) -> dict[str, Any]:
    """Return every variable for judging a rehearsed plan; unknown agents and frames are fine."""
    before, after = _picture(rehearsal.before), _picture(rehearsal.after)
    timeline = rehearsal.timeline.model_dump()
    destinations = {action.agent: goes_to(action, world) for action in plan.actions}
    for name, asset in before["assets"].items():
        asset["goes_to"] = destinations.get(name) or asset["post"]
    for track in before["tracks"].values():
        track["age_s"] = before["time_s"] - track["stamp_s"]
    actions = [_action(action, before, timeline, world) for action in plan.actions]
    return {
        "plan": {"reason": plan.reason, "actions": actions},
        "actions": actions,
        "before": before,
        "after": after,
        "timeline": timeline,
        "tracks": list(before["tracks"].values()),
        "assets": list(before["assets"].values()),
        "gates": [
            {"name": name, "by": before["gates"].get(name, {}).get("by", ()), **cover}
            for name, cover in timeline["gates"].items()
        ],
        **mission_variables(mission, world),
    }


def mission_variables(mission: Mission, world: World) -> dict[str, Any]:
    """Return what is known at intake: the mission and the world."""
    return {
        "mission": {
            "id": mission.id,
            "text": mission.text,
            "words": plain_words(mission.text),
            "source": mission.source,
        },
        "world": {
            "gates": list(world.gates),
            "frames": {name: frame.kind for name, frame in world.frames.items()},
            "zones": {name: zone.kind for name, zone in world.zones.items()},
            "assets": {name: asset.kind for name, asset in world.assets.items()},
            "base": world.base,
            "standoff_m": world.standoff_m,
            "coverage_grace_s": world.coverage_grace_s,
            "low_battery_pct": world.low_battery_pct,
            "commands": {verb: sorted(spec.kinds) for verb, spec in COMMANDS.items()},
        },
    }


def goes_to(action: Action, world: World) -> str:
    """Return the frame at which the action leaves its agent, '' when it stays where it is."""
    if action.verb == "return_to_base":
        return world.base
    return action.target or ""


def plain_words(text: str) -> str:
    """Return `text` as patterns expect it: lower case, plain quotes, single spaces."""
    visible = "".join(
        sign for sign in unicodedata.normalize("NFKC", text) if unicodedata.category(sign) != "Cf"
    )
    return " ".join(visible.translate(_QUOTES).lower().split())


def _picture(picture: Picture) -> Values:
    values = picture.model_dump(exclude=_ASSET_FIELDS_LEFT_OUT)
    for asset in values["assets"].values():
        asset["at"], asset["post"] = asset["at"] or "", asset["post"] or ""
    return values


def _action(action: Action, before: Values, timeline: Values, world: World) -> Values:
    spec = world.assets.get(action.agent)
    destination = goes_to(action, world)
    return {
        "agent": action.agent,
        "command": action.command,
        "verb": action.verb,
        "target": action.target or "",
        "goes_to": destination,
        "kind": spec.kind if spec is not None else "",
        "asset": before["assets"].get(action.agent),
        "outcome": timeline["assets"].get(action.agent),
        "tracks": _met(destination, before["tracks"].values(), world),
    }


def _met(frame: str, tracks: Iterable[Values], world: World) -> list[Values]:
    """Return the tracks at the gate `frame`; elsewhere, those that are inside the perimeter."""
    if not frame:
        return []
    if frame in world.gates:
        return [track for track in tracks if track["gate"] == frame]
    return [track for track in tracks if track["status"] == "inside"]
