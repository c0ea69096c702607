"""Ground robots and tracks: identifying and warning at a gate (WF-01, ROE-02, CAP-03)."""

import math
from typing import Literal

from pa_console.sim.state import AssetState, Scene, TrackState
from pa_console.sim.terrain import Terrain

IDENTIFY_S = 4.0
WARN_S = 3.0

Ending = tuple[Literal["done", "failed"] | None, str]


def attend(
    terrain: Terrain, scene: Scene, asset: AssetState, verb: Literal["identify", "warn"], gate: str
) -> Ending:
    """Advance an `identify` or `warn` of an asset that stands at `gate`; None means not yet.

    It fails at once when no track is there or on its way, waits for one on its way to come within
    sensor range, and then needs a few seconds with it.
    """
    track = _choose(terrain, scene, asset, verb, gate)
    if track is None:
        return "failed", f"no track at {gate}"
    if _gap(terrain, asset, track) > terrain.world.platforms[asset.kind].sensor_range_m:
        asset.dwell = 0
        return None, ""
    asset.dwell += 1
    needed = IDENTIFY_S if verb == "identify" else WARN_S
    if asset.dwell * terrain.world.dt_s < needed:
        return None, ""
    if verb == "identify":
        track.identity, track.intent = track.truth, track.true_intent
        return "done", f"{track.id} is {track.identity}, intent {track.intent}"
    if not track.warned:
        track.warned, track.warned_tick = True, scene.tick
    return "done", f"warned {track.id}"


def _choose(
    terrain: Terrain, scene: Scene, asset: AssetState, verb: str, gate: str
) -> TrackState | None:
    """Return the track at `gate` to attend to: one that still needs it first, then the nearest."""
    here = [t for t in scene.tracks.values() if t.gate == gate and t.status != "leaving"]

    def rank(track: TrackState) -> tuple[bool, float, str]:
        done = track.identity != "unknown" if verb == "identify" else track.warned
        return done, _gap(terrain, asset, track), track.id

    return min(here, key=rank, default=None)


def _gap(terrain: Terrain, asset: AssetState, track: TrackState) -> float:
    point, _ = terrain.lanes[track.lane].locate(track.travelled)
    return math.dist(point, asset.position)
