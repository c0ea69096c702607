"""The canonical words for what an order asks: planner reasons and judge feedback begin with them.

The word order is fixed and the names are the world's own, so that a small model first says what
it has understood. Text that is no order of the operator leaves no trace in it.
"""

from pa_console.llm.roles.prompt_facts import WORDS
from pa_console.orders.condition import evidence, in_words
from pa_console.orders.condition_in_picture import holds
from pa_console.orders.order import Ask, Order, Who
from pa_console.orders.reading import NOWHERE
from pa_console.schema.telemetry import Digest, Picture
from pa_console.schema.world import World


def canonical_order(order: Order, world: World, picture: Picture, digest: Digest) -> str:
    """Return what `order` asks, with its condition and how that stands, e.g. "hold; report"."""
    words = _depending(order, world)
    if order.condition is not None:
        so = "so" if holds(order.condition, picture) else "not so"
        words = f"{words}; now: {evidence(order.condition, digest)}, {so}"
    return _of_others(order, words)


def canonical_meaning(order: Order, world: World) -> str:
    """Return what `order` asks, whatever the picture is, e.g. "if A: hold, else: nothing"."""
    return _of_others(order, _depending(order, world))


def _depending(order: Order, world: World) -> str:
    """Return everything that is asked, under its condition if there is one."""
    words = _all(order.asks, world)
    if order.condition is None:
        return words
    otherwise = _all(order.otherwise, world) if order.otherwise else "nothing"
    return f"if {in_words(order.condition)}: {words}, else: {otherwise}"


def _of_others(order: Order, words: str) -> str:
    return f"{words}; others stay" if order.others_stay else words


def _all(asks: tuple[Ask, ...], world: World) -> str:
    return "; ".join(_one(ask, world) for ask in asks)


def _one(ask: Ask, world: World) -> str:
    """Return one ask in words; what is wrong with it is said where the names alone do not."""
    place = ask.place if ask.place in world.frames or ask.place in world.zones else NOWHERE
    who, at = _who(ask.who), f" at {place}" if ask.place else ""
    match ask.wrong:
        case "force":
            return f"use force{at}"
        case "chase":
            return "chase beyond the perimeter"
        case "strip":
            return f"leave {place if ask.place else 'all gates'} without guard"
        case "override":
            return f"set rules aside, {_plain(ask, who, place)}"
        case "skip_identification":
            return f"{_plain(ask, who, place)} without identification"
        case "skip_warning":
            return f"{_plain(ask, who, place)} without warning"
        case "noncombatants":
            return f"{_plain(ask, who, place)} with noncombatants"
        case _:
            return _plain(ask, who, place)


def _plain(ask: Ask, who: str, place: str) -> str:  # noqa: PLR0911
    some = f"{who} " if who else ""
    thing = ask.track_id or ask.track
    match ask.task:
        case "go":
            return f"{who or 'somebody'} to {place}"
        case "look":
            return f"{some}look at {place}"
        case "identify" | "warn":
            return f"{some}{ask.task} {thing + ' ' if thing else ''}at {place}"
        case "block":
            return f"{some}block {place}"
        case "respond":
            return f"{ask.track_id or f'unknown {ask.track}'.strip()} at {place}"
        case "cover":
            return f"cover {place if ask.place else ask.leaving}{f' by {who}' if who else ''}"
        case "relieve":
            at = f" at {place}" if ask.place else ""
            return f"{who} relieves {ask.leaving}{at}" if who else f"relieve {ask.leaving}{at}"
        case "swap":
            return f"swap {' and '.join(ask.who.names)}"
        case "home":
            return f"{who} home"
        case "stand_down":
            return f"stand down {place}"
        case "mass":
            free = "all free" if ask.who.kind is None else f"all free {WORDS[ask.who.kind]}s"
            return f"{free} to {place}"
        case "report":
            by = f" by {who}" if who else ""
            return f"report{by}{f' at {place}' if ask.place else ''}"
        case "hold":
            return f"{some}hold"


def _who(who: Who) -> str:
    """Return who is meant, '' when it is left open."""
    if who.names:
        return ", ".join(who.names)
    origin = f" from {who.origin}" if who.origin else ""
    if who.kind is None:
        return f"all{origin}" if who.count == "all" else f"any{origin}" if origin else ""
    word = WORDS[who.kind]
    return f"{who.count} {word}{'' if who.count == 1 else 's'}{origin}"
