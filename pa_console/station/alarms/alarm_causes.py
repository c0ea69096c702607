"""Causes of alarms: all conditions in a picture of which an operator must be informed."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from pa_console.mission.planning.picture_text import silence
from pa_console.policy.moments import ways_out_shut
from pa_console.schema.base import AlarmPriority
from pa_console.schema.mission import AlarmKind
from pa_console.schema.telemetry import AssetTelemetry, GateCover, Picture, Track
from pa_console.schema.world import World
from pa_console.session.wording import TRACK_PLACES

AlarmTopic = Literal["threat", "track", "way", "cover", "asset", "battery", "camera", "sensor"]
BATTERY_MARGIN_PCT = 3.0
"""The margin above the limit of a low battery from which an open alarm may clear, in percent. The
alarm may also clear when the asset returns to base or charges."""


@dataclass(frozen=True)
class Cause:
    """A reason for an alarm; causes with the same topic and subject share one alarm.

    A cause must be present for `settle_s` before it raises an alarm, and absent for `linger_s`
    before the alarm clears, in simulated seconds. If `raises` is False, the cause can only keep an
    alarm open.
    """

    topic: AlarmTopic
    kind: AlarmKind
    priority: AlarmPriority
    subject: str
    gate: str | None
    text: str
    command: str = ""
    distance_m: float | None = None
    settle_s: float = 0.0
    linger_s: float = 3.0
    raises: bool = True
    sensors: tuple[str, ...] = ()
    """The sensors that detect the track."""

    @property
    def key(self) -> tuple[AlarmTopic, str]:
        """The key of the alarm: causes with the same key share one alarm."""
        return self.topic, " ".join(self.sensors) if self.topic == "sensor" else self.subject


def causes(picture: Picture, world: World, guards: Mapping[str, tuple[str, ...]]) -> list[Cause]:
    """Return every cause that `picture` shows.

    `guards` maps each gate to the assets that were last certain to cover it. If one of them is
    lost, the alarm for the gate names the asset and proposes a command in response; the alarm for
    the asset itself proposes none.
    """
    result = [cause for track in picture.tracks.values() if (cause := _track(track)) is not None]
    result.extend(_ways(picture, world))
    for gate, cover in picture.gates.items():
        if not cover.covered:
            result.append(_cover(picture, world, gate, cover, guards.get(gate, ())))
    alone = {names[0]: gate for gate, names in guards.items() if len(names) == 1}
    for asset in picture.assets.values():
        gate = alone.get(asset.id)
        result.extend(_asset(asset, gate, picture.time_s))
    result.extend(_cameras(picture, world))
    return result


def _track(track: Track) -> Cause | None:
    """Return the cause of an alarm about `track`; None if no alarm is needed.

    No alarm is needed for a leaving track, or for an authorized track that is not hostile or
    defiant.
    """
    if track.status == "leaving":
        return None
    identity = "" if track.identity == "unknown" else f"{track.identity} "
    where = TRACK_PLACES[track.status].format(gate=track.gate)
    care = ". Noncombatants are suspected: only observe and report" if track.noncombatants else ""
    disputed = ", identity disputed" if track.dispute else ""
    topic, settle_s = "threat", 0.0
    if track.intent == "hostile":
        kind, priority, sentence = "hostile_track", "emergency", f"hostile {track.kind}"
        sentence, order = f"A {sentence} {where}", ". Block it." if track.warned else "."
    elif track.defiant:
        kind, priority = "defiant_track", "emergency"
        sentence = f"{_an(identity or 'unknown ')}{track.kind} {where} in spite of a warning"
        order = ". Observe it and keep the gate covered."
    elif track.identity == "authorized":
        return None
    elif track.identity == "unauthorized":
        topic, kind = "track", "unauthorized_track"
        priority = "medium" if track.intent == "benign" else "high"
        sentence, order = f"An unauthorized {track.kind} {where}", ". Warn it to turn back."
        if track.warned:
            order = ""
    else:
        topic, kind, settle_s = "track", "unknown_track", 1.0
        priority = "medium" if track.intent == "benign" else "high"
        sentence, order = f"An unknown {track.kind} {where}", "."
    return Cause(
        topic, kind, priority, track.id, track.gate,
        text=f"{track.id}: {sentence[0].lower()}{sentence[1:]}, {track.distance_m:.0f} m{disputed}",
        command=f"{sentence}{care}." if order and care else f"{sentence}{order}" if order else "",
        distance_m=track.distance_m, settle_s=settle_s, linger_s=5.0, sensors=track.seen_by,
    )  # fmt: skip


def _ways(picture: Picture, world: World) -> Iterator[Cause]:
    """Yield a cause for each track that an asset blocks although it must pass (ROE-12, ROE-13).

    This may happen after the plan was checked, and a block ends only by another order.
    """
    blockers = {
        asset.at: asset.id
        for asset in picture.assets.values()
        if asset.task == "blocking" and asset.at in picture.gates
    }
    shut = bool(blockers) and ways_out_shut(picture, world)
    for track in picture.tracks.values() if blockers else ():
        contact = "emergency vehicle" if track.emergency else f"{track.identity} {track.kind}"
        person = track.kind == "person" or track.noncombatants
        let_through = track.emergency or track.identity == "authorized"
        if shut and track.status == "inside" and (person or let_through):
            where = f"is shut in: {', '.join(sorted(filter(None, blockers)))} are blocked"
        elif let_through and track.status != "leaving" and track.gate in blockers:
            where = f"waits at {track.gate}, which {blockers[track.gate]} blocks"
        else:
            continue
        yield Cause(
            "way", "way_blocked", "high", track.id, track.gate,
            text=f"{track.id}: {'an' if contact[0] in 'aeiou' else 'a'} {contact} {where}",
            distance_m=track.distance_m, settle_s=1.0, linger_s=3.0, sensors=track.seen_by,
        )  # fmt: skip


def many_contacts(sensors: tuple[str, ...], held: Sequence[Cause], opened: int) -> Cause:
    """Return one cause that replaces the causes `held`, which do not get their own alarms.

    The most urgent cause is first in `held`. `opened` is the number of open alarms about contacts
    of the same `sensors`.
    """
    needs, number = "contacts that need a response", opened + len(held)
    if len(sensors) == 1:
        reported = f"{sensors[0]} alone reports {number} {needs}"
    elif sensors:
        reported = f"{', '.join(sensors)} report {number} {needs}"
    else:
        reported = f"{number} {needs} are reported by no sensor now"
    worst = held[0]
    return Cause(
        "sensor", "many_contacts", worst.priority, sensors[0] if sensors else worst.subject,
        worst.gate, text=f"{reported}: {opened} have an alarm each, the rest is set aside",
        linger_s=5.0, sensors=sensors,
    )  # fmt: skip


def _cover(
    picture: Picture, world: World, gate: str, cover: GateCover, guards: tuple[str, ...]
) -> Cause:
    """Return the cause of an alarm about a gate that is not certainly covered.

    While one guard takes over from another, the gate may be uncovered for half the grace time
    (WF-03). If the guard is known to be lost, the alarm is raised after one second.
    """
    if cover.unknown:
        unsure = [picture.assets[name] for name in cover.unsure if name in picture.assets]
        why = ", ".join(filter(None, (silence(picture, asset) for asset in unsure)))
        silent = all(asset.comms == "lost" for asset in unsure)
        return Cause(
            "cover", "coverage_unknown", "high" if silent else "medium", gate, gate,
            text=f"nobody knows whether {gate} is covered: {why or 'its guard is not heard'}",
            command=f"Nobody knows whether {gate} has a guard: fill the gap at {gate}.",
            settle_s=world.stale_s,
        )  # fmt: skip
    away = [picture.assets[name] for name in guards if name in picture.assets]
    driven = [f"{asset.id} is under manual control" for asset in away if asset.manual]
    failed = [
        silence(picture, asset) or f"{asset.id} has failed"
        for asset in away
        if not (asset.available or asset.manual)
    ]
    lost = [*failed, *driven]
    return Cause(
        "cover", "coverage_lost", "emergency" if lost else "high", gate, gate,
        text=f"{gate} is not covered" + (f": {', '.join(lost)}" if lost else ""),
        command=f"{failed[0] if failed else f'{gate} has no guard'}: fill the gap at {gate}.",
        settle_s=1.0 if lost else world.coverage_grace_s / 2,
        linger_s=2.0,
    )  # fmt: skip


def _asset(asset: AssetTelemetry, alone_at: str | None, time_s: float) -> Iterator[Cause]:
    """Yield the cause of an alarm about an asset, if any.

    If the asset has failed, is silent or is suspect, the first of these is the cause. Otherwise,
    the cause is a low battery.
    """
    place = alone_at or (asset.at if asset.at == asset.post else None)
    priority: AlarmPriority = "high" if alone_at else "medium"
    name = f"{asset.id} at {place}" if place else asset.id
    trouble: tuple[AlarmKind, str, float] | None = None
    if asset.status == "failed":
        trouble = "asset_failed", f"{name} has failed", 0.0
    elif asset.comms == "lost":
        silent_s = time_s - asset.stamp_s
        trouble = "link_lost", f"{name} has been silent for {silent_s:.0f} s", 0.0
    elif asset.integrity == "suspect":
        trouble = "suspect_telemetry", f"{name} sends telemetry that cannot be right", 1.5
    if trouble is not None:
        kind, text, settle_s = trouble
        yield Cause("asset", kind, priority, asset.id, place, text, settle_s=settle_s)
        return
    if asset.task in ("returning", "charging") or not (asset.available or asset.stale):
        return
    if asset.low_battery:
        does = f"{asset.id} has a low battery and must return to base."
        if alone_at:
            relief = f"so {alone_at} needs a second guard: send one asset to {alone_at}."
            does = f"{asset.id} has a low battery, {relief}"
        yield Cause(
            "battery", "low_battery", "medium" if alone_at else "low", asset.id, place,
            text=f"{name} has a low battery, {asset.battery_pct:.0f} %",
            command=does,
            settle_s=2.0,
            raises=not asset.stale,
        )  # fmt: skip


def almost_low(picture: Picture, world: World) -> Iterator[tuple[AlarmTopic, str]]:
    """Yield the keys of batteries near their limit, whose open alarms must not clear."""
    for asset in picture.assets.values():
        near = asset.battery_pct < world.low_battery_pct + BATTERY_MARGIN_PCT
        if near and asset.task not in ("returning", "charging") and asset.status != "failed":
            yield "battery", asset.id


def _cameras(picture: Picture, world: World) -> Iterator[Cause]:
    for name, camera in picture.cameras.items():
        silent_s = picture.time_s - camera.stamp_s
        if camera.works and silent_s <= world.link_lost_s:
            continue
        why = "is out" if not camera.works else f"has been silent for {silent_s:.0f} s"
        cover = picture.gates.get(camera.gate)
        yield Cause(
            "camera", "camera_lost", "low" if cover and cover.covered else "medium", name,
            camera.gate, text=f"the camera {name} at {camera.gate} {why}", settle_s=1.0,
        )  # fmt: skip


def _an(words: str) -> str:
    return f"An {words}" if words[0] in "aeiou" else f"A {words}"
