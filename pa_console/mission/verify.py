"""Step 7: does telemetry show that the plan happened? Unknown is never taken for done.

A pass rests on reports that are fresh, sound and sent at or after the end of the command; what a
device says of itself proves nothing.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from pa_console.mission.dispatch import TIMED_OUT
from pa_console.schema.command import ADDRESSING, CommandReply
from pa_console.schema.mission import ActionOutcome, Outcome, Verification
from pa_console.schema.plan import Action, Plan
from pa_console.schema.telemetry import AssetTelemetry, GateCover, Picture, Track
from pa_console.schema.world import World

STILL_MPS = 0.5
_EPSILON_S = 1e-6


class _Seen(NamedTuple):
    """A conclusion from telemetry, its reason, and when its oldest report was sent."""

    outcome: Outcome
    reason: str
    stamp_s: float | None = None


@dataclass(frozen=True)
class _Evidence:
    """The pictures before and after the plan, and the end of one command in simulated seconds."""

    world: World
    before: Picture
    after: Picture
    end_s: float


def verify_plan(
    plan: Plan,
    world: World,
    before: Picture,
    after: Picture,
    final: Mapping[str, CommandReply],
) -> Verification:
    """Compare `after` with what every action should have brought about.

    `final` maps agents to the last reply to their command; its tick is when the command ended. A
    gate that was covered before and is known not to be now makes the outcome a failure whatever
    the actions did (WF-03); one whose cover is not known now makes it unknown.
    """
    ends = {agent: reply.tick * world.dt_s for agent, reply in final.items()}
    seen = [
        _action(
            action,
            _Evidence(world, before, after, ends.get(action.agent, 0.0)),
            final.get(action.agent),
        )
        for action in plan.actions
    ]
    gates = dict(_gates(before, after, max(ends.values(), default=0.0)))
    actions = tuple(
        ActionOutcome(agent=a.agent, command=a.command, outcome=s.outcome, reason=s.reason)
        for a, s in zip(plan.actions, seen, strict=True)
    )
    outcome, reason = _overall(actions, gates)
    stamps = [s.stamp_s for s in (*seen, *gates.values()) if s.stamp_s is not None]
    return Verification(
        outcome=outcome,
        actions=actions,
        gates_lost=tuple(gate for gate, s in gates.items() if s.outcome == "fail"),
        gates_unknown=tuple(gate for gate, s in gates.items() if s.outcome == "unknown"),
        reason=reason,
        as_of_s=min(stamps, default=after.time_s),
    )


def needs_more_evidence(plan: Plan, picture: Picture, since_s: float) -> bool:
    """Return whether reports sent at or after `since_s` are still to come.

    None are expected from an asset that is known to have failed.
    """
    agents = {action.agent for action in plan.actions}
    for cover in picture.gates.values():
        if cover.unknown or (cover.covered and _cover_stamp(cover, picture) < since_s - _EPSILON_S):
            return True
    for agent in agents:
        asset = picture.assets.get(agent)
        if asset is not None and asset.status != "failed" and _doubt(asset, picture, since_s):
            return True
    return any(
        track.stale or track.stamp_s < since_s - _EPSILON_S
        for action in plan.actions
        if action.verb in ADDRESSING
        for track in picture.tracks.values()
        if track.gate == action.target
    )


def _overall(actions: tuple[ActionOutcome, ...], gates: Mapping[str, _Seen]) -> tuple[Outcome, str]:
    """Return the worst outcome of all and the reasons for it."""
    reasons: dict[Outcome, list[str]] = {"fail": [], "unknown": [], "pass": []}
    for gate, seen in gates.items():
        reasons[seen.outcome].append(f"{gate} {seen.reason}")
    for action in actions:
        name = f"{action.agent} {action.command}" if action.outcome == "fail" else action.agent
        reasons[action.outcome].append(f"{name}: {action.reason}")
    if reasons["fail"]:
        return "fail", "; ".join(reasons["fail"])
    if reasons["unknown"]:
        return "unknown", "; ".join(reasons["unknown"])
    return "pass", "telemetry shows every action and every gate's cover"


def _gates(before: Picture, after: Picture, end_s: float) -> Iterator[tuple[str, _Seen]]:
    """Yield for every gate that was covered before the plan whether it is after its end."""
    for gate, was in before.gates.items():
        if not was.covered:
            continue
        now = after.gates.get(gate)
        if now is None or now.unknown:
            unsure = f", {', '.join(now.unsure)} cannot be relied on" if now is not None else ""
            yield gate, _Seen("unknown", f"cover is unknown{unsure}")
        elif not now.covered:
            yield gate, _Seen("fail", "is no longer covered")
        else:
            stamp_s = _cover_stamp(now, after)
            if stamp_s < end_s - _EPSILON_S:
                yield gate, _Seen("unknown", "has not been reported covered since the plan ended")
            else:
                yield gate, _Seen("pass", "is covered", stamp_s)


def _cover_stamp(cover: GateCover, picture: Picture) -> float:
    """Return when the latest report that puts an asset at the gate was sent; 0 without any."""
    stamps = (picture.assets[name].stamp_s for name in cover.by if name in picture.assets)
    return max(stamps, default=0.0)


def _doubt(asset: AssetTelemetry, picture: Picture, end_s: float) -> str:
    """Return why the asset's latest report proves nothing, empty when it does."""
    age = picture.time_s - asset.stamp_s
    if asset.integrity == "suspect":
        return "its telemetry is suspect"
    if asset.comms == "lost":
        return f"it has been silent for {age:.0f} s"
    if asset.stale:
        return f"the last telemetry is {age:.0f} s old"
    if asset.stamp_s < end_s - _EPSILON_S:
        return f"no telemetry since its command ended, {picture.time_s - end_s:.0f} s ago"
    return ""


