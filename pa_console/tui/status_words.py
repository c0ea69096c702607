"""Status words and their colours, short names of assets, and the reliability of reports.

The table, the map and the sort order use the same test of reliability.
"""

import re
from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

from textual.content import Content

from pa_console.schema.telemetry import AssetTelemetry, CameraReport, GateCover, Picture, Track
from pa_console.schema.world import AssetKind
from pa_console.views.status_words import STATUSES, Tone, status_of

GOOD, BAD, WARN = "$text-success", "$text-error", "$text-warning"
CALM, QUIET, NOTE = "$text-primary", "$quiet", "$text-accent"
STYLES: dict[Tone, str] = {
    "": "",
    "good": GOOD,
    "bad": BAD,
    "warn": WARN,
    "calm": CALM,
    "quiet": QUIET,
    "note": NOTE,
}

KIND_WORDS: dict[AssetKind, str] = {"uav": "UAV", "ugv": "UGV", "robot": "ground robot"}
FINE = 9
"""The rank of an asset without trouble; a lower rank is more urgent."""


class Term(NamedTuple):
    """The symbol, word and colour of one status, the same on every screen."""

    glyph: str
    word: str
    style: str

    @property
    def part(self) -> tuple[str, str]:
        """The glyph and the word, with their style."""
        return f"{self.glyph} {self.word}", self.style

    @property
    def content(self) -> Content:
        """The glyph and the word, coloured."""
        return Content.styled(*self.part)


def term(family: str, value: str) -> Term:
    """Return the term for `value` of `family`; a value without an entry is shown as unknown."""
    glyph, word, tone = status_of(family, value)
    return Term(glyph, word, STYLES[tone])


TERMS = {name: term(*name.split(".", 1)) for name in STATUSES}
"""All status words, for the page that explains them."""


def short_names(names: Iterable[str]) -> dict[str, str]:
    """Return a letter and a number as the name of each asset, such as `D1` for `Drone_T01`.

    If a number is missing or two names would be the same, each letter is numbered from 1.
    """
    names = tuple(names)
    first = {name: name[:1].upper() + _number(name) for name in names}
    counts = Counter(first.values())
    if all(_number(name) for name in names) and max(counts.values(), default=0) <= 1:
        return first
    seen: Counter[str] = Counter()
    result: dict[str, str] = {}
    for name in names:
        letter = name[:1].upper()
        seen[letter] += 1
        result[name] = f"{letter}{seen[letter]}"
    return result


def _number(name: str) -> str:
    match = re.search(r"(\d+)$", name)
    return str(int(match[1])) if match else ""


def track_names(names: Iterable[str]) -> dict[str, str]:
    """Return the number at the end of each track's name, or its position if that is not unique."""
    names = tuple(names)
    numbers = [_number(name) for name in names]
    if all(numbers) and len(set(numbers)) == len(numbers):
        return dict(zip(names, numbers, strict=True))
    return {name: str(place) for place, name in enumerate(names, start=1)}


class Reliance:
    """The reliability of the reports of one picture; `stale_s` is the age limit in seconds."""

    def __init__(self, picture: Picture, stale_s: float) -> None:
        self._now_s, self._stale_s = picture.time_s, stale_s
        self._not_ready = picture.not_ready

    def age(self, item: AssetTelemetry | Track | CameraReport) -> float:
        """Return the seconds since the report was sent, or the track was last detected."""
        return max(self._now_s - item.stamp_s, 0.0)

    def report(self, asset: AssetTelemetry) -> str:
        """Return the condition of a report: suspect, silent, stale or fresh."""
        if asset.integrity == "suspect":
            return "suspect"
        if asset.comms == "lost":
            return "silent"
        return "stale" if asset.stale or self.age(asset) > self._stale_s else "fresh"

    def asset(self, asset: AssetTelemetry) -> Term:
        """Return the status to show; for an unreliable report, it is the report's condition."""
        state = self.report(asset)
        if asset.status == "failed":
            return term("asset", "failed")
        if state == "fresh" and asset.manual:
            return term("asset", "manual")
        if asset.id in self._not_ready:
            return term("asset", "unready")
        if state == "fresh":
            return term("asset", asset.status if asset.available else "down")
        mark = term("report", state)
        if state == "stale":
            return mark._replace(word=f"stale {self.age(asset):.0f} s")
        return mark

    def rank(self, asset: AssetTelemetry) -> int:
        """Return the urgency of an asset; 0 is the most urgent."""
        state = self.report(asset)
        down = not (asset.available or asset.manual)
        if asset.status == "failed" or (state == "fresh" and down):
            return 0
        if state != "fresh":
            return {"suspect": 1, "silent": 2, "stale": 3}[state]
        if asset.manual or asset.id in self._not_ready:
            return 4
        if asset.low_battery:
            return 4
        return FINE if (asset.status, asset.comms) == ("ok", "ok") else 5

    def lost(self, track: Track) -> bool:
        """Return whether a track's last detection is too old for its position to be reliable."""
        return track.stale or self.age(track) > self._stale_s

    def camera(self, camera: CameraReport) -> str:
        """Return the state of a camera: works, failed or unknown."""
        if not camera.works:
            return "failed"
        return "unknown" if self.age(camera) > self._stale_s else "works"


def track_rank(track: Track) -> tuple[int, float]:
    """Return the urgency of a track: hostile, defiant, unidentified, then by distance.

    Rule WF-04 puts threat and proximity first.
    """
    if track.intent == "hostile":
        return 0, track.distance_m
    if track.defiant:
        return 1, track.distance_m
    return {"unauthorized": 2, "unknown": 3, "authorized": 4}[track.identity], track.distance_m


def cover_state(cover: GateCover) -> str:
    """Return the state of a gate's cover: covered, uncovered or unknown."""
    return "covered" if cover.covered else "unknown" if cover.unknown else "uncovered"
