"""What the models are told of world, situation, rehearsal and outcome, in few words."""

from collections.abc import Iterable

from pa_console.llm.grammar import KINDS
from pa_console.schema.mission import Verification
from pa_console.schema.plan import COMMANDS
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.telemetry import Digest
from pa_console.schema.world import World


def vocabulary(world: World) -> str:
    """Return who may do what, the frames and the assets of `world`; it never changes."""
    lines = ["Commands"]
    for verb, spec in COMMANDS.items():
        who = "all" if set(KINDS) <= spec.kinds else ", ".join(sorted(spec.kinds))
        lines.append(f"{verb}{' FRAME' if spec.takes_frame else ''}: {who}")
    lines.append(f"Frames: {', '.join(world.frames)}")
    for kind in KINDS:
        names = [name for name, spec in world.assets.items() if spec.kind == kind]
        lines.append(f"{kind}: {_list(names)}")
    return "\n".join(lines)


def situation(digest: Digest) -> str:
    """Return the digested picture (paper, Step 4)."""
    free = [f"{kind} {', '.join(names)}" for kind, names in digest.free.items() if names]
    lines = [
        "Situation",
        "Cover: " + ", ".join(f"{gate} {count}" for gate, count in digest.covered.items()),
        f"Uncovered: {_list(digest.uncovered)}",
        f"Sole cover: {_list(f'{gate} by {name}' for gate, name in digest.sole_cover.items())}",
        f"Free: {'; '.join(free) or 'none'}",
        f"Assets: {_list(f'{name} {post}' for name, post in digest.posts.items())}",
        f"Down: {_list(digest.down)}",
        f"Low battery: {_list(digest.low_battery)}",
        f"Degraded comms: {_list(digest.degraded_comms)}",
        f"Tracks: {'; '.join(digest.tracks) or 'none'}",
    ]
    return "\n".join(lines)


def rehearsal_facts(rehearsal: Rehearsal) -> str:
    """Return what the plan did when it was rehearsed, per gate, asset and track."""
    timeline = rehearsal.timeline
    lines = [f"Rehearsal, {timeline.duration_s:.0f} s"]
    for gate, fact in timeline.gates.items():
        before, after = _covered(fact.covered_before), _covered(fact.covered_after)
        lines.append(f"{gate}: {before}, then {after}, longest gap {fact.longest_gap_s:.0f} s")
    for name, fact in timeline.assets.items():
        told = ["finished" if fact.finished else f"did not finish ({fact.detail or 'no reason'})"]
        told += ["left the perimeter"] * fact.left_perimeter
        told += [f"entered {zone}" for zone in fact.entered_zones]
        told.append(f"battery {fact.least_battery_pct:.0f}%")
        lines.append(f"{name}: {', '.join(told)}")
    for name, fact in timeline.tracks.items():
        steps = {
            "observed": fact.observed_s,
            "identified": fact.identified_s,
            "warned": fact.warned_s,
            "blocked": fact.blocked_s,
        }
        told = [f"{step} at {at:.0f} s" for step, at in steps.items() if at is not None]
        lines.append(f"{name}: {_list(told)}")
    return "\n".join(lines)


def verification_facts(verification: Verification) -> str:
    """Return what telemetry says of the executed plan."""
    lines = [f"Telemetry: {verification.outcome}. {verification.reason}".strip()]
    lines += [
        f"{action.agent} {action.command}: {action.outcome}, {action.reason}"
        for action in verification.actions
    ]
    lines.append(f"Gates that lost their cover: {_list(verification.gates_lost)}")
    return "\n".join(lines)


def _covered(covered: bool) -> str:
    return "covered" if covered else "uncovered"


def _list(words: Iterable[str]) -> str:
    return ", ".join(words) or "none"
