"""Draws what an order depends on, so that its truth is read from the picture and not guessed."""

from collections.abc import Iterator

from pa_console.llm.condition import Condition, Fact
from pa_console.orchestrator.digest import KINDS
from pa_console.training.conditions import holds
from pa_console.training.order import Ask
from pa_console.training.order_view import View

FACTS: dict[Fact, float] = {
    "track_at": 4, "no_track_at": 2, "authorized": 1, "unauthorized": 1, "hostile": 1,
    "uncovered": 2, "covered": 2, "low": 2, "not_low": 2, "down": 2, "up": 2,
    "free": 2, "none_free": 1,
}  # fmt: skip
"""How often an order depends on each fact, of all orders under a condition."""
ONE_SIDED = 0.008
"""How often a fact is taken of which the situation knows one answer only."""
_OWN = 0.6
_TRIES = 12


def draw_condition(view: View, ask: Ask) -> Condition | None:
    """Return something that is so as often as not, about what `ask` is about or something else.

    An asset is seldom low and a gate seldom bare: drawn as they come, the fact alone would tell a
    model the answer. None when the situation has too little to ask about.
    """
    for _ in range(_TRIES):
        fact = view.weighted(FACTS)
        every = list(_conditions(fact, view))
        so = [condition for condition in every if holds(condition, view.picture)]
        sides = [side for side in (so, [c for c in every if c not in so]) if side]
        if len(sides) == 2 or (sides and view.chance(ONE_SIDED)):
            side = view.rng.choice(sides)
            own = [condition for condition in side if _is_about(condition, ask)]
            return view.rng.choice(own if own and view.chance(_OWN) else side)
    return None


def _conditions(fact: Fact, view: View) -> Iterator[Condition]:
    """Yield every condition with `fact` that can be asked in the situation."""
    match fact:
        case "track_at" | "no_track_at":
            for gate in view.world.gates:
                yield Condition(fact=fact, subject=gate)
                yield Condition(fact=fact, subject=gate, track="vehicle")
                yield Condition(fact=fact, subject=gate, track="person")
        case "authorized" | "unauthorized" | "hostile":
            for gate in view.world.gates:
                there = [track for track in view.tracks if track.gate == gate]
                for track in there:
                    yield Condition(fact=fact, subject=gate, track=track.kind)
                if not there:
                    yield Condition(fact=fact, subject=gate, track="vehicle")
        case "uncovered" | "covered":
            for gate in view.world.gates:
                yield Condition(fact=fact, subject=gate)
        case "low" | "not_low" | "down" | "up":
            for name in view.picture.assets:
                yield Condition(fact=fact, subject=name)
        case "free" | "none_free":
            for team in (*KINDS, None):
                yield Condition(fact=fact, kind=team)


def _is_about(condition: Condition, ask: Ask) -> bool:
    """Whether a condition is about the place, an asset or the kind of which `ask` speaks."""
    if condition.kind is not None:
        return condition.kind == ask.who.kind
    return condition.subject in (ask.place, ask.leaving, *ask.who.names)
