"""Turns pictures into moments: what ordering rules see of a mission, and nothing more."""

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import NamedTuple

from pa_console.schema.command import ATTENDING, COMMANDS
from pa_console.schema.rehearsal import Moment, OrderMoment, TrackMoment
from pa_console.schema.telemetry import AssetTelemetry, Picture, Track
from pa_console.schema.world import World

STANDS_MPS = 0.05
"""Slower than this, an asset does not move."""

SURE_SIGMAS = 3.0
"""A gap counts as too small when the position error would have to be larger than this."""


class _OrderedAsset(NamedTuple):
    """A ground asset with its order; `gates` are the world's."""

    order: OrderMoment
    asset: AssetTelemetry
    gates: frozenset[str]
    world: World

    def meets(self, track: Track) -> bool:
        """Return whether the order leads to the track: to its gate, or anywhere inside."""
        if self.order.target in self.gates:
            return self.order.target == track.gate
        return self.order.target is not None and track.status == "inside"


def moment(
    picture: Picture, world: World, orders: Sequence[OrderMoment], agents: Collection[str] = ()
) -> Moment:
    """Return what ordering rules see of `picture` while `orders` are carried out.

    Of the assets only those with an order are looked at, and `agents`, the plan's, for `up`. A
    stale track keeps what is known of it.
    """
    gates = frozenset(world.gates)
    ground = [
        _OrderedAsset(order, asset, gates, world)
        for order in orders
        if order.kind != "uav" and (asset := picture.assets.get(order.agent)) is not None
    ]
    threats = [(name, track.gate) for name, track in picture.tracks.items() if _hostile(track)]
    return Moment(
        time_s=picture.time_s,
        tracks={name: _track(track, ground, threats) for name, track in picture.tracks.items()},
        covered={name: cover.covered for name, cover in picture.gates.items()},
        up={name: name in picture.assets and picture.assets[name].available for name in agents},
        orders=tuple(orders),
    )


def distinct(moments: Iterable[Moment]) -> tuple[Moment, ...]:
    """Return `moments` without those that differ from the one before by the time alone."""

    def kept() -> Iterator[Moment]:
        last: Moment | None = None
        for now in moments:
            if last is None or now != last.model_copy(update={"time_s": now.time_s}):
                last = now
                yield now

    return tuple(kept())


def _track(
    track: Track, ground: Sequence[_OrderedAsset], threats: Iterable[tuple[str, str]]
) -> TrackMoment:
    return TrackMoment(
        gate=track.gate,
        identity=track.identity,
        intent=track.intent,
        status=track.status,
        observed=track.observed,
        warned=track.warned,
        defiant=track.defiant,
        noncombatants=track.noncombatants,
        ground_contact=any(_in_contact(sent, track) for sent in ground),
        too_near=any(_drives_too_near(sent, track) for sent in ground),
        blocked=any(_blocks(sent, track) for sent in ground),
        other_threat=any(gate == track.gate and name != track.id for name, gate in threats),
    )


def _hostile(track: Track) -> bool:
    return track.intent == "hostile" and track.status != "leaving"


def _in_contact(sent: _OrderedAsset, track: Track) -> bool:
    """Return whether a ground asset that was sent to the track has it within its sensor range.

    One that stands where it was told to move has been there before, or has arrived: a track that
    comes to it is no commitment of ours (WF-02).
    """
    order, asset = sent.order, sent.asset
    under_way = order.verb == "move_to" and not order.done and asset.at != order.target
    if not asset.available or not (under_way or order.verb in ATTENDING):
        return False
    reach = sent.world.platforms[asset.kind].sensor_range_m
    return sent.meets(track) and math.dist(asset.position, track.position) <= reach


def _drives_too_near(sent: _OrderedAsset, track: Track) -> bool:
    """Return whether a ground asset moves nearer to the track within the standoff (ROE-04).

    A gap that measurement noise alone explains is not counted, nor one that the track closed.
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


def _blocks(sent: _OrderedAsset, track: Track) -> bool:
    """Return whether a UGV blocks the track's way on this order."""
    order, asset = sent.order, sent.asset
    blocking = order.verb == "block" and asset.task == "blocking" and asset.at == order.target
    return blocking and sent.meets(track)
