"""What truly was done about each vehicle and person in a run: seen, identified, warned, blocked."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from pa_console.evaluation.scoring.film import Film, Order, Sample
from pa_console.evaluation.scoring.run_facts import NEVER, TrackFact
from pa_console.sim.true_contacts import TrueContact

_ENCOUNTERS = frozenset(("identify", "warn", "block"))


@dataclass(slots=True)
class _Story:
    """What has happened to one contact so far; `last` is how it was when it was there last."""

    last: TrueContact
    track: str = ""
    observed_s: float = NEVER
    identified_s: float = NEVER
    warned_s: float = NEVER
    blocked_s: float = NEVER
    contact_s: float = NEVER
    closest_m: float = NEVER
    by_order_observed: bool = False
    by_order_identified: bool = False


def track_facts(film: Film, moved: Mapping[str, float]) -> tuple[TrackFact, ...]:
    """Return every contact that was there at some time of `film`, in the order of appearance.

    `moved` tells who was moved by an order, and when that was sent, seconds.
    """
    stories: dict[str, _Story] = {}
    ordered = [name for name in film.start.assets if any(o.agent == name for o in film.orders)]
    for sample in film.samples:
        if not sample.contacts:
            continue
        orders = {name: film.latest(name, sample.time_s) for name in ordered}
        out = {name for name, since_s in moved.items() if since_s <= sample.time_s}
        for name, contact in sample.contacts.items():
            story = stories.setdefault(name, _Story(contact))
            story.last, story.track = contact, story.track or contact.track
            _tell(film, sample.time_s, story)
            for agent, order in orders.items():
                if order is not None:
                    _meet(sample, story, order)
                    if order.verb in _ENCOUNTERS or (agent in out and order.verb != "hold"):
                        _approach(film, sample, story, agent)
    return tuple(
        TrackFact(
            id=story.track or name,
            gate=story.last.gate,
            kind=story.last.kind,
            identity=story.last.identity,
            intent=story.last.intent,
            noncombatants=story.last.noncombatants,
            status=story.last.status,
            present=name in film.final.contacts,
            observed_s=story.observed_s,
            identified_s=story.identified_s,
            warned_s=story.warned_s,
            blocked_s=story.blocked_s,
            contact_s=story.contact_s,
            closest_ground_m=round(story.closest_m, 3),
            by_order_observed=story.by_order_observed,
            by_order_identified=story.by_order_identified,
        )
        for name, story in stories.items()
    )


def _tell(film: Film, time_s: float, story: _Story) -> None:
    """Take in what one sample shows of the contact itself."""
    contact = story.last
    if contact.watched_by or contact.observed:
        story.observed_s = _first(story.observed_s, time_s)
    if contact.identified and story.identified_s == NEVER:
        story.identified_s = time_s
        story.by_order_identified = any(
            order.verb == "identify" and order.frame == contact.gate and order.sent_s <= time_s
            for order in film.orders
        )
    if contact.warned:
        story.warned_s = _first(story.warned_s, time_s)


def _meet(sample: Sample, story: _Story, order: Order) -> None:
    """Take in what the asset that `order` binds does at the contact's gate."""
    contact, asset = story.last, sample.assets[order.agent]
    if order.frame != contact.gate:
        return
    if order.verb == "observe" and asset.id in contact.watched_by:
        story.by_order_observed = True
    stands = asset.task == "blocking" and asset.at == contact.gate and asset.status != "failed"
    if order.verb == "block" and stands and contact.status != "leaving":
        story.blocked_s = _first(story.blocked_s, sample.time_s)


def _approach(film: Film, sample: Sample, story: _Story, agent: str) -> None:
    """Take in how near an asset that is out by order is to the contact, if it is on the ground."""
    asset = sample.assets[agent]
    if asset.kind == "uav":
        return
    gap_m = math.dist(asset.position, story.last.position)
    story.closest_m = gap_m if story.closest_m == NEVER else min(story.closest_m, gap_m)
    if gap_m <= film.world.platforms[asset.kind].sensor_range_m:
        story.contact_s = _first(story.contact_s, sample.time_s)


def _first(known_s: float, now_s: float) -> float:
    return now_s if known_s == NEVER else known_s
