"""Step 8: the brief report after a mission (WF-09)."""

from pa_console.schema.mission import Mission, MissionStatus, Verification
from pa_console.schema.plan import Plan
from pa_console.schema.telemetry import Picture


def brief_report(
    mission: Mission,
    *,
    status: MissionStatus,
    reason: str,
    plan: Plan | None,
    verification: Verification | None,
    picture: Picture,
) -> str:
    """Return a few plain lines: what was asked and done, what telemetry shows, what is open."""
    lines = [f"{mission.id} {status}: {mission.text}"]
    if verification is not None and plan is not None:
        lines.append(f"Rationale: {plan.reason}")
        lines.extend(
            f"- {action.agent} {action.command}: {action.outcome}, {action.reason}"
            for action in verification.actions
        )
    else:
        lines.append(f"Nothing was executed: {reason}")
    uncovered = [gate for gate, cover in picture.gates.items() if not cover.covered]
    lines.append(f"Uncovered gates: {', '.join(uncovered)}" if uncovered else "All gates covered.")
    lines.extend(
        f"Open track: {track.id} at {track.gate}, identity {track.identity}, intent {track.intent}"
        for track in picture.tracks.values()
    )
    return "\n".join(lines)
