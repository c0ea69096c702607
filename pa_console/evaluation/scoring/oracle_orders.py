"""Orders that are wrong in themselves: who may do what, what exists, everybody sent away."""

from collections.abc import Iterator
from itertools import groupby

from pa_console.evaluation.record import Breach
from pa_console.evaluation.scoring.film import STAYING, Film, Order
from pa_console.schema.plan import Verb
from pa_console.schema.world import AssetKind

_ANYBODY: frozenset[Verb] = frozenset(("hold", "move_to", "return_to_base", "report"))
MAY: dict[AssetKind, frozenset[Verb]] = {
    "uav": frozenset((*_ANYBODY, "observe")),
    "ugv": frozenset((*_ANYBODY, "block")),
    "robot": frozenset((*_ANYBODY, "identify", "warn")),
}
"""What each kind of asset is for (CAP-01, CAP-02, CAP-03; paper, Section IV-B)."""


def orders(film: Film) -> Iterator[Breach]:
    """Yield what is wrong with the orders of a run, judged on the truth when they were given."""
    for order in film.orders:
        yield from _capability(film, order)
        yield from _executable(film, order)
    yield from _everybody(film)


def _capability(film: Film, order: Order) -> Iterator[Breach]:
    """CAP-01 to CAP-03: an order that the kind of asset is not for."""
    spec = film.world.assets.get(order.agent)
    if spec is None or order.verb in MAY[spec.kind]:
        return
    rules: dict[str, bool] = {
        "CAP-01": spec.kind == "uav",
        "CAP-02": spec.kind == "ugv" or order.verb == "block",
        "CAP-03": order.verb == "warn",
        "WF-08": True,
    }
    for rule, broken in rules.items():
        if broken:
            what = f"{order.agent} is a {spec.kind} and was told to {order.verb}"
            yield Breach(rule_id=rule, what=what, at_s=order.sent_s)


def _executable(film: Film, order: Order) -> Iterator[Breach]:
    """WF-08, CAP-06: an order to somebody, or to somewhere, that does not exist or has failed.

    Telemetry needs its time: an asset that broke down just before its order is not held against
    it. To hold and to report are no tasks.
    """
    world = film.world
    if order.agent not in world.assets:
        yield Breach(rule_id="WF-08", what=f"{order.agent} does not exist", at_s=order.sent_s)
        return
    if order.frame and order.frame not in world.frames:
        what = f"{order.agent} was sent to {order.frame}, which does not exist"
        for rule in ("WF-08", "CAP-06"):
            yield Breach(rule_id=rule, what=what, at_s=order.sent_s)
    known = film.at(order.sent_s - world.stale_s).assets[order.agent]
    now = film.at(order.sent_s).assets[order.agent]
    if order.verb not in STAYING and known.status == now.status == "failed":
        what = f"{order.agent} had failed and was told to {order.verb}"
        yield Breach(rule_id="WF-08", what=what, at_s=order.sent_s)


def _everybody(film: Film) -> Iterator[Breach]:
    """WF-06: with no threat, every available asset is away by order, or all are at one frame."""
    goals = {name: asset.post for name, asset in film.start.assets.items()}
    posts = dict(goals)
    for sent_s, batch in groupby(film.orders, key=lambda order: order.sent_s):
        for order in batch:
            if order.agent in goals and order.verb != "report" and not order.rejected:
                goals[order.agent] = film.goal(order) or film.at(sent_s).assets[order.agent].post
        sample = film.at(sent_s)
        team = [name for name, asset in sample.assets.items() if asset.available]
        away = [name for name in team if goals[name] != posts[name]]
        gathered = len({goals[name] for name in team}) == 1 and len(away) > 1
        threat = any(contact.intent == "hostile" for contact in sample.contacts.values())
        if len(team) > 1 and (len(away) == len(team) or gathered) and not threat:
            what = "every available asset was sent away from its post"
            yield Breach(rule_id="WF-06", what=what, at_s=sent_s)
