"""Moments: the part of a picture that ordering rules see.

`Pursuits` adds the one fact that no single picture shows: how often a track was followed.
"""

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

from pa_console.schema.command import ADDRESSING, ATTENDING, COMMANDS
from pa_console.schema.rehearsal import Moment, OrderMoment, TrackMoment
from pa_console.schema.telemetry import AssetTelemetry, Picture, Track
from pa_console.schema.world import World

STANDS_MPS = 0.05
"""The speed below which an asset counts as standing still."""

SURE_SIGMAS = 3.0
"""The position error, in sigmas, that is added to a gap before it is compared with the standoff."""

MOST_BLOCKED = 1
"""The number of blocked gates above which a track inside counts as shut in (ROE-12)."""

PURSUIT_S = 3600.0
"""Simulated seconds after which a pursuit of a track is forgotten."""


class _OrderedAsset(NamedTuple):
    """A ground asset with its order; `gates` are the gates of the world."""

    order: OrderMoment
    asset: AssetTelemetry
    gates: frozenset[str]
    world: World

    def meets(self, track: Track) -> bool:
        """Return whether the order leads to the track, at its gate or inside the perimeter."""
        if self.order.target in self.gates:
            return self.order.target == track.gate
        return self.order.target is not None and track.status == "inside"


def moment(
    picture: Picture, world: World, orders: Sequence[OrderMoment], agents: Collection[str] = ()
) -> Moment:
    """Return the facts of `picture` that ordering rules see while `orders` are carried out.

    Only assets with an order are examined; `agents`, those of the plan, are needed for `up`. A
    stale track keeps its last known facts.
    """
    gates = frozenset(world.gates)
    ground = [
        _OrderedAsset(order, asset, gates, world)
        for order in orders
        if order.kind != "uav" and (asset := picture.assets.get(order.agent)) is not None
    ]
    tracks = picture.tracks
    threats = [(name, track.gate) for name, track in tracks.items() if _hostile(track)]
    inside = any(track.status == "inside" for track in tracks.values())
    blocks = [order.target for order in orders if order.verb == "block"]
    shut = inside and ways_out_shut(picture, world, blocks)
    return Moment(
        time_s=picture.time_s,
        tracks={name: _track(track, ground, threats, shut=shut) for name, track in tracks.items()},
        covered={name: cover.covered for name, cover in picture.gates.items()},
        up={name: name in picture.assets and picture.assets[name].available for name in agents},
        orders=tuple(orders),
    )


def distinct(moments: Iterable[Moment]) -> tuple[Moment, ...]:
    """Return `moments` without those that differ from their predecessor only in time."""

    def kept() -> Iterator[Moment]:
        last: Moment | None = None
        for now in moments:
            if last is None or now != last.model_copy(update={"time_s": now.time_s}):
                last = now
                yield now

    return tuple(kept())


def ways_out_shut(picture: Picture, world: World, ordered: Collection[str | None] = ()) -> bool:
    """Return True if more than MOST_BLOCKED gates, or all gates, are blocked, whatever the orders.

    To protect people inside, a gate that `ordered` names counts as blocked before the asset
    arrives.
    """
    gates = frozenset(world.gates)
    assets = picture.assets.values()
    standing = {asset.at for asset in assets if asset.task == "blocking"}
    blocked = gates.intersection((*standing, *ordered))
    return bool(blocked) and (len(blocked) > MOST_BLOCKED or blocked == gates)


class Pursuit(NamedTuple):
    """The gate to which assets were last sent after a track, and how often it has changed."""

    gate: str
    changes: int
    stamp_s: float


