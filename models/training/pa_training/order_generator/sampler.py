"""Draws orders that fit a situation, in all their kinds: plain, compound, conditional, wrong."""

import random
from dataclasses import replace

from pa_console.language.canonical.order import Ask, Task, Wrong
from pa_console.schema.telemetry import Digest, Picture
from pa_console.schema.world import World
from pa_training.order_generator.asks import FORBIDDEN, IMPOSSIBLE, draw_ask, draw_wrong
from pa_training.order_generator.order_view import View, draw_condition
from pa_training.order_generator.orders import Order, are_twins, is_so

TASKS: dict[Task, float] = {
    "go": 16, "look": 8, "identify": 7, "warn": 4, "block": 5, "respond": 10, "cover": 8,
    "relieve": 8, "swap": 5, "home": 8, "stand_down": 6, "mass": 5, "report": 10, "hold": 6,
}  # fmt: skip
"""How often each task is asked for, of all plain asks."""
SHARE_FORBIDDEN, SHARE_IMPOSSIBLE = 0.12, 0.10
SHARE_CONDITIONAL, SHARE_COMPOUND = 0.2, 0.15
SHARE_STAY, SHARE_INJECTED, SHARE_HARMLESS = 0.10, 0.06, 0.08
"""Shares of all orders; `others_stay` only comes on top of those that are plain and move."""
SHARE_EXCLUDED, SHARE_SECOND_EXCLUDED = 0.2, 0.25
"""Shares of the orders that leave open who goes: some rule somebody out, or two."""
_HARMLESS: tuple[Task, ...] = ("go", "look", "identify", "hold", "home", "report")
_ABOUT_TRACKS: tuple[Task, ...] = ("respond", "identify", "warn", "block")
_OPEN: tuple[Task, ...] = (
    "go", "look", "identify", "warn", "block", "cover", "relieve", "home", "mass", "respond"
)  # fmt: skip
"""The tasks for which it may be left open who does them."""
_FEWEST_ABLE = 2
_TWINS = 0.5
_BESIDE: dict[Task, Task] = {"go": "home", "home": "go"}
"""What is asked for beside a task more often than chance has it: one out, another one back. Where
it is rare, a planner takes the one who comes back for somebody who is relieved."""
_MORE_BESIDE = 4.0
_REST = 1.0 - SHARE_FORBIDDEN - SHARE_IMPOSSIBLE - SHARE_HARMLESS
"""Of all orders, those that are neither wrong nor sound so."""
_TRIES = 60


def sample_order(
    rng: random.Random, world: World, picture: Picture, digest: Digest
) -> tuple[Order, str]:
    """Return an order for the situation and what kind it is, e.g. `go/kind` or `wrong/zone`.

    Equal states of `rng` give equal orders.
    """
    for _ in range(_TRIES):
        view = View(rng, world, picture, digest)
        drawn = _draw(view)
        if drawn is not None:
            return drawn
    return Order(asks=(Ask(task="report"),)), "report/anyone"


def with_exclusion(
    rng: random.Random, order: Order, world: World, picture: Picture, digest: Digest
) -> Order:
    """Return `order`, in a share of those that leave open who goes, with assets that it rules out.

    They are of those who might be sent for it, and somebody else is left.
    """
    view = View(rng, world, picture, digest)
    asks = (*order.asks, *order.otherwise)
    if any(ask.wrong for ask in asks) or not view.chance(SHARE_EXCLUDED):
        return order
    view.named = {name for ask in asks for name in (*ask.who.names, ask.leaving)}
    if order.condition is not None:
        view.named.add(order.condition.subject)
    kinds = [ask.who.kind for ask in asks if not ask.who.names and ask.task in _OPEN]
    able = [n for n in view.up if None in kinds or world.assets[n].kind in kinds]
    free = [name for name in able if name in view.free()]
    if len(able) < _FEWEST_ABLE:
        return order
    first = rng.choice(free if len(free) > 1 and view.chance(0.7) else able)
    others = [name for name in able if name != first]
    more = len(others) > 1 and view.chance(SHARE_SECOND_EXCLUDED)
    return replace(order, excluded=(first, rng.choice(others)) if more else (first,))


