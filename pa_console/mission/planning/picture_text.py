"""Step 3: the digest of the picture; in a large world, only of its relevant part.

The prompt must not grow with the number of assets, so every list has a limit, and the omitted items
are counted. The digest of a small world is complete.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice

from pa_console.language.canonical.facts import is_free, sole_covers
from pa_console.language.name_linking import named, names_meant
from pa_console.schema.base import Point
from pa_console.schema.mission import Mission
from pa_console.schema.rule import Rule
from pa_console.schema.telemetry import AssetTelemetry, Digest, Picture, Selection, Track
from pa_console.schema.world import KINDS, World

SMALL_ASSETS, SMALL_GATES = 16, 8
MOST_GATES, MOST_TRACKS, MOST_FRAMES = 10, 8, 16
MOST_ASSETS, SPARES_PER_KIND = 24, 3
COVERS_PER_GATE = 2
MOST_MEANT = 6
MOST_LOW = 3
LESS = (0.75, 0.5, 0.25)
"""The factors for the limits above that are tried in turn until the prompt is small enough."""

Pick = tuple[str, str]
"""The name of an asset, gate or track, and the reason why it is selected."""


def silence(picture: Picture, asset: AssetTelemetry) -> str:
    """Return why the state of an asset is uncertain; '' if it is certain.

    A failed asset is certain to be down.
    """
    if asset.status == "failed":
        return ""
    if asset.integrity == "suspect":
        return f"{asset.id} sends suspect telemetry"
    if asset.comms == "lost" or asset.stale:
        return f"{asset.id} silent for {picture.time_s - asset.stamp_s:.0f} s"
    return ""


def digest_picture(picture: Picture, world: World, selection: Selection | None = None) -> Digest:
    """Return the digest: cover by gate, free assets (best first), sole covers, assets, tracks.

    An asset is free if it is available, not low on battery, not on a task for a track, and not the
    only cover of a gate. With a `selection`, only its assets, gates and tracks are included, and
    free assets are in its order. Otherwise free assets that cover no gate come first, those with
    the fullest battery first.
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
    """Describe the gates with uncertain cover, then other assets in an uncertain state."""
    reported: set[str] = set()
    for gate in gates:
        cover = picture.gates[gate]
        if cover.unknown:
            reported.update(cover.unsure)
            unsure = [picture.assets[name] for name in cover.unsure if name in picture.assets]
            why = [why for asset in unsure if (why := silence(picture, asset))]
            yield ", ".join([f"{gate}: cover unknown", *why])
    for asset in team:
        if asset.id not in reported and (why := silence(picture, asset)):
            yield why


def _post(asset: AssetTelemetry) -> str:
    if asset.at is not None and asset.at == asset.post:
        return f"{asset.kind} at {asset.at}"
    return f"{asset.kind} heading to {asset.post}" if asset.post else f"{asset.kind} en route"


def _track(picture: Picture, track: Track) -> str:
    movement = "approaches" if track.status == "approaching" else f"{track.status} at"
    facts = [f"{track.kind} {movement} {track.gate}", f"{track.distance_m:.0f} m"]
    identified = track.identity != "unknown"
    if identified or track.intent == "hostile":
        identity = track.identity if identified else "not identified"
        facts.append(f"{identity}, intent {track.intent}")
    else:
        facts.append("not identified")
    if track.dispute:
        facts.append("identity disputed")
    facts.append("observed" if track.observed else "not observed")
    facts.append("warned" if track.warned else "not warned")
    if track.defiant:
        facts.append("went on in spite of it")
    if track.emergency:
        facts.append("emergency vehicle")
    if track.noncombatants:
        facts.append("noncombatants suspected")
    if track.stale:
        facts.append(f"last seen {picture.time_s - track.stamp_s:.0f} s ago")
    return f"{track.id}: {', '.join(facts)}"


def is_small(world: World) -> bool:
    """Return whether the picture of `world` is small enough for every prompt."""
    return len(world.assets) <= SMALL_ASSETS and len(world.gates) <= SMALL_GATES


def select(
    picture: Picture,
    world: World,
    mission: Mission,
    rules: Sequence[Rule],
    share: float = 1.0,
) -> Selection | None:
    """Return the part of the picture for the prompt of `mission`; None for all of a small world.

    `rules` are those retrieved for the mission; their tags determine whether assets with low
    batteries elsewhere are included. A `share` below 1 lowers the limits, even in a small world.
    """
    if share == 1.0 and is_small(world):
        return None
    tracks = _bounded(_tracks(picture, mission), round(share * MOST_TRACKS))
    named_assets = set(named(world.assets, mission.text)) | {mission.subject or ""}
    own = [name for name in picture.assets if name in named_assets]
    gates = _bounded(_gates(picture, world, mission, own, tracks), round(share * MOST_GATES))
    most, per_kind = round(share * MOST_ASSETS), round(share * SPARES_PER_KIND)
    spares = list(_spares(picture, world, gates, per_kind))
    tags = {tag for rule in rules for tag in rule.tags}
    concerned = _concerned(picture, own, gates, wants_low="battery" in tags)
    assets = _bounded(concerned, most - len(KINDS) * per_kind)
    assets = _bounded([*assets.items(), *spares], most)
    return Selection(
        gates=gates,
        tracks=tracks,
        assets=assets,
        frames=_frames(world, mission, gates)[: round(share * MOST_FRAMES)],
        left_out={
            "gates": len(picture.gates) - len(gates),
            "tracks": len(picture.tracks) - len(tracks),
            "assets": len(picture.assets) - len(assets),
        },
    )