def _action(action: Action, evidence: _Evidence, reply: CommandReply | None) -> _Seen:
    """Judge one action; what telemetry contradicts has failed even when nobody answered."""
    after = evidence.after
    asset = after.assets.get(action.agent)
    if asset is None:
        return _Seen("unknown", "no telemetry of this asset")
    silent = reply is None or reply.detail.startswith(TIMED_OUT)
    if reply is not None and reply.status != "done" and not silent:
        return _Seen("fail", reply.detail or reply.status, asset.stamp_s)
    doubt = _doubt(asset, after, evidence.end_s)
    if after.time_s - asset.stamp_s > evidence.world.stale_s and not doubt:
        doubt = f"the last telemetry is {after.time_s - asset.stamp_s:.0f} s old"
    if doubt:
        return _Seen("unknown", doubt)
    seen = _seen(action, evidence, asset)
    if silent and seen.outcome == "pass":
        detail = reply.detail if reply is not None else "the device never answered"
        return _Seen("unknown", f"{detail}; telemetry: {seen.reason}", seen.stamp_s)
    return seen


def _seen(action: Action, evidence: _Evidence, asset: AssetTelemetry) -> _Seen:
    """Judge one action by telemetry alone; the asset's report is fresh and sound."""
    where = asset.at or "between frames"
    stamp_s = asset.stamp_s
    if asset.status == "failed":
        return _Seen("fail", f"it has failed, {where}", stamp_s)
    match action.verb:
        case "hold":
            still = asset.speed_mps < STILL_MPS
            outcome, reason = ("pass", f"still at {where}") if still else ("fail", "still moving")
            return _Seen(outcome, reason, stamp_s)
        case "report":
            return _Seen("pass", f"report received, at {where}", stamp_s)
        case "identify" | "warn":
            seen = _tracks(action, evidence)
            stamps = [s for s in (seen.stamp_s, stamp_s) if s is not None]
            return _Seen(seen.outcome, seen.reason, min(stamps))
        case "move_to" | "observe" | "block" | "return_to_base":
            target = action.target or evidence.world.base
    if asset.at != target:
        return _Seen("fail", f"it is at {where}", stamp_s)
    if asset.post != target:
        heading = asset.post or "elsewhere"
        return _Seen("fail", f"it is at {where} on its way to {heading}", stamp_s)
    return _Seen("pass", f"at {target}", stamp_s)


def _tracks(action: Action, evidence: _Evidence) -> _Seen:
    """Judge `identify` or `warn` by the tracks at its frame that sensors see now."""
    here = [track for track in evidence.after.tracks.values() if track.gate == action.target]
    if not here:
        return _Seen("unknown", "the track is gone")
    fresh = [t for t in here if not t.stale and t.stamp_s >= evidence.end_s - _EPSILON_S]
    if not fresh:
        latest = max(here, key=lambda track: (track.stamp_s, track.id))
        age = evidence.after.time_s - latest.stamp_s
        return _Seen("unknown", f"{latest.id} has not been seen for {age:.0f} s")
    due = [track for track in fresh if _dealt_with(action, track)]
    left = [track for track in fresh if not _dealt_with(action, track)]
    earlier = evidence.before.tracks
    new = [t for t in due if t.id not in earlier or not _dealt_with(action, earlier[t.id])]
    stamp_s = min(track.stamp_s for track in fresh)
    done, undone = (
        ("identified", "still unidentified")
        if action.verb == "identify"
        else ("warned", "not warned")
    )
    if new or (due and not left):
        return _Seen("pass", f"{done} {', '.join(t.id for t in new or due)}", stamp_s)
    return _Seen("fail", f"{', '.join(track.id for track in left)} {undone}", stamp_s)


def _dealt_with(action: Action, track: Track) -> bool:
    return track.identity != "unknown" if action.verb == "identify" else track.warned
