"""Some checks of the shipped rules, written out a second time in plain Python.

They are what an engineer without a rule language would have written: straight over the pictures
and the timeline. The benchmark measures them against CEL; they enforce nothing.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from pa_console.policy.context import goes_to
from pa_console.schema.mission import Mission
from pa_console.schema.plan import COMMANDS, Action, Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.telemetry import Track
from pa_console.schema.world import World


@dataclass(frozen=True)
class Case:
    """A plan and what its rehearsal, without moments, has shown: what a check decides on."""

    plan: Plan
    rehearsal: Rehearsal
    mission: Mission
    world: World


Twin = Callable[[Case], list[str] | None]
"""Names the offenders against one rule; None when the rule does not apply."""


def _blocks_without_intent(case: Case) -> list[str] | None:
    """ROE-10: nothing is blocked before its intent is known."""
    blocks = [action for action in case.plan.actions if action.verb == "block"]
    if not blocks:
        return None
    return [
        f"{action.agent} at {action.target}"
        for action in blocks
        if any(track.intent == "unknown" for track in _met(action, case))
    ]


def _gates_left(case: Case) -> list[str] | None:
    """WF-03: no gate loses its cover for longer than the grace time."""
    found: list[str] = []
    for name, cover in case.rehearsal.timeline.gates.items():
        if not cover.covered_before:
            continue
        if cover.covered_after and cover.longest_gap_s <= case.world.coverage_grace_s:
            continue
        gap = f"uncovered for {cover.longest_gap_s:.4g} s"
        what = gap if cover.covered_after else "left uncovered"
        by = case.rehearsal.before.gates[name].by
        found.append(f"{name} {what}" + (f" (only {by[0]} covers it)" if len(by) == 1 else ""))
    return found


def _everybody_away(case: Case) -> list[str] | None:
    """WF-06: not every asset leaves its post, nor do all gather at one frame."""
    before = case.rehearsal.before
    up = [asset for asset in before.assets.values() if asset.available]
    posts = {name: asset.post or "" for name, asset in before.assets.items()}
    ordered = {action.agent: goes_to(action, case.world) for action in case.plan.actions}
    goals = {name: ordered.get(name) or post for name, post in posts.items()}
    hostile = any(track.intent == "hostile" for track in before.tracks.values())
    if hostile or len(up) < 2 or all(goals[name] == posts[name] for name in posts):
        return None
    leavers = [asset for asset in up if goals[asset.id] != posts[asset.id]]
    frames = {goes_to(action, case.world) for action in case.plan.actions} - {""}
    found: list[str] = []
    if len(leavers) == len(up):
        found.append("every available asset would leave its post")
    if len(leavers) > 1 and any(all(goals[a.id] == frame for a in up) for frame in frames):
        found.append("every available asset would be at one frame")
    return found


def _not_possible(case: Case) -> list[str] | None:
    """WF-08: only what exists, is available, and can do it is commanded."""
    if not case.plan.actions:
        return None
    found: list[str] = []
    for action in case.plan.actions:
        asset = case.rehearsal.before.assets.get(action.agent)
        if asset is None:
            found.append(f"{action.agent} does not exist")
        elif not asset.available:
            found.append(f"{action.agent} is not available")
        elif action.target is not None and action.target not in case.world.frames:
            found.append(f"{action.agent} has no frame {action.target}")
        elif asset.kind not in COMMANDS[action.verb].kinds:
            found.append(f"{action.agent} is a {asset.kind} and cannot {action.verb}")
    return found


def _low_and_sent_out(case: Case) -> list[str] | None:
    """CAP-04: an asset low on battery returns, holds or reports."""
    before = case.rehearsal.before.assets
    low = [a for a in case.plan.actions if a.agent in before and before[a.agent].low_battery]
    if not low:
        return None
    return [
        f"{action.agent} ({before[action.agent].battery_pct:.4g} %)"
        for action in low
        if action.verb not in ("hold", "report", "return_to_base")
        and goes_to(action, case.world) != case.world.base
    ]


def _addressed_twice(case: Case) -> list[str] | None:
    """CAP-07: no agent gets two commands."""
    agents = case.plan.agents
    return [name for name in agents if agents.count(name) > 1] if agents else None


def _met(action: Action, case: Case) -> list[Track]:
    """Return the tracks at the gate that the action leads to, or those inside."""
    goal = goes_to(action, case.world)
    tracks = case.rehearsal.before.tracks.values()
    if goal in case.world.gates:
        return [track for track in tracks if track.gate == goal]
    return [track for track in tracks if goal and track.status == "inside"]


TWINS: Mapping[str, Twin] = {
    "ROE-10": _blocks_without_intent,
    "WF-03": _gates_left,
    "WF-06": _everybody_away,
    "WF-08": _not_possible,
    "CAP-04": _low_and_sent_out,
    "CAP-07": _addressed_twice,
}