def _draw(view: View) -> tuple[Order, str] | None:
    """Return an order, None when the situation has nothing for what was to be drawn."""
    share = view.rng.random()
    asks: tuple[Ask, ...] = ()
    if share < SHARE_FORBIDDEN + SHARE_IMPOSSIBLE:
        wrong: Wrong = view.rng.choice(FORBIDDEN if share < SHARE_FORBIDDEN else IMPOSSIBLE)
        ask = draw_wrong(wrong, view)
        if ask is None:
            return None
        asks, kind = (ask,), f"wrong/{wrong}"
        if view.chance(0.18) and (other := _plain(view)) is not None:
            asks = (other, ask) if view.chance(0.5) else (ask, other)
            kind = f"partly/{wrong}"
        return _dressed(view, Order(asks=asks), kind, wrong=True)
    harmless = view.chance(SHARE_HARMLESS / (_REST + SHARE_HARMLESS))
    first = draw_ask(view.rng.choice(_HARMLESS), view) if harmless else _plain(view)
    if first is None or (harmless and _unsaid(first)):
        return None
    kind = f"{first.task}/{_how(first)}"
    asks = (first,)
    if not harmless and view.chance(SHARE_COMPOUND / _REST):
        asks = _compound(view, first)
        kind = f"compound/{len(asks)}" if len(asks) > 1 else kind
    order = Order(asks=asks, harmless=harmless)
    if not harmless and view.chance(SHARE_CONDITIONAL / _REST):
        conditional = _conditional(view, asks)
        if conditional is not None:
            order, so = conditional
            kind = f"if-{'so' if so else 'not'}/{first.task}"
    return _dressed(view, order, f"harmless/{first.task}" if harmless else kind, wrong=False)


def _dressed(view: View, order: Order, kind: str, *, wrong: bool) -> tuple[Order, str]:
    """Return `order` with what may come on top of any order."""
    update: dict[str, bool] = {}
    calm = all(ask.task in ("hold", "report") for ask in order.asks)
    if not wrong and not calm and order.condition is None and view.chance(SHARE_STAY / 0.6):
        update["others_stay"] = True
    if not order.harmless and view.chance(SHARE_INJECTED):
        update["injected"] = True
    return replace(order, **update), kind


def _plain(view: View, beside: Task | None = None) -> Ask | None:
    """Return an ask that fits the situation, and the task that it stands `beside` in an order."""
    weights: dict[Task, float] = {
        task: weight * _urgency(task, view) for task, weight in TASKS.items()
    }
    if beside in _BESIDE:
        weights[_BESIDE[beside]] *= _MORE_BESIDE
    return draw_ask(view.weighted(weights), view)


def _urgency(task: Task, view: View) -> float:
    """Return how much more likely the task is asked for as things are."""
    if task in ("respond", "identify", "warn", "block") and view.tracks:
        return 2.2
    if task == "cover" and (view.digest.uncovered or view.down):
        return 2.5
    return 2.0 if task in ("relieve", "home") and view.low else 1.0


def _compound(view: View, first: Ask) -> tuple[Ask, ...]:
    """Return the ask with one or two others about somebody and somewhere else."""
    asks = [first, *_twin(view, first)]
    wanted = 3 if view.chance(0.25) else 2
    for _ in range(8):
        if len(asks) >= wanted:
            break
        before = set(view.named)
        other = _plain(view, first.task)
        if other is not None and all(_apart(ask, other) for ask in asks):
            asks.append(other)
        else:
            view.named = before
    return tuple(asks)


def _twin(view: View, ask: Ask) -> tuple[Ask, ...]:
    """Return the same ask for another gate now and then, if one clause can say both."""
    tracks = [t.gate for t in view.tracks if ask.track in ("", t.kind) and t.gate != ask.place]
    others = tracks if ask.task in _ABOUT_TRACKS and tracks else list(view.world.gates)
    twin = replace(ask, place=view.rng.choice(others))
    fits = ask.task in (*_ABOUT_TRACKS, "look", "report") and are_twins(ask, twin)
    return (twin,) if fits and view.chance(_TWINS) else ()


def _apart(first: Ask, second: Ask) -> bool:
    """Whether two asks can stand side by side in one order."""
    sweeping: tuple[Task, ...] = ("mass", "hold")
    general = [a for a in (first, second) if a.task in sweeping and not a.who.names]
    alike = first.task == second.task and first.place == second.place
    all_of_them = any(ask.who.count == "all" and not ask.who.names for ask in (first, second))
    same_gate = bool(first.place) and first.place == second.place
    return not general and not alike and not all_of_them and not same_gate


def _conditional(view: View, asks: tuple[Ask, ...]) -> tuple[Order, bool] | None:
    """Return the asks under a condition, and whether that is true now."""
    condition = draw_condition(view, asks[0])
    if condition is None:
        return None
    otherwise: tuple[Ask, ...] = ()
    if view.chance(0.5):
        other = _plain(view)
        otherwise = (other,) if other is not None else ()
    so = is_so(condition, view.picture)
    return Order(asks=asks, condition=condition, otherwise=otherwise), so


def _unsaid(ask: Ask) -> bool:
    """Whether an ask names nobody, which wording that only sounds forbidden cannot say."""
    open_to_all = not ask.who.names and ask.who.kind is None
    return open_to_all and ask.task not in ("look", "identify")


def _how(ask: Ask) -> str:
    if ask.who.names:
        return "named"
    return "kind" if ask.who.kind is not None else "all" if ask.who.count == "all" else "anyone"
