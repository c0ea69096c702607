"""The facts of world, situation, rehearsal and outcome for the models, in few words."""

from collections.abc import Iterable, Sequence

from pa_console.schema.command import COMMANDS
from pa_console.schema.mission import Verification
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.telemetry import Digest
from pa_console.schema.world import PLAIN_KINDS, World

FEW_FRAMES = 24
"""The number of frames from which every prompt names those that matter."""
MOST_PROBLEMS = 24


def command_vocabulary(world: World) -> str:
    """Return who may do what and the frames of `world`, if they are few; it never changes."""
    lines = ["Commands"]
    for verb, spec in COMMANDS.items():
        kinds = sorted(PLAIN_KINDS[kind] for kind in spec.kinds)
        who = "all" if len(kinds) == len(PLAIN_KINDS) else ", ".join(kinds)
        lines.append(f"{verb}{' FRAME' if spec.takes_frame else ''}: {who}")
    if len(world.frames) <= FEW_FRAMES:
        lines.append(f"Frames: {', '.join(world.frames)}")
    return "\n".join(lines)


def frames(world: World, digest: Digest) -> list[str]:
    """Return a line with the frames that matter now, where `vocabulary` does not list them."""
    if len(world.frames) <= FEW_FRAMES:
        return []
    chosen = digest.selection.frames if digest.selection is not None else tuple(world.frames)
    return [f"Frames: {', '.join(chosen)}"]


def picture_facts(digest: Digest) -> str:
    """Return the digested picture (paper, Step 4) but for the free assets."""
    guards = "; ".join(f"{name} at {gate}" for gate, name in digest.sole_cover.items()) or "none"
    lines = [
        *line_if_any("Unknown", digest.unknown),
        *line_if_any("Down", digest.down),
        *line_if_any("Degraded comms", digest.degraded_comms),
        *line_if_any("Tracks", digest.tracks),
        *line_if_any("Low battery", digest.low_battery, ", to return to base"),
        *line_if_any("Without guard", digest.uncovered, ", needs one Free asset"),
        f"Guards: {guards}",
    ]
    return "\n".join(lines)


def low_battery(digest: Digest) -> list[str]:
    """Return a line that names the assets low on battery, if any."""
    return line_if_any("Low battery", digest.low_battery)


def line_if_any(label: str, words: Sequence[str], due: str = "") -> list[str]:
    """Return one line, or none without facts."""
    return [f"{label}: {'; '.join(words)}{due}"] if words else []


def free_assets(digest: Digest) -> str:
    """Return the assets that may leave their place, per kind."""
    return "Free: " + "; ".join(
        f"{PLAIN_KINDS[kind]} {_list(_placed(digest, name) for name in names)}"
        for kind, names in digest.free.items()
    )


def _placed(digest: Digest, name: str) -> str:
    """Return the asset, and which gate it covers together with others."""
    place = digest.posts.get(name, "").rpartition(" at ")[2]
    return f"{name} (at {place})" if place in digest.covered else name


NO_PROBLEM = "no problem, so every rule complies"


def plan_facts(world: World, plan: Plan) -> str:
    """Return the actions of `plan` with the kind of each asset; its reason is not evidence."""
    return (
        "; ".join(
            f"{PLAIN_KINDS[world.assets[action.agent].kind]} {action.agent} {action.command}"
            for action in plan.actions
        )
        or "nothing"
    )


def rehearsal_facts(world: World, rehearsal: Rehearsal) -> str:
    """Return what became of the tracks, then what went wrong when the plan was rehearsed."""
    timeline = rehearsal.timeline
    problems: list[str] = []
    restored: list[str] = []
    for gate, cover in timeline.gates.items():
        if not cover.covered_after:
            problems.append(f"{gate} {'is left' if cover.covered_before else 'stays'} uncovered")
        elif not cover.covered_before:
            restored.append(f"; {gate} is covered again")
        elif cover.longest_gap_s > world.coverage_grace_s:
            problems.append(f"{gate} is uncovered for {cover.longest_gap_s:.0f} s")
    for name, fact in timeline.assets.items():
        if not fact.finished:
            problems.append(f"{name} does not finish ({fact.detail or 'no reason'})")
        if fact.left_perimeter:
            problems.append(f"{name} leaves the perimeter")
        problems += [f"{name} enters {zone}" for zone in fact.entered_zones]
    for name, fact in timeline.tracks.items():
        if fact.least_distance_m is not None and fact.least_distance_m < world.standoff_m:
            problems.append(f"a ground asset comes within {fact.least_distance_m:.0f} m of {name}")
    if len(problems) > MOST_PROBLEMS:
        problems[MOST_PROBLEMS:] = [f"{len(problems) - MOST_PROBLEMS} more"]
    outcome = f"problem: {'; '.join(problems)}" if problems else NO_PROBLEM + "".join(restored)
    lines: list[str] = []
    for name, fact in timeline.tracks.items():
        steps = {
            "observed": fact.observed_s,
            "identified": fact.identified_s,
            "warned": fact.warned_s,
            "blocked": fact.blocked_s,
        }
        taken = [step for step, at in steps.items() if at is not None]
        lines.append(f"{name} is {_list(taken) if taken else 'not looked at'}")
    return "\n".join([f"Tracks then: {'; '.join(lines)}"] * bool(lines) + [f"Rehearsal: {outcome}"])


def verification_facts(verification: Verification) -> str:
    """Return the evidence of telemetry on the executed plan."""
    lines = [f"Telemetry: {verification.outcome}. {verification.reason}".strip()]
    lines += [
        f"{action.agent} {action.command}: {action.outcome}, {action.reason}"
        for action in verification.actions
    ]
    lines.append(f"Gates that lost their cover: {_list(verification.gates_lost)}")
    lines += line_if_any("Gates whose cover is unknown", verification.gates_unknown)
    return "\n".join(lines)


def _list(words: Iterable[str]) -> str:
    return ", ".join(words) or "none"
