"""How an order can be served: who does what, and what fills the gaps that this leaves.

Solutions come in the order of preference; the checks and the rehearsal have not seen them.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import islice

from pa_console.training import teacher_encounters as encounters
from pa_console.training import teacher_moves as moves
from pa_console.training import teacher_still as still
from pa_console.training.order import Ask, Order, Task
from pa_console.training.teacher_backfill import bare_gates, fillings, relays, unseen_places
from pa_console.training.teacher_draft import Desk, Draft, goals, refusal
from pa_console.training.teacher_objections import objection
from pa_console.training.teacher_plan import Solution
from pa_console.training.teacher_roster import Roster

Barred = Mapping[int, tuple[str, str]]
"""The asks that are refused, by place in the order, each with why and under which rule."""

MOST_PLANS = 8
_TASKS: Mapping[Task, Callable[[Ask, Desk, Roster], list[Draft]]] = {
    "go": moves.go,
    "look": moves.look,
    "identify": encounters.identify,
    "warn": encounters.warn,
    "block": encounters.block,
    "respond": encounters.respond,
    "cover": moves.cover,
    "relieve": moves.relieve,
    "swap": moves.swap,
    "home": moves.home,
    "stand_down": moves.stand_down,
    "mass": moves.mass,
    "report": still.report,
    "hold": still.hold,
}


def solved(
    order: Order, asks: Sequence[Ask], roster: Roster, barred: Barred
) -> tuple[list[Solution], Barred]:
    """Return solutions of one aim that refuse the `barred` asks, and which others need more."""
    first: Solution | None = None
    alike: list[Solution] = []
    needs: Barred = {}
    for drafts in islice(_served(asks, Desk(reserved=_reserved(asks)), roster, barred), MOST_PLANS):
        culprits = _culprits(order, drafts, roster)
        found = list(islice(_filled(order, drafts, roster), MOST_PLANS))
        if not found and first is None and not needs:
            needs = culprits
        for solution in found:
            first = first or solution
            if _meaning(solution) == _meaning(first):
                alike.append(solution)
                needs = needs or culprits
    return alike, needs


def _meaning(solution: Solution) -> list[tuple[Ask, bool]]:
    """Return what a solution serves of an order: equal for those that have the same aim."""
    return [(draft.ask, draft.done) for draft in solution.drafts]


def _served(
    asks: Sequence[Ask], desk: Desk, roster: Roster, barred: Barred
) -> Iterator[tuple[Draft, ...]]:
    """Yield drafts for all asks, in their order; who serves one is taken for those after it.

    Those who report because nobody is named are whoever has nothing else to do.
    """
    turns = sorted(enumerate(asks), key=lambda turn: _waits(turn[1]))
    for drafts in _in_turn(turns, desk, roster, barred):
        yield tuple(drafts[number] for number in range(len(asks)))


def _waits(ask: Ask) -> bool:
    return ask.task == "report" and not ask.who.names


def _in_turn(
    asks: Sequence[tuple[int, Ask]],
    desk: Desk,
    roster: Roster,
    barred: Barred,
) -> Iterator[dict[int, Draft]]:
    """Yield drafts for the numbered `asks`, by number: who serves one is taken for the next."""
    if not asks:
        yield {}
        return
    number, ask = asks[0]
    problem = barred.get(number) or objection(ask, roster)
    options = [refusal(ask, *problem)] if problem else _TASKS[ask.task](ask, desk, roster)
    for option in options:
        used = desk.used | {*option.agents}
        for rest in _in_turn(asks[1:], Desk(used, desk.reserved), roster, barred):
            yield {number: option, **rest}


def _filled(order: Order, drafts: tuple[Draft, ...], roster: Roster) -> Iterator[Solution]:
    """Yield `drafts` with what they need besides; nothing when that may or can not be had."""
    reserved = _reserved([draft.ask for draft in drafts])
    if not _culprits(order, drafts, roster, alone=True):
        for filled in fillings(drafts, roster, reserved):
            yield Solution(drafts, filled)
        if not order.others_stay and not bare_gates(drafts, roster):
            for filled in relays(drafts, roster, reserved):
                yield Solution(drafts, filled)


def _culprits(
    order: Order, drafts: Sequence[Draft], roster: Roster, *, alone: bool = False
) -> dict[int, tuple[str, str]]:
    """Return by place the asks that need somebody besides, with why they would be refused.

    With `alone`, only those of which the words say that nobody else may help.
    """
    found: dict[int, tuple[str, str]] = {}
    bare, unseen = set(bare_gates(drafts, roster)), set(unseen_places(drafts, roster))
    left = _left(goals([c for draft in drafts for c in draft.commands], roster.world), roster)
    for number, draft in enumerate(drafts):
        if alone and not (order.others_stay or draft.ask.strict_who):
            continue
        ends = goals(draft.commands, roster.world)
        own = [(gate, name) for gate in left for name in left[gate] if ends.get(name, gate) != gate]
        own = [(gate, name) for gate, name in own if gate in bare or not alone]
        if own:
            gate, name = own[0]
            state = "alone" if len(left[gate]) == 1 else "needed"
            found[number] = f"{name} {state} at {gate}", "WF-03"
        elif unseen & {*ends.values()}:
            found[number] = "no drone looks first", "WF-02"
    return found


def _left(ends: Mapping[str, str], roster: Roster) -> dict[str, tuple[str, ...]]:
    """Return the gates of which every guard is sent elsewhere, each with its guards."""
    return {
        gate: cover.by
        for gate, cover in roster.picture.gates.items()
        if cover.covered and all(ends.get(name, gate) != gate for name in cover.by)
    }


def _reserved(asks: Sequence[Ask]) -> frozenset[str]:
    """Return everybody whom the asks name."""
    return frozenset(name for ask in asks for name in (*ask.who.names, ask.leaving) if name)
