"""Events, incidents, orders and decisions in words, one short line each."""

import re
from collections.abc import Mapping, Sequence

from pa_console.language.canonical.reading import plain_reading
from pa_console.schema.command import DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.incident import Incident
from pa_console.schema.mission import Alarm, Decision
from pa_console.schema.plan import Action
from pa_console.schema.telemetry import Picture, TrackStatus

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
    "manual_control": "{asset} {state}",
    "weather": "weather: {weather}",
    "obstruct": "the way is obstructed at ({start[0]:g}, {start[1]:g})",
    "phantom": "a sensor at {gate} reports a false contact",
    "turn": "the true properties of {track} change",
    "worker": "the model's worker process is killed",
    "place": "{asset} is placed at {frame}",
    "clear": "all tracks at {gate} are gone",
}
_LINK = {"ok": "works", "degraded": "is degraded", "lost": "is lost"}


TRACK_PLACES: dict[TrackStatus, str] = {
    "approaching": "is approaching {gate}",
    "stopped": "has stopped at {gate}",
    "inside": "has passed {gate}",
    "leaving": "is leaving {gate}",
}
"""The place of a track at its gate in words, by the track's status."""

_PLACE = re.compile(r"\b(?:is approaching|has stopped at|has passed|is leaving) ")
_DISTANCE = re.compile(r"\d+ m\Z")


def alarm_now(alarm: Alarm, picture: Picture | None) -> Alarm:
    """Return `alarm` with the place and distance that its track now has in the picture."""
    track = picture.tracks.get(alarm.subject) if picture is not None else None
    if track is None or alarm.distance_m is None:
        return alarm
    place = TRACK_PLACES[track.status].format(gate="")
    text = _DISTANCE.sub(f"{track.distance_m:.0f} m", _PLACE.sub(place, alarm.text, count=1))
    return alarm.model_copy(update={"text": text, "distance_m": track.distance_m})


def incident_in_words(incident: Incident) -> str:
    """Return `incident` in words, without the true properties of a track."""
    values = incident.model_dump()
    match incident.kind:
        case "comms":
            values["state"] = _LINK[incident.comms]
        case "radio":
            values["asset"] = incident.asset or "every asset"
            lossy = f"loses {incident.loss:.0%} of its messages"
            values["state"] = lossy if incident.up else "is down"
        case "manual_control":
            goes = f" and goes to {incident.frame}" if incident.frame else ""
            driven = f"is driven by hand{goes}"
            values["state"] = "takes commands again" if incident.ends else driven
        case "sensor":
            values["state"] = "works again" if incident.works else "has stopped working"
        case _:
            pass
    return _TEMPLATES[incident.kind].format_map(values)


def deviations_in_words(decision: Decision) -> str:
    """Return the operator's deviations from the console's proposal; '' if there are none.

    A deviation is a changed plan, another reading of the order, an override of the judge, or an
    acknowledged broken rule.
    """
    words: list[str] = []
    if decision.kind == "modify":
        words.append("the plan was changed")
    if decision.kind == "choose":
        words.append(f"the order was read as “{plain_reading(decision.asked)}”")
    if decision.kind == "approve" and decision.override_judge:
        words.append("the judge was overridden")
    if decision.kind == "approve" and decision.acknowledged:
        words.append(f"broken {', '.join(decision.acknowledged)} accepted")
    if not words:
        return ""
    return f"{', '.join(words)} by {decision.by}" + (
        f": {decision.reason}" if decision.reason else ""
    )


def order_in_words(command: DeviceCommand | Action) -> str:
    """Return a command as it is written in a plan, such as `move_to EastGate`."""
    return f"{command.verb} {command.target or ''}".strip()


def answer_in_words(answer: ev.QuestionAnswered) -> str:
    """Return a question and its answer in one line."""
    lines = "; ".join(f"{line.about}: {line.said}" for line in answer.lines)
    return f"“{answer.question}” {lines}".strip()


def contact_in_words(contact: ev.ReportedContact) -> str:
    """Return the claims about a contact: *“ALPHA-1”, said to be friend, vehicle, at (12, -3)*."""
    x, y = contact.at
    claimed = f"said to be {contact.affiliation}, {contact.what}"
    return f"“{contact.name}”, {claimed}, at ({x:.0f}, {y:.0f})"


def unconfirmed_in_words(assets: Mapping[str, str]) -> str:
    """Return the assets that are not known to hold after a stop, with the reasons."""
    if not assets:
        return "every asset stands still, as telemetry shows"
    names = ", ".join(f"{name} ({why})" for name, why in assets.items())
    return f"STOP not confirmed by {names}"


def link_in_words(name: str, links: Mapping[str, str]) -> str:
    """Return the link of the asset `name` in words; '' if the fleet has no `links`."""
    if not links:
        return ""
    return f"over {links[name]}" if name in links else "on no link"


def links_in_words(picture: Picture) -> list[str]:
    """Return a line for each link with its assets, and one for the assets without a link."""
    on: dict[str, list[str]] = {}
    for name in picture.assets if picture.links else ():
        on.setdefault(picture.links.get(name, ""), []).append(name)
    none = on.pop("", [])
    lines = [
        f"{link}: {', '.join(names)}"
        + (f"; nothing comes from {', '.join(lost)}" if (lost := _lost(names, picture)) else "")
        for link, names in sorted(on.items())
    ]
    return [*lines, *([f"on no link: {', '.join(none)}"] if none else [])]


def _lost(names: Sequence[str], picture: Picture) -> list[str]:
    return [name for name in names if picture.assets[name].comms == "lost"]


def command_taken_in_words(taken: ev.CommandTaken) -> str:
    """Return the station that lost command, and the last record of its log."""
    return (
        f"taken from {taken.station} by {taken.by}, epoch {taken.epoch}; its session "
        f"{taken.session} had {taken.records} records, last hash {taken.head[:12]}"
    )
