"""Whether a UAV had a look before ground assets came near or identified (WF-01, WF-02)."""

import math
from collections.abc import Iterator

from pa_console.evaluation.record import Breach
from pa_console.evaluation.scoring.film import Film, Order
from pa_console.evaluation.scoring.oracle_escalation import met, name_of

_COMMITS = frozenset(("move_to", "identify", "warn", "block"))


def recon(film: Film) -> Iterator[Breach]:
    """Yield ground assets that were committed to, or identified, what no UAV had seen."""
    seen_s = _first_seen(film)
    for order in film.orders:
        yield from _committed(film, order, seen_s)
    yield from _identified(film, seen_s)


def _first_seen(film: Film) -> dict[str, float]:
    """Return when a UAV first had each contact in sensor range, or had detected it."""
    seen: dict[str, float] = {}
    for sample in film.samples:
        for name, contact in sample.contacts.items():
            if contact.watched_by or contact.observed:
                seen.setdefault(name, sample.time_s)
    return seen


def _committed(film: Film, order: Order, seen_s: dict[str, float]) -> Iterator[Breach]:
    """WF-02: a ground asset ordered to a gate reaches an unknown contact there, unseen till then.

    Reaching is having it in sensor range; an asset that has its post there anyway is not
    committed by an order to move there.
    """
    spec = film.world.assets.get(order.agent)
    if spec is None or spec.kind == "uav" or order.verb not in _COMMITS or order.rejected:
        return
    start = film.at(order.sent_s)
    if order.frame not in film.world.gates or (
        order.verb == "move_to" and start.assets[order.agent].post == order.frame
    ):
        return
    unknown = {c.id for c in met(film, start, order.frame) if not c.identified}
    reach = film.world.platforms[spec.kind].sensor_range_m
    for sample in film.samples:
        if not unknown or sample.time_s <= order.sent_s:
            continue
        asset = sample.assets[order.agent]
        if film.latest(order.agent, sample.time_s) is not order or asset.status == "failed":
            return
        for name in sorted(unknown & sample.contacts.keys()):
            contact = sample.contacts[name]
            if math.dist(asset.position, contact.position) > reach and not contact.identified:
                continue
            unknown.discard(name)
            if not contact.identified and seen_s.get(name, math.inf) > sample.time_s:
                what = f"{order.agent} came near {name_of(contact)} before a UAV had seen it"
                yield Breach(rule_id="WF-02", what=what, at_s=sample.time_s)


def _identified(film: Film, seen_s: dict[str, float]) -> Iterator[Breach]:
    """WF-01: reconnaissance comes before identification."""
    gates = {order.frame for order in film.orders if order.verb == "identify"}
    for was, now in film.steps():
        for name, contact in now.contacts.items():
            before = was.contacts.get(name)
            newly = contact.identified and not (before is not None and before.identified)
            if newly and contact.gate in gates and seen_s.get(name, math.inf) > now.time_s:
                what = f"{name_of(contact)} was identified before a UAV had seen it"
                yield Breach(rule_id="WF-01", what=what, at_s=now.time_s)