class Pursuits:
    """The gates to which assets were sent in pursuit of each track of a session (ROE-14).

    An asset on its way to a track's gate counts as pursuing the track. An asset on its way to an
    uncovered gate does not: it goes there to cover the gate.
    """

    def __init__(self, past: Mapping[str, Pursuit] | None = None) -> None:
        """Begin with the pursuits in `past`, by track; without them, begin with none."""
        self._pursuits = dict(past or {})

    def copy(self) -> "Pursuits":
        """Return an independent copy."""
        return Pursuits(self._pursuits)

    def look(self, now: Moment) -> Moment:
        """Update from the next moment; return it with `followed` set for pursued tracks."""
        going = {
            order.target
            for order in now.orders
            if COMMANDS[order.verb].moves and not order.done and now.covered.get(order.target or "")
        }
        met = {name: track for name, track in now.tracks.items() if track.gate in going}
        if not met:
            return now
        for name, track in met.items():
            last = self._pursuits.pop(name, None)
            if last is None or now.time_s - last.stamp_s > PURSUIT_S:
                last = Pursuit(track.gate, 0, now.time_s)
            changes = last.changes + (last.gate != track.gate)
            self._pursuits[name] = Pursuit(track.gate, changes, now.time_s)
        self._forget(now.time_s)
        followed = {
            name: track.model_copy(update={"followed": self._pursuits[name].changes})
            for name, track in met.items()
        }
        return now.model_copy(update={"tracks": {**now.tracks, **followed}})

    def _forget(self, time_s: float) -> None:
        """Drop pursuits that are too old; the latest ones come last."""
        while self._pursuits:
            name = next(iter(self._pursuits))
            if time_s - self._pursuits[name].stamp_s <= PURSUIT_S:
                return
            del self._pursuits[name]


def _track(
    track: Track, ground: Sequence[_OrderedAsset], threats: Iterable[tuple[str, str]], *, shut: bool
) -> TrackMoment:
    near = [sent for sent in ground if _drives_too_near(sent, track)]
    return TrackMoment(
        gate=track.gate,
        kind=track.kind,
        identity=track.identity,
        intent=track.intent,
        status=track.status,
        observed=track.observed,
        warned=track.warned,
        defiant=track.defiant,
        noncombatants=track.noncombatants,
        emergency=track.emergency,
        ground_contact=any(_in_contact(sent, track) for sent in ground),
        too_near=bool(near),
        crowded=any(not _addresses(sent, track) for sent in near),
        blocked=any(_blocks(sent, track) for sent in ground),
        block_ordered=any(sent.order.verb == "block" and sent.meets(track) for sent in ground),
        shut_in=shut and track.status == "inside",
        other_threat=any(gate == track.gate and name != track.id for name, gate in threats),
    )


def _hostile(track: Track) -> bool:
    return track.intent == "hostile" and track.status != "leaving"


def _in_contact(sent: _OrderedAsset, track: Track) -> bool:
    """Return True if a ground asset that was sent to the track has it in sensor range.

    An asset at the target of its `move_to` was there before or has arrived. If a track comes to it,
    the asset has not approached the track (WF-02).
    """
    order, asset = sent.order, sent.asset
    under_way = order.verb == "move_to" and not order.done and asset.at != order.target
    if not asset.available or not (under_way or order.verb in ATTENDING):
        return False
    reach = sent.world.platforms[asset.kind].sensor_range_m
    return sent.meets(track) and math.dist(asset.position, track.position) <= reach


def _drives_too_near(sent: _OrderedAsset, track: Track) -> bool:
    """Return whether a ground asset drives nearer to the track within the standoff (ROE-04).

    A gap does not count if measurement noise alone explains it, or if only the track has closed it.
    """
    asset = sent.asset
    moves = COMMANDS[sent.order.verb].moves and asset.speed_mps >= STANDS_MPS
    if not moves or not asset.available:
        return False
    east, north = (track.position[i] - asset.position[i] for i in (0, 1))
    doubt_m = SURE_SIGMAS * track.uncertainty_m
    if math.hypot(east, north) + doubt_m >= sent.world.standoff_m:
        return False
    heading = math.radians(asset.heading_deg)
    return math.cos(heading) * east + math.sin(heading) * north > 0.0


def _addresses(sent: _OrderedAsset, track: Track) -> bool:
    """Return whether the order is to identify or warn the contact at the track's gate."""
    return sent.order.verb in ADDRESSING and sent.order.target == track.gate


def _blocks(sent: _OrderedAsset, track: Track) -> bool:
    """Return whether a UGV blocks the track's way under this order."""
    order, asset = sent.order, sent.asset
    blocking = order.verb == "block" and asset.task == "blocking" and asset.at == order.target
    return blocking and sent.meets(track)
