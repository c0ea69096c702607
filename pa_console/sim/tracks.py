"""Tracks: vehicles and persons that come down a lane, wait, are warned and leave."""

import math

from pa_console.schema.incident import SpawnTrack
from pa_console.sim.lanes import QUEUE_GAP_M
from pa_console.sim.state import Scene, TrackState
from pa_console.sim.terrain import Terrain

COMPLIES_AFTER_S = 2.0
_STOPPED_MPS = 0.05


def spawn(terrain: Terrain, scene: Scene, incident: SpawnTrack) -> TrackState:
    """Put a new track on a lane of its gate, behind whatever is already there.

    It starts `distance_m` from the gate, but never nearer than where tracks wait. Raises
    ValueError when no lane leads to the gate.
    """
    lanes = terrain.lanes_to(incident.gate)
    if not lanes:
        known = ", ".join(sorted({lane.gate for lane in terrain.world.lanes.values()})) or "none"
        raise ValueError(f"no lane leads to {incident.gate!r}; gates with a lane: {known}")
    lane = lanes[0] if len(lanes) == 1 else scene.rng.choice(lanes)
    line = terrain.lanes[lane]
    start = 0.0 if incident.distance_m is None else line.first_within(incident.distance_m)
    ahead = [t.travelled - QUEUE_GAP_M for t in scene.tracks.values() if t.lane == lane]
    scene.spawned += 1
    track = TrackState(
        id=f"Track_{scene.spawned:02d}",
        kind=incident.track,
        gate=incident.gate,
        lane=lane,
        travelled=max(0.0, min([start, line.waiting_m, *ahead])),
        cruise_mps=incident.speed_mps,
        truth=incident.identity,
        true_intent=incident.intent,
        obeys=incident.when_warned != "go_on",
    )
    scene.tracks[track.id] = track
    return track


def advance(terrain: Terrain, scene: Scene, dt_s: float) -> None:
    """Move every track by one step; one that has left by the far end of its lane is gone."""
    for track in list(scene.tracks.values()):
        if track.warned and track.obeys and track.status != "leaving":
            track.speed, track.status = 0.0, "stopped"
            if (scene.tick - track.warned_tick) * dt_s >= COMPLIES_AFTER_S:
                track.status = "leaving"
        elif track.status == "leaving":
            track.speed = track.cruise_mps
            track.travelled -= track.speed * dt_s
            if track.travelled <= 0.0:
                del scene.tracks[track.id]
        else:
            _approach(terrain, scene, track, dt_s)


def _approach(terrain: Terrain, scene: Scene, track: TrackState, dt_s: float) -> None:
    """Drive on until the waiting point, the track in front, or a ground asset in the way."""
    line = terrain.lanes[track.lane]
    limit = line.waiting_m
    for other in scene.tracks.values():
        in_front = other.travelled > track.travelled or (
            other.travelled == track.travelled and other.id < track.id
        )
        if other is not track and other.lane == track.lane and in_front:
            limit = min(limit, other.travelled - QUEUE_GAP_M)
    step = min(track.cruise_mps * dt_s, max(0.0, limit - track.travelled))
    if step > 0.0 and _in_the_way(terrain, scene, track, track.travelled + step):
        step = 0.0
    track.travelled += step
    track.speed = step / dt_s
    track.status = "approaching" if track.speed > _STOPPED_MPS else "stopped"


def _in_the_way(terrain: Terrain, scene: Scene, track: TrackState, to: float) -> bool:
    """Return whether driving on would come nearer to a ground asset than the standoff."""
    line = terrain.lanes[track.lane]
    here, there = line.locate(track.travelled)[0], line.locate(to)[0]
    reach = terrain.world.standoff_m + 0.2
    return any(
        math.dist(asset.position, there) < min(reach, math.dist(asset.position, here))
        for asset in scene.assets.values()
        if asset.kind != "uav"
    )
