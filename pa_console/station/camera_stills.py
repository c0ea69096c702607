"""Camera stills of tracks for the operator.

While a plan waits, and a track that it concerns is in view of a camera, a still is taken every
RETAKE_S seconds. Stills are only for the operator: the planner, the rules, the rehearsal and the
judge do not use them, and no plan waits for them.
"""

import asyncio
import hashlib
import math
import re
from collections.abc import Callable
from pathlib import Path
from time import monotonic

from pa_console.fleets.fleet import Filmed, Fleet, RelaysImages
from pa_console.fleets.snapshot import SnapshotError, fetch_snapshot
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Mission
from pa_console.schema.telemetry import Picture, Track
from pa_console.session.stills import keep_still

RETAKE_S, MOST_TAKEN = 10.0, 12
"""The seconds between two stills for one plan, and the largest number of stills for one plan."""
FRESH_S = 3.0
"""The age up to which an existing still is shown instead of a new one, in seconds."""


def _ends(payload: ev.EventPayload) -> bool:
    """Return whether a mission's plan no longer waits after this event."""
    if isinstance(payload, ev.DecisionMade):
        return payload.accepted
    return isinstance(payload, ev.PlanVoided | ev.MissionPreempted | ev.MissionFinished)


def tracks_of(request: ev.ApprovalRequested, mission: Mission, picture: Picture) -> list[Track]:
    """Return the tracks that a plan concerns, the nearest to its gate first.

    These are the track of the mission, or else the tracks named in the texts of mission and plan,
    or else the tracks at their gates.
    """
    if mission.subject in picture.tracks:
        return [picture.tracks[mission.subject]]
    text = f"{mission.text} {request.asked} {request.plan.reason}"
    words = set(re.findall(r"\w+", text))
    named = [track for name, track in picture.tracks.items() if name in words]
    places = {action.target for action in request.plan.actions} | {mission.gate}
    there = named or [track for track in picture.tracks.values() if track.gate in places]
    return sorted(there, key=lambda track: track.distance_m)


def camera_of(fleet: Fleet, picture: Picture, track: Track) -> str | None:
    """Return the nearest camera that has `track` in view; None if there is none.

    A camera has the track in view if it has a snapshot address and covers or detects the track. If
    the fleet renders stills, so does every working camera that detects the track.
    """
    cameras, drawn = fleet.world.cameras, isinstance(fleet, Filmed)

    def sees(name: str) -> bool:
        report, camera = picture.cameras.get(name), cameras[name]
        if camera.snapshot is not None:
            return name in track.seen_by or camera.covers(track.position)
        return drawn and name in track.seen_by and report is not None and report.works

    def away(name: str) -> float:
        return math.dist(cameras[name].at, track.position)

    return min(filter(sees, cameras), key=away, default=None)


class CameraStills:
    """The stills of one session, which are stored beside its log."""

    def __init__(self, fleet: Fleet, log: Path, emit: Callable[..., None]) -> None:
        """Pass each still to `emit`, with the id of its mission if it has one."""
        self._fleet, self._log, self._emit = fleet, log, emit
        self._watched = ""
        self._watching: asyncio.Task[None] | None = None
        self._last: dict[str, tuple[float, ev.CameraStill]] = {}
        self._over = False

    def see(self, payload: ev.EventPayload, mission: Mission | None) -> None:
        """Begin to take stills for a waiting plan of `mission`, or stop when the wait ends."""
        if isinstance(payload, ev.ApprovalRequested) and mission is not None:
            self._stop()
            self._watched = mission.id
            self._watching = asyncio.create_task(self._watch(payload, mission))
        elif isinstance(payload, ev.SessionEnded):
            self._over = True
            self._stop()
        elif mission is not None and mission.id == self._watched and _ends(payload):
            self._stop()

    def _stop(self) -> None:
        if self._watching is not None:
            self._watching.cancel()
        self._watching, self._watched = None, ""

    async def _watch(self, request: ev.ApprovalRequested, mission: Mission) -> None:
        track = ""
        for _ in range(MOST_TAKEN):
            picture = self._fleet.picture()
            if track not in picture.tracks:
                concerned = tracks_of(request, mission, picture)
                seen = (item.id for item in concerned if camera_of(self._fleet, picture, item))
                track = next(seen, "")
            if track:
                await self._take(track, mission.id)
            await asyncio.sleep(RETAKE_S)

    async def take(self, track: str) -> ev.CameraStill | None:
        """Return a recent or new still of a track; None if no camera has the track in view."""
        taken_at, last = self._last.get(track, (0.0, None))
        if last is not None and monotonic() - taken_at < FRESH_S:
            return last
        return await self._take(track, None)

    async def _take(self, track: str, mission: str | None) -> ev.CameraStill | None:
        """Take, store and emit a still; if this fails, emit a still that has only the problem."""
        picture = self._fleet.picture()
        seen = picture.tracks.get(track)
        camera = camera_of(self._fleet, picture, seen) if seen is not None else None
        if camera is None:
            return None
        still = ev.CameraStill(track=track, camera=camera, taken_s=self._fleet.time_s)
        try:
            content = await self._image(camera, track)
            taken = {
                "sha256": hashlib.sha256(content).hexdigest(),
                "format": "png" if content.startswith(b"\x89PNG") else "jpg",
            }
            still = still.model_copy(update=taken)
            await asyncio.to_thread(keep_still, self._log, content, still)
        except Exception as error:  # a still must not end the session
            still = still.model_copy(update={"sha256": None, "problem": _problem(error)})
        if not self._over:
            known_still = self._last.items()
            self._last = {name: last for name, last in known_still if name in picture.tracks}
            self._last[track] = monotonic(), still
            self._emit(still, mission)
        return still

    async def _image(self, camera: str, track: str) -> bytes:
        """Return an image from the camera, without blocking other tasks."""
        spec = self._fleet.world.cameras[camera]
        if spec.image_topic:
            if not isinstance(self._fleet, RelaysImages):
                raise SnapshotError("needs a link to ROS 2: --fleet ros2:FILE")
            return await asyncio.to_thread(self._fleet.image_on, spec.image_topic)
        if spec.snapshot is not None:
            return await fetch_snapshot(spec.snapshot)
        make = self._fleet.still(camera, track) if isinstance(self._fleet, Filmed) else None
        if make is None:
            raise SnapshotError("gives no image")
        return await asyncio.to_thread(make)


def _problem(error: Exception) -> str:
    """Return the reason why there is no still."""
    match error:
        case SnapshotError():
            return str(error)
        case OSError():
            return f"its still cannot be stored: {error.strerror or type(error).__name__}"
        case _:
            return f"its still cannot be made: {type(error).__name__}"
