"""The reading of an order that is still being typed, in one line: never an approval."""

from collections.abc import Iterator

from pa_console.language.canonical.reading import listed, place_words, plain_reading
from pa_console.schema.command import COMMANDS
from pa_console.schema.events.event import ApprovalRequested
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.text import count
from pa_console.session.mission_trace import MissionTrace
from pa_console.views.event_words import trigger_in_words

NOT_UNDERSTOOD = "not understood: "
MOST_STEPS = 4
"""The number of first steps that are shown; of the others, only the number is."""


def reading_line(trace: MissionTrace, base: str) -> str:
    """Return the reading of a draft, or its missing part.

    *Drone_T04 to East Gate; gates stay covered*. Doubts come before consequences. The line is empty
    if the draft came to nothing that can be said. `base` is the base of the world.
    """
    request = trace.approval
    if trace.status == "refused":
        return f"would be refused: {trace.reason}"
    if request is None:
        return ""
    if request.state == "not_understood":
        told = "; ".join(request.blocked_by).removeprefix(NOT_UNDERSTOOD)
        return f"not clear yet: {told}"
    if trace.standing is not None:
        order = trace.standing.order
        return f"reads as: {trigger_in_words(order)}: {order.order_in_words}"
    return f"reads as: {'; '.join(_parts(trace, request, base))}"


def _parts(trace: MissionTrace, request: ApprovalRequested, base: str) -> Iterator[str]:
    """Yield what moves, then what is doubtful or blocked, then what becomes of the gates."""
    attempt = trace.find(request.attempt)
    yield plan_in_words(request.plan, base)
    if request.readings:
        yield f"or: {plain_reading(request.readings[0])}"
    if attempt is None:
        return
    yield from attempt.gaps
    yield from (f"not done: {unmet}" for unmet in attempt.unmet)
    yield from (f"blocked: {reason}" for reason in request.blocked_by)
    if attempt.rehearsal is not None and not request.blocked_by:
        yield from _gates(attempt.rehearsal)


def plan_in_words(plan: Plan, base: str) -> str:
    """Return the orders of a plan, equal ones together: *Drone_T01 and Drone_T02 to Base*.

    Of one in steps, the first steps one after the other.
    """
    if len(plan.steps) > 1:
        shown = [plan_in_words(plan.part(step), base) for step in plan.steps[:MOST_STEPS]]
        left = len(plan.steps) - len(shown)
        return ", then ".join([*shown, *([count(left, "more step")] if left else [])])
    agents: dict[str, list[str]] = {}
    for action in plan.actions:
        spec, place = COMMANDS[action.verb], action.target or ""
        if action.verb == "hold":
            does = "stays"
        elif not spec.moves:
            does = spec.plainly
        else:
            goes = f"to {place_words(place or base)}"
            does = f"{goes}, {spec.plainly}" if spec.plainly else goes
        agents.setdefault(does, []).append(action.agent)
    return ", ".join(f"{listed(names)} {does}" for does, names in agents.items()) or "nobody moves"


def _gates(rehearsal: Rehearsal) -> Iterator[str]:
    """Yield the gates that lose their guards, or gain some; that all stay covered, if they do."""
    lines = rehearsal.timeline.gates
    bare = [place_words(gate) for gate, line in lines.items() if not line.covered_after]
    for gate, line in lines.items():
        if line.covered_before and line.covered_after and line.longest_gap_s > 0.0:
            yield f"{place_words(gate)} without a guard for {line.longest_gap_s:.0f} s"
        elif line.covered_after and not line.covered_before:
            yield f"{place_words(gate)} gets a guard"
    if bare:
        yield f"{listed(bare)} without a guard"
    elif all(line.covered_before and not line.longest_gap_s for line in lines.values()):
        yield "gates stay covered"
