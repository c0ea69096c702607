"""The plan that a question is about: the one that waits, else the last one of a mission."""

from collections.abc import Sequence

from pa_console.language.reading import asked_words, read_asked
from pa_console.schema.plan import Action
from pa_console.schema.world import AssetKind, World
from pa_console.session.state.mission_trace import Attempt, MissionTrace, chosen_attempt, rounds


def attempt_of(trace: MissionTrace) -> Attempt | None:
    """Return the attempt that waits, was decided on, or else came last; None before any plan."""
    chosen = chosen_attempt(trace, rounds(trace)[-1])
    if chosen is not None and chosen.plan is not None:
        return chosen
    return next((each for each in reversed(trace.attempts) if each.plan is not None), None)


def asked_of(trace: MissionTrace, attempt: Attempt) -> str:
    """Return the reading that an attempt serves, in canonical words; '' if there is none."""
    request = trace.approval
    if request is not None and request.attempt == attempt.number and request.asked:
        return request.asked
    return asked_words(attempt.plan.reason).rstrip("; ") if attempt.plan is not None else ""


def actions_of(attempt: Attempt | None) -> Sequence[Action]:
    """Return the actions of an attempt's plan; none without one."""
    return attempt.plan.actions if attempt is not None and attempt.plan is not None else ()


def kind_asked_for(asked: str, action: Action, world: World) -> AssetKind | None:
    """Return the kind of assets that was asked for where `action` leads; None for any."""
    reading = read_asked(asked) if asked else None
    kind = world.assets[action.agent].kind
    for ask in reading.asks if reading is not None else ():
        if ask.who.kind == kind and ask.place in ("", action.target or ""):
            return kind
    return None
