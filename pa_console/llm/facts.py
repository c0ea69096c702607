"""What the models are told of world, situation, rehearsal and outcome, in few words."""

from collections.abc import Iterable

from pa_console.schema.mission import Verification
from pa_console.schema.plan import COMMANDS
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.telemetry import Digest
from pa_console.schema.world import AssetKind, World

WORDS: dict[AssetKind, str] = {"uav": "drone", "ugv": "vehicle", "robot": "robot"}
"""What people call the kinds of assets, and what the models read of them."""


def vocabulary(world: World) -> str:
    """Return who may do what and the frames of `world`; it never changes."""
    lines = ["Commands"]
    for verb, spec in COMMANDS.items():
        kinds = sorted(WORDS[kind] for kind in spec.kinds)
        who = "all" if len(kinds) == len(WORDS) else ", ".join(kinds)
        lines.append(f"{verb}{' FRAME' if spec.takes_frame else ''}: {who}")
    lines.append(f"Frames: {', '.join(world.frames)}")
    return "\n".join(lines)


def situation(digest: Digest) -> str:
    """Return the digested picture (paper, Step 4) but for the free assets."""
    guards = "; ".join(f"{name} at {gate}" for gate, name in digest.sole_cover.items()) or "none"
    lines = [f"Guards: {guards}. Without guard: {_list(digest.uncovered)}"]
    for label, names in (
        ("Down", digest.down),
        ("Low battery", digest.low_battery),
        ("Degraded comms", digest.degraded_comms),
    ):
        if names:
            lines.append(f"{label}: {_list(names)}")
    if digest.tracks:
        lines.append(f"Tracks: {'; '.join(digest.tracks)}")
    return "\n".join(lines)


def free_assets(digest: Digest) -> str:
    """Return the assets that may leave their place, per kind."""
    return "Free: " + "; ".join(
        f"{WORDS[kind]} {_list(_placed(digest, name) for name in names)}"
        for kind, names in digest.free.items()
    )


def _placed(digest: Digest, name: str) -> str:
    """Return the asset, and which gate it covers together with others."""
    place = digest.posts.get(name, "").rpartition(" at ")[2]
    return f"{name} (at {place})" if place in digest.covered else name


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
