"""Whether the condition of an order holds in a picture: what an `if` of the operator comes to."""

from pa_console.orchestrator.planning.digest import is_free
from pa_console.orders.condition import Condition
from pa_console.orders.order import Ask, Order
from pa_console.schema.telemetry import Picture, Track
from pa_console.schema.world import AssetKind


def holds(condition: Condition, picture: Picture) -> bool:  # noqa: PLR0911
    """Return whether `condition` is so; nothing is so of what is not there or not known."""
    subject = condition.subject
    cover, asset = picture.gates.get(subject), picture.assets.get(subject)
    match condition.fact:
        case "track_at":
            return bool(tracks_at(picture, subject, condition.track))
        case "no_track_at":
            return not tracks_at(picture, subject, condition.track)
        case "authorized" | "unauthorized" | "hostile":
            return deciding_track(condition, picture) is not None
        case "uncovered":
            return cover is not None and not cover.covered
        case "covered":
            return cover is not None and cover.covered
        case "low":
            return asset is not None and asset.low_battery
        case "not_low":
            return asset is not None and not asset.low_battery
        case "down":
            return asset is not None and not asset.available
        case "up":
            return asset is not None and asset.available
        case "free":
            return _some_free(picture, condition.kind)
        case "none_free":
            return not _some_free(picture, condition.kind)


def deciding_track(condition: Condition, picture: Picture) -> Track | None:
    """Return the track that makes a condition about who is there true."""
    for track in tracks_at(picture, condition.subject, condition.track):
        if condition.fact in (track.identity, track.intent):
            return track
    return None


def _some_free(picture: Picture, kind: AssetKind | None) -> bool:
    """Return whether an asset of `kind` may be sent somewhere."""
    alone = {cover.by[0] for cover in picture.gates.values() if len(cover.by) == 1}
    team = (asset for asset in picture.assets.values() if kind in (None, asset.kind))
    return any(is_free(asset, alone) for asset in team)


def due_asks(order: Order, picture: Picture) -> tuple[Ask, ...]:
    """Return the asks that apply now; none when the order has nothing to say for this case."""
    if order.condition is None or holds(order.condition, picture):
        return order.asks
    return order.otherwise


def tracks_at(picture: Picture, place: str, kind: str = "") -> list[Track]:
    """Return the tracks at a gate that do not leave, of `kind` if given, the most urgent first."""
    here = [
        track
        for track in picture.tracks.values()
        if track.gate == place and track.status != "leaving" and kind in ("", track.kind)
    ]
    return sorted(here, key=lambda t: (t.intent != "hostile", t.distance_m, t.id))
