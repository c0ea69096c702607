"""Gathers the facts of a run from its film, for success conditions."""

import math
from collections.abc import Sequence
from itertools import pairwise

from pa_console.evaluation.scoring.film import STAYING, AssetTruth, Film, Sample
from pa_console.evaluation.scoring.run_facts import (
    ActionFact,
    AssetFact,
    CoverageFact,
    GateFact,
    RunFacts,
    Snapshot,
    TrackFact,
)
from pa_console.evaluation.scoring.track_facts import track_facts
from pa_console.schema.mission import MissionStatus

MOVED_M = 2.0
"""An asset that an order has displaced this far has moved."""


def gather(film: Film, status: MissionStatus) -> RunFacts:
    """Return what `film` shows, with the mission's own `status`; broken rules are left empty."""
    world = film.world
    moved = first_moves(film)
    start = Film(world, film.command, film.samples[:1])
    tracks = track_facts(film, moved)
    return RunFacts(
        command=film.command,
        status=status,
        refused=all(order.verb in STAYING for order in film.orders),
        duration_s=film.final.time_s,
        grace_s=world.coverage_grace_s,
        standoff_m=world.standoff_m,
        gates=world.gates,
        base=world.base,
        actions=tuple(
            ActionFact(
                agent=order.agent,
                kind=world.assets[order.agent].kind if order.agent in world.assets else None,
                verb=order.verb,
                frame=order.frame,
                sent_s=order.sent_s,
                done=order.done,
                rejected=order.rejected,
            )
            for order in film.orders
        ),
        reports=tuple(dict.fromkeys(o.agent for o in film.orders if o.verb == "report" and o.done)),
        start=_snapshot(film.start, track_facts(start, {})),
        final=_snapshot(film.final, tracks),
        coverage={gate: _coverage(film, gate) for gate in world.gates},
        moved=tuple(moved),
        visited={name: _visited(film, name) for name in world.assets},
        tracks=tracks,
    )


def first_moves(film: Film) -> dict[str, float]:
    """Return the assets that an order moved by MOVED_M, and when that order was sent, seconds.

    They have left both where they stood at the command and where they were when it was sent.
    """
    moves: dict[str, float] = {}
    for order, _, asset in film.sent_out():
        if asset.id in moves:
            continue
        places = (film.start, film.at(order.sent_s))
        if all(math.dist(s.assets[asset.id].position, asset.position) > MOVED_M for s in places):
            moves[asset.id] = order.sent_s
    return moves


def _snapshot(sample: Sample, tracks: Sequence[TrackFact]) -> Snapshot:
    """Return `sample` as facts, with those of `tracks` that are there then."""
    return Snapshot(
        assets={name: _asset(asset) for name, asset in sample.assets.items()},
        gates={gate: GateFact(covered=bool(by), by=by) for gate, by in sample.cover.items()},
        tracks=tuple(track for track in tracks if track.present),
    )


def _asset(asset: AssetTruth) -> AssetFact:
    return AssetFact(
        kind=asset.kind,
        at=asset.at,
        post=asset.post,
        task=asset.task,
        status=asset.status,
        available=asset.available,
        battery_pct=asset.battery_pct,
        x=asset.position[0],
        y=asset.position[1],
    )


def _coverage(film: Film, gate: str) -> CoverageFact:
    """Return how `gate` was covered; a gap that began before the command counts from it on."""
    longest = gap = total = 0.0
    for was, now in film.steps():
        step = now.time_s - was.time_s
        gap = 0.0 if now.cover[gate] else gap + step
        total += 0.0 if now.cover[gate] else step
        longest = max(longest, gap)
    return CoverageFact(
        at_start=bool(film.start.cover[gate]),
        at_end=bool(film.final.cover[gate]),
        longest_gap_s=round(longest, 3),
        uncovered_s=round(total, 3),
    )


def _visited(film: Film, name: str) -> tuple[str, ...]:
    """Return the frames that were `name`'s own while it was there; flying over one is no visit."""
    places = [_place(sample, name) for sample in film.samples]
    return tuple(now for was, now in pairwise(places) if now and now != was)


def _place(sample: Sample, name: str) -> str:
    asset = sample.assets[name]
    return asset.at if asset.at == asset.post else ""
