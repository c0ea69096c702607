"""Which CoT type, after MIL-STD-2525, an asset and a track have.

The second part of a type is the affiliation. Hostile (`h`) is never given: on the map of somebody
else that may be read as a target, and what two sensors said of an intent is told in words.
"""

from typing import Literal

from pa_console.schema.telemetry import Track
from pa_console.schema.world import AssetKind

Affiliation = Literal["f", "n", "s", "u"]
AFFILIATIONS: dict[Affiliation, str] = {
    "f": "friend",
    "n": "neutral",
    "s": "suspect",
    "u": "unknown",
}
ASSET_TYPES: dict[AssetKind, str] = {
    "uav": "a-f-A-M-H-Q",
    "ugv": "a-f-G-E-V-U",
    "robot": "a-f-G-E-V",
}
"""A rotary-wing UAV, a utility vehicle, a ground vehicle; 2525 has no unmanned ground vehicle."""
TRACK_FUNCTIONS = {"vehicle": "G-E-V", "person": "G-U"}


def asset_type(kind: AssetKind) -> str:
    """Return the type of one of our assets."""
    return ASSET_TYPES[kind]


def affiliation(track: Track) -> Affiliation:
    """Return how a track stands to us, as far as `identify` and the sensors tell."""
    if track.intent == "hostile":
        return "s"
    if track.noncombatants:
        return "n"
    if track.identity == "authorized":
        return "f"
    if track.identity == "unauthorized":
        return "s"
    return "n" if track.intent == "benign" else "u"


def track_type(track: Track) -> str:
    """Return the type of a track."""
    return f"a-{affiliation(track)}-{TRACK_FUNCTIONS[track.kind]}"
