"""Contacts and tracks of a forecast: built from what a picture shows, never from the truth."""

import math

import shapely

from pa_console.schema.telemetry import Picture, Track
from pa_console.sim.contacts.contacts import way_in
from pa_console.sim.sensing.evidence import weight_of
from pa_console.sim.state.scene import Scene
from pa_console.sim.state.sensing_state import ContactState, Sighting, Statement, TrackFile
from pa_console.sim.worlds.terrain import Terrain

USUAL_MPS = 5.0
"""The assumed speed of a contact of unknown speed once it moves."""


def restore(terrain: Terrain, scene: Scene, picture: Picture) -> None:
    """Set tracks, cameras and weather of a forecast's `scene` from `picture`.

    A contact stands or moves as last seen; unknown identity will be found unauthorized; one that is
    warned stops, one that has been seen to go on after its warning goes on.
    """
    state = scene.sensing
    state.weather = picture.weather
    state.broken = tuple(n for n, camera in picture.cameras.items() if not camera.works)
    for track in picture.tracks.values():
        state.contacts[track.id] = _contact(terrain, track)
        state.files[track.id] = _file(terrain, track)
    numbers = [int(n) for name in picture.tracks if (n := name.rpartition("_")[2]).isdigit()]
    state.numbered = state.spawned = max(numbers, default=0)


def _contact(terrain: Terrain, track: Track) -> ContactState:
    """Return the contact that a track suggests, on its gate's nearest lane unless it is inside."""
    inside = track.status == "inside"
    lanes = terrain.lanes_to(track.gate)
    lines = {name: shapely.LineString(terrain.world.lanes[name].points) for name in lanes}
    here = shapely.Point(track.position)
    lane = min(lanes, key=lambda name: lines[name].distance(here), default="")
    contact = ContactState(
        id=track.id,
        kind=track.kind,
        gate=track.gate,
        lane=lane,
        travelled=lines[lane].project(here) if lane else 0.0,
        x=track.position[0],
        y=track.position[1],
        heading=math.radians(track.heading_deg),
        cruise_mps=track.speed_mps or USUAL_MPS,
        identity="unauthorized" if track.identity == "unknown" else track.identity,
        intent=track.intent,
        when_warned="go_on" if track.defiant else "stop",
        noncombatants=track.noncombatants,
        speed=track.speed_mps,
        status=track.status,
        warned_tick=0 if track.warned and track.status != "leaving" else None,
        on_lane=not inside and bool(lane),
    )
    if inside and track.speed_mps > 0.0:
        contact.route = way_in(terrain, track.gate)[1:]
    return contact


def _file(terrain: Terrain, track: Track) -> TrackFile:
    """Return the station's file on a track as far as the picture shows it."""
    dt_s = terrain.world.dt_s
    heading = math.radians(track.heading_deg)
    stamp = round(track.stamp_s / dt_s)
    return TrackFile(
        id=track.id,
        contact=track.id,
        kind=track.kind,
        gate=track.gate,
        x=track.position[0],
        y=track.position[1],
        vx=track.speed_mps * math.cos(heading),
        vy=track.speed_mps * math.sin(heading),
        heading=heading,
        variance=max(track.uncertainty_m, 0.05) ** 2,
        speed_variance=1.0,
        tick=stamp,
        first_tick=round(track.first_seen_s / dt_s),
        status=track.status,
        leaning=track.status,
        leaning_tick=stamp,
        identified=track.identity,
        confirmed=track.intent,
        suspected=track.noncombatants,
        statements=tuple(
            Statement(name, weight_of(terrain, name), opinion="hostile", opinion_tick=stamp)
            for name in sorted(track.hostile_by)
        ),
        seen=tuple(Sighting(sensor, stamp, track.position) for sensor in track.seen_by),
        observed=track.observed,
        warned_tick=0 if track.warned else None,
        defiant=track.defiant,
    )
