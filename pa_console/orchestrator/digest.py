"""Step 3: the picture digested into what an operator would ask of it (paper, Step 4)."""

from pa_console.schema.telemetry import AssetTelemetry, Digest, Picture, Track
from pa_console.schema.world import AssetKind, World

KINDS: tuple[AssetKind, ...] = ("uav", "ugv", "robot")


def digest_picture(picture: Picture, world: World) -> Digest:
    """Return cover per gate, free assets best first, sole covers, assets down or low, and tracks.

    An asset is free when it is available, not low on battery, not on a task for a track, and no
    gate depends on it alone; the fullest battery comes first.
    """
    sole = {gate: cover.by[0] for gate, cover in picture.gates.items() if len(cover.by) == 1}
    up = [asset for asset in picture.assets.values() if asset.available]
    free = [asset for asset in up if _is_free(asset, set(sole.values()))]
    free.sort(key=lambda asset: (-asset.battery_pct, asset.id))
    return Digest(
        covered={gate: len(picture.gates[gate].by) for gate in world.gates},
        uncovered=tuple(gate for gate in world.gates if not picture.gates[gate].covered),
        free={kind: tuple(a.id for a in free if a.kind == kind) for kind in KINDS},
        sole_cover=sole,
        posts={asset.id: _post(asset) for asset in up},
        down=tuple(a.id for a in picture.assets.values() if not a.available),
        low_battery=tuple(a.id for a in up if a.low_battery),
        degraded_comms=tuple(a.id for a in up if a.comms != "ok"),
        tracks=tuple(
            _track(track)
            for track in sorted(picture.tracks.values(), key=lambda t: (t.distance_m, t.id))
        ),
    )


def _is_free(asset: AssetTelemetry, sole_covers: set[str]) -> bool:
    busy = asset.task in ("identifying", "warning", "blocking", "charging")
    return not busy and not asset.low_battery and asset.id not in sole_covers


def _post(asset: AssetTelemetry) -> str:
    if asset.at is not None and asset.at == asset.post:
        return f"{asset.kind} at {asset.at}"
    return f"{asset.kind} heading to {asset.post}" if asset.post else f"{asset.kind} en route"


def _track(track: Track) -> str:
    where = "approaches" if track.status == "approaching" else f"{track.status} at"
    facts = [f"{track.kind} {where} {track.gate}", f"{track.distance_m:.0f} m"]
    known = track.identity != "unknown"
    facts.append(f"{track.identity}, intent {track.intent}" if known else "not identified")
    facts.append("observed" if track.observed else "not observed")
    facts.append("warned" if track.warned else "not warned")
    return f"{track.id}: {', '.join(facts)}"
