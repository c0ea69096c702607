"""The reliability of a report: one judgement for table, map and their order."""

from pa_console.schema.telemetry import (
    AssetTelemetry,
    CameraReport,
    GateCover,
    Picture,
    Track,
)
from pa_console.tui.status_words import Term, term

FINE = 9
"""The rank of a thing without trouble; lower is more urgent."""


class Reliance:
    """Judges the reports of one picture; older than `stale_s` seconds counts as unknown."""

    def __init__(self, picture: Picture, stale_s: float) -> None:
        self._now_s, self._stale_s = picture.time_s, stale_s

    def age(self, item: AssetTelemetry | Track | CameraReport) -> float:
        """Return the seconds since the report was sent, or the track was last detected."""
        return max(self._now_s - item.stamp_s, 0.0)

    def report(self, asset: AssetTelemetry) -> str:
        """Return suspect, silent, stale or fresh."""
        if asset.integrity == "suspect":
            return "suspect"
        if asset.comms == "lost":
            return "silent"
        return "stale" if asset.stale or self.age(asset) > self._stale_s else "fresh"

    def asset(self, asset: AssetTelemetry) -> Term:
        """Return the status to show: the report's unreliability goes before what it says."""
        state = self.report(asset)
        if asset.status == "failed":
            return term("asset", "failed")
        if state == "fresh":
            return term("asset", asset.status if asset.available else "down")
        mark = term("report", state)
        if state == "stale":
            return mark._replace(word=f"stale {self.age(asset):.0f} s")
        return mark

    def rank(self, asset: AssetTelemetry) -> int:
        """Return how urgently an asset needs an eye; the most urgent is 0."""
        state = self.report(asset)
        if asset.status == "failed" or (state == "fresh" and not asset.available):
            return 0
        if state != "fresh":
            return {"suspect": 1, "silent": 2, "stale": 3}[state]
        if asset.low_battery:
            return 4
        return FINE if (asset.status, asset.comms) == ("ok", "ok") else 5

    def lost(self, track: Track) -> bool:
        """Return whether a track's last detection is too old to rely on its place."""
        return track.stale or self.age(track) > self._stale_s

    def camera(self, camera: CameraReport) -> str:
        """Return works, failed or unknown."""
        if not camera.works:
            return "failed"
        return "unknown" if self.age(camera) > self._stale_s else "works"


def track_rank(track: Track) -> tuple[int, float]:
    """Return how urgently a track needs an eye: hostile, defiant, unidentified, then by distance.

    WF-04 has threat and proximity go first.
    """
    if track.intent == "hostile":
        return 0, track.distance_m
    if track.defiant:
        return 1, track.distance_m
    return {"unauthorized": 2, "unknown": 3, "authorized": 4}[track.identity], track.distance_m


def cover_state(cover: GateCover) -> str:
    """Return covered, uncovered or unknown."""
    return "covered" if cover.covered else "unknown" if cover.unknown else "uncovered"
