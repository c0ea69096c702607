"""Step 3: the picture digested into what an operator would ask of it (paper, Step 4)."""

from collections.abc import Iterator

from pa_console.language.picture_facts import is_free, sole_covers
from pa_console.orchestrator.intake.alarm_causes import silence
from pa_console.schema.telemetry import AssetTelemetry, Digest, Picture, Selection, Track
from pa_console.schema.world import KINDS, World


def digest_picture(picture: Picture, world: World, selection: Selection | None = None) -> Digest:
    """Return cover per gate, free assets best first, sole covers, assets down or low, and tracks.

    An asset is free when it is available, not low on battery, not on a task for a track, and no
    gate depends on it alone; those that cover no gate come first, then the fullest battery, or what
    `selection` puts first. Of the rest of the picture, `selection` leaves out what it does not
    name.
    """
    gates = tuple(g for g in world.gates if selection is None or g in selection.gates)
    sole = sole_covers(picture)
    team = [
        asset
        for asset in picture.assets.values()
        if selection is None or asset.id in selection.assets
    ]
    up = [asset for asset in team if asset.available]
    free = [asset for asset in up if is_free(asset, set(sole.values()))]
    if selection is None:
        covering = {name for cover in picture.gates.values() for name in cover.by}
        free.sort(key=lambda asset: (asset.id in covering, -asset.battery_pct, asset.id))
    else:
        place = {name: index for index, name in enumerate(selection.assets)}
        free.sort(key=lambda asset: place[asset.id])
    tracks = [
        track
        for track in sorted(picture.tracks.values(), key=lambda t: (t.distance_m, t.id))
        if selection is None or track.id in selection.tracks
    ]
    down = [asset for asset in team if not asset.available and not silence(picture, asset)]
    return Digest(
        covered={gate: len(picture.gates[gate].by) for gate in gates},
        uncovered=tuple(gate for gate in gates if not picture.gates[gate].covered),
        free={kind: tuple(a.id for a in free if a.kind == kind) for kind in KINDS},
        sole_cover={gate: name for gate, name in sole.items() if gate in gates},
        posts={asset.id: _post(asset) for asset in up},
        down=tuple(asset.id for asset in down),
        stood={asset.id: asset.post for asset in down if asset.post in gates},
        unknown=tuple(_unknown(picture, gates, team)),
        low_battery=tuple(a.id for a in up if a.low_battery),
        degraded_comms=tuple(a.id for a in up if a.comms != "ok"),
        tracks=tuple(_track(picture, track) for track in tracks),
        selection=selection,
    )


def _unknown(picture: Picture, gates: tuple[str, ...], team: list[AssetTelemetry]) -> Iterator[str]:
    """Yield the gates of whose cover nothing certain is known, then the other such assets."""
    told: set[str] = set()
    for gate in gates:
        cover = picture.gates[gate]
        if cover.unknown:
            told.update(cover.unsure)
            unsure = [picture.assets[name] for name in cover.unsure if name in picture.assets]
            why = [why for asset in unsure if (why := silence(picture, asset))]
            yield ", ".join([f"{gate}: cover unknown", *why])
    for asset in team:
        if asset.id not in told and (why := silence(picture, asset)):
            yield why


def _post(asset: AssetTelemetry) -> str:
    if asset.at is not None and asset.at == asset.post:
        return f"{asset.kind} at {asset.at}"
    return f"{asset.kind} heading to {asset.post}" if asset.post else f"{asset.kind} en route"


def _track(picture: Picture, track: Track) -> str:
    where = "approaches" if track.status == "approaching" else f"{track.status} at"
    facts = [f"{track.kind} {where} {track.gate}", f"{track.distance_m:.0f} m"]
    known = track.identity != "unknown"
    if known or track.intent == "hostile":
        identity = track.identity if known else "not identified"
        facts.append(f"{identity}, intent {track.intent}")
    else:
        facts.append("not identified")
    if track.dispute:
        facts.append("identity disputed")
    facts.append("observed" if track.observed else "not observed")
    facts.append("warned" if track.warned else "not warned")
    if track.defiant:
        facts.append("went on in spite of it")
    if track.noncombatants:
        facts.append("noncombatants suspected")
    if track.stale:
        facts.append(f"last seen {picture.time_s - track.stamp_s:.0f} s ago")
    return f"{track.id}: {', '.join(facts)}"
