"""Step 7: does telemetry show that the plan happened? Unknown is never taken for done."""

from collections.abc import Mapping

from pa_console.schema.command import CommandReply
from pa_console.schema.mission import ActionOutcome, Outcome, Verification
from pa_console.schema.plan import Action, Plan
from pa_console.schema.telemetry import AssetTelemetry, Picture
from pa_console.schema.world import World

STALE_S = 3.0


def verify_plan(
    plan: Plan,
    world: World,
    before: Picture,
    after: Picture,
    final: Mapping[str, CommandReply],
) -> Verification:
    """Compare `after` with what every action should have brought about.

    `final` maps agents to the last reply to their command. A gate that was covered before and is
    not now makes the outcome a failure whatever the actions did (WF-03).
    """
    actions = tuple(
        _action(action, world, after, final.get(action.agent)) for action in plan.actions
    )
    lost = tuple(
        gate for gate in world.gates if before.gates[gate].covered and not after.gates[gate].covered
    )
    outcomes = {action.outcome for action in actions}
    outcome: Outcome = "pass"
    reason = "telemetry shows every action and every gate's cover"
    if lost or "fail" in outcomes:
        outcome = "fail"
        failed = [f"{a.agent} {a.command}: {a.reason}" for a in actions if a.outcome == "fail"]
        reason = "; ".join([*(f"{gate} is no longer covered" for gate in lost), *failed])
    elif "unknown" in outcomes:
        outcome = "unknown"
        reason = "; ".join(f"{a.agent}: {a.reason}" for a in actions if a.outcome == "unknown")
    return Verification(outcome=outcome, actions=actions, gates_lost=lost, reason=reason)


def _action(
    action: Action, world: World, after: Picture, reply: CommandReply | None
) -> ActionOutcome:
    asset = after.assets.get(action.agent)
    if asset is None:
        outcome, reason = "unknown", "no telemetry of this asset"
    elif after.time_s - asset.stamp_s > STALE_S:
        age = after.time_s - asset.stamp_s
        outcome, reason = "unknown", f"the last telemetry is {age:.0f} s old"
    elif reply is None:
        outcome, reason = "unknown", "the device never answered"
    elif reply.status != "done":
        outcome, reason = "fail", reply.detail or reply.status
    else:
        outcome, reason = _seen(action, world, after, asset)
    return ActionOutcome(agent=action.agent, command=action.command, outcome=outcome, reason=reason)


def _seen(
    action: Action, world: World, after: Picture, asset: AssetTelemetry
) -> tuple[Outcome, str]:
    """Judge one action that its device reported as done, by telemetry alone."""
    where = asset.at or "between frames"
    match action.verb:
        case "hold":
            still = asset.speed_mps < 0.5
            return ("pass", f"still at {where}") if still else ("fail", "it is still moving")
        case "report":
            return "pass", "report received"
        case "move_to" | "observe" | "block":
            target = action.target
        case "return_to_base":
            target = world.base
        case "identify":
            known = [t for t in after.tracks.values() if t.gate == action.target]
            named = [t.id for t in known if t.identity != "unknown"]
            if named:
                return "pass", f"identified {', '.join(named)}"
            return ("fail", "still unidentified") if known else ("unknown", "the track is gone")
        case "warn":
            known = [t for t in after.tracks.values() if t.gate == action.target]
            warned = [t.id for t in known if t.warned]
            if warned:
                return "pass", f"warned {', '.join(warned)}"
            return ("fail", "not warned") if known else ("unknown", "the track is gone")
    return ("pass", f"at {target}") if asset.at == target else ("fail", f"it is at {where}")
