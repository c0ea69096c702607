"""Says in one short line what an incident, an order or a decision is, as lists show it."""

from collections.abc import Sequence

from pa_console.schema.command import DeviceCommand
from pa_console.schema.incident import Incident, Reaction, RevealTrack, SpawnTrack
from pa_console.schema.mission import Decision
from pa_console.schema.plan import Action
from pa_console.session.reading_words import meant

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
    "turn": "the truth behind {track} changes",
    "worker": "the model's worker process is killed",
    "place": "{asset} is placed at {frame}",
    "clear": "all tracks at {gate} are gone",
}
_LINK = {"ok": "works", "degraded": "is degraded", "lost": "is lost"}
_REACTIONS: dict[Reaction, str] = {
    "leave": "leaves when warned",
    "stop": "stops when warned",
    "go_on": "goes on when warned",
}


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


def truth_in_words(incident: Incident) -> str:
    """Return all of `incident`, the truth behind a track too: for who reads a script of them."""
    match incident:
        case SpawnTrack(name=name, track=track, gate=gate):
            who = f"a {track}{f' ({name})' if name else ''} appears on the lane to {gate}"
        case RevealTrack(track=track):
            who = f"{track} from now on"
        case _:
            return in_words(incident)
    truth = [known for known in (incident.identity, incident.intent) if known]
    truth += [_REACTIONS[incident.when_warned]] if incident.when_warned else []
    return f"{who}: {', '.join(truth)}" if truth else who


def overriding(decision: Decision) -> str:
    """Return in what the operator decided otherwise than the console proposed, empty if in nothing.

    That is a changed plan, another reading of the order, an objection of the judge that was
    overruled, or an accepted breach.
    """
    said: list[str] = []
    if decision.kind == "modify":
        said.append("the plan was changed")
    if decision.kind == "choose":
        said.append(f"the order was read as {meant(decision.asked)!r}")
    if decision.kind == "approve" and decision.override_judge:
        said.append("the judge was overruled")
    if decision.kind == "approve" and decision.acknowledged:
        said.append(f"broken {', '.join(decision.acknowledged)} accepted")
    if not said:
        return ""
    return f"{', '.join(said)} by {decision.by}" + (
        f": {decision.reason}" if decision.reason else ""
    )


def safety_in_words(declared: Sequence[Action]) -> str:
    """Return a plan's declared way to safety: who goes back where, and who holds."""
    parts = [
        f"{action.agent} back to {action.target} (holds if another covers it by then)"
        for action in declared
        if action.target is not None
    ]
    holding = [action.agent for action in declared if action.target is None]
    if holding:
        parts.append(f"{', '.join(holding)} {'hold' if len(holding) > 1 else 'holds'}")
    return "; ".join(parts)


def order_in_words(command: DeviceCommand | Action) -> str:
    """Return what a command orders, as it is written in a plan: `move_to EastGate`."""
    return f"{command.verb} {command.target or ''}".strip()
