"""The facts in a picture that orders depend on: free assets, and the places of tracks."""

from collections.abc import Collection
from dataclasses import dataclass

from pa_console.language.condition import Condition, holds
from pa_console.language.order import Ask, Order
from pa_console.schema.command import BUSY_TASKS
from pa_console.schema.telemetry import AssetTelemetry, Picture, Track
from pa_console.schema.world import AssetKind


def is_free(asset: AssetTelemetry, sole_covers: Collection[str]) -> bool:
    """Return whether an asset may leave without uncovering a gate or giving up its task."""
    busy = asset.task in BUSY_TASKS
    return asset.available and not busy and not asset.low_battery and asset.id not in sole_covers


def sole_covers(picture: Picture) -> dict[str, str]:
    """Return the gates that one asset alone covers, each with that asset."""
    return {gate: cover.by[0] for gate, cover in picture.gates.items() if len(cover.by) == 1}


def tracks_at(picture: Picture, place: str, kind: str = "") -> list[Track]:
    """Return the tracks at a gate that do not leave, of `kind` if given, the most urgent first."""
    here = [
        track
        for track in picture.tracks.values()
        if track.gate == place and track.status != "leaving" and kind in ("", track.kind)
    ]
    return sorted(here, key=lambda t: (t.intent != "hostile", t.distance_m, t.id))


@dataclass(frozen=True)
class PictureFacts:
    """The facts of a picture; None for gates and assets that are not in it."""

    picture: Picture

    def tracks(self, gate: str) -> list[Track]:
        """Return the tracks at a gate that do not leave, the most urgent first."""
        return tracks_at(self.picture, gate)

    def is_covered(self, gate: str) -> bool | None:
        """Return whether a gate has a guard."""
        cover = self.picture.gates.get(gate)
        return None if cover is None else cover.covered

    def is_low(self, asset: str) -> bool | None:
        """Return whether the battery of an asset is low."""
        found = self.picture.assets.get(asset)
        return None if found is None else found.low_battery

    def is_up(self, asset: str) -> bool | None:
        """Return whether an asset works."""
        found = self.picture.assets.get(asset)
        return None if found is None else found.available

    def has_free(self, kind: AssetKind | None) -> bool:
        """Return whether an asset of a kind, or any, may be sent somewhere."""
        alone = {*sole_covers(self.picture).values()}
        team = (asset for asset in self.picture.assets.values() if kind in (None, asset.kind))
        return any(is_free(asset, alone) for asset in team)


def is_so(condition: Condition, picture: Picture) -> bool:
    """Return whether `condition` is so; nothing is so of what is not there or not known."""
    return holds(condition, PictureFacts(picture)) is True


def due_asks(order: Order, picture: Picture) -> tuple[Ask, ...]:
    """Return the asks that apply now; none when the order has nothing to say for this case."""
    if order.condition is None or is_so(order.condition, picture):
        return order.asks
    return order.otherwise
