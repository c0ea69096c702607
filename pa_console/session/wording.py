"""Says in one short line what an incident or a decision was, as the event list shows it."""

from pa_console.schema.incident import Incident
from pa_console.schema.mission import Decision

_TEMPLATES: dict[str, str] = {
    "spawn": "a {track} appears on the lane to {gate}",
    "fail": "{asset} has stopped working",
    "restore": "{asset} works again",
    "degrade": "{asset} runs at {speed_factor:.0%} of its speed",
    "battery": "battery of {asset} reads {percent:g} %",
    "comms": "link of {asset} {state}",
    "radio": "link of {asset} {state}",
    "jam": "links within {radius_m:g} m of ({at[0]:g}, {at[1]:g}) are jammed",
    "sensor": "sensor {sensor} {state}",
    "gps": "position of {asset} drifts by {rate_mps:g} m/s",
    "spoof": "telemetry of {asset} is forged",
    "weather": "weather: {weather}",
    "obstruct": "the way is obstructed at ({start[0]:g}, {start[1]:g})",
    "phantom": "a sensor at {gate} reports what is not there",
    "turn": "{track} is not what it was",
    "worker": "the model's process is killed",
    "place": "{asset} is placed at {frame}",
    "clear": "all tracks at {gate} are gone",
}
_LINK = {"ok": "works", "degraded": "is degraded", "lost": "is lost"}


def in_words(incident: Incident) -> str:
    """Return what an operator could see of `incident`; the truth behind a track stays hidden."""
    values = incident.model_dump()
    match incident.kind:
        case "comms":
            values["state"] = _LINK[incident.comms]
        case "radio":
            values["asset"] = incident.asset or "every asset"
            lossy = f"loses {incident.loss:.0%} of its messages"
            values["state"] = lossy if incident.up else "is down"
        case "sensor":
            values["state"] = "works again" if incident.works else "has stopped working"
        case _:
            pass
    return _TEMPLATES[incident.kind].format_map(values)


def overriding(decision: Decision) -> str:
    """Return in what the operator decided otherwise than the console proposed, empty if in nothing.

    That is a changed plan, an objection of the judge that was overruled, or an accepted breach.
    """
    said: list[str] = []
    if decision.kind == "modify":
        said.append("the plan was changed")
    if decision.kind == "approve" and decision.override_judge:
        said.append("the judge was overruled")
    if decision.kind == "approve" and decision.acknowledged:
        said.append(f"broken {', '.join(decision.acknowledged)} accepted")
    if not said:
        return ""
    return f"{', '.join(said)} by {decision.by}" + (
        f": {decision.reason}" if decision.reason else ""
    )