def _bounded(picks: Iterable[Pick], most: int) -> dict[str, str]:
    """Return the first `most` distinct names, each with its first reason."""
    chosen: dict[str, str] = {}
    for name, why in picks:
        if len(chosen) == most and name not in chosen:
            break
        chosen.setdefault(name, why)
    return chosen


def _tracks(picture: Picture, mission: Mission) -> Iterator[Pick]:
    """Yield the mission's own tracks, then the others by threat and proximity (WF-04)."""
    named_tracks = {*named(picture.tracks, mission.text), mission.subject}
    yield from ((name, "named in the mission") for name in picture.tracks if name in named_tracks)
    for track in sorted(picture.tracks.values(), key=_threat):
        yield track.id, f"{_rank_word(track)}, {track.distance_m:.0f} m from {track.gate}"


def _threat(track: Track) -> tuple[int, float, str]:
    ranks = ("hostile", "defiant", "unknown", "unauthorized", "benign", "authorized", "leaving")
    return ranks.index(_rank_word(track)), track.distance_m, track.id


def _rank_word(track: Track) -> str:
    """Return the word by which a track is ranked, such as `hostile` or `leaving`."""
    if track.intent == "hostile":
        return "hostile"
    if track.defiant:
        return "defiant"
    if track.status == "leaving":
        return "leaving"
    return "benign" if track.intent == "benign" else track.identity


def _gates(
    picture: Picture, world: World, mission: Mission, own: Iterable[str], tracks: Iterable[str]
) -> Iterator[Pick]:
    """Yield the gates that the mission concerns, then those without known cover."""
    yield from ((gate, "named in the mission") for gate in named(world.gates, mission.text))
    if mission.gate in picture.gates:
        yield mission.gate, "the mission is about it"
    if mission.subject in picture.gates:
        yield mission.subject, "the mission is about it"
    for name in own:
        post = picture.assets[name].post
        if post in picture.gates:
            yield post, f"{name} is posted to it"
    alike = names_meant(world.gates, mission.text)[:MOST_MEANT]
    yield from ((gate, "meant in the mission") for gate in alike)
    for name in tracks:
        gate = picture.tracks[name].gate
        if gate in picture.gates:
            yield gate, f"{name} is there"
    for gate, cover in picture.gates.items():
        if not cover.covered:
            yield gate, "its cover is unknown" if cover.unknown else "it is not covered"


def _concerned(
    picture: Picture, own: Iterable[str], gates: Iterable[str], *, wants_low: bool
) -> Iterator[Pick]:
    """Yield the assets that the mission names, then a few at each of its gates."""
    yield from ((name, "named in the mission") for name in own)
    chosen = tuple(gates)
    for rank in range(COVERS_PER_GATE):
        for gate in chosen:
            yield from ((n, f"covers {gate}") for n in picture.gates[gate].by[rank : rank + 1])
    posted: dict[str, list[AssetTelemetry]] = {gate: [] for gate in chosen}
    for asset in picture.assets.values():
        if asset.post in posted and (asset.low_battery or not asset.available):
            posted[asset.post].append(asset)
    for gate, assets in posted.items():
        for asset in assets[:COVERS_PER_GATE]:
            yield asset.id, f"{_trouble(picture, asset)}, posted to {gate}"
    if wants_low:
        low = (asset for asset in picture.assets.values() if asset.available and asset.low_battery)
        yield from ((asset.id, "low battery") for asset in islice(low, MOST_LOW))


def _trouble(picture: Picture, asset: AssetTelemetry) -> str:
    if silence(picture, asset):
        return "nothing certain is known of it"
    return "low battery" if asset.available else "down"


def _spares(picture: Picture, world: World, gates: Iterable[str], per_kind: int) -> Iterator[Pick]:
    """Yield the free assets nearest to the concerned gates, one of each kind in turn.

    Without a concerned gate, the fullest batteries come first. Assets that help to cover a gate
    come last.
    """
    goals = [world.frames[gate].at for gate in gates]
    sole = {*sole_covers(picture).values()}
    covering = {name for cover in picture.gates.values() for name in cover.by}

    def order(asset: AssetTelemetry) -> tuple[bool, float, float, str]:
        way = _least(asset.position, goals)
        return asset.id in covering, way, -asset.battery_pct, asset.id

    free = sorted((a for a in picture.assets.values() if is_free(a, sole)), key=order)
    kinds = [[a for a in free if a.kind == kind][:per_kind] for kind in KINDS]
    for turn in range(per_kind):
        for assets in kinds:
            for asset in assets[turn : turn + 1]:
                way = f", {_least(asset.position, goals):.0f} m away" if goals else ""
                yield asset.id, f"free {asset.kind}{way}"


def _least(position: Point, goals: Sequence[Point]) -> float:
    return min((math.dist(position, goal) for goal in goals), default=0.0)


def _frames(world: World, mission: Mission, gates: Iterable[str]) -> tuple[str, ...]:
    """Return the concerned gates, the base, and the posts, those named in the mission first."""
    posts = [name for name, frame in world.frames.items() if frame.kind == "post"]
    frames = [*gates, world.base, *names_meant(posts, mission.text), *posts]
    return tuple(dict.fromkeys(frames))
