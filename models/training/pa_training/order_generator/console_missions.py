"""The missions that the console gives itself: alarms that ask for a response, workflow phases."""

from collections.abc import Iterator
from functools import cache

from pa_console.language.canonical.order import KIND_FOR, Ask, Task, Who
from pa_console.policy.moments import moment
from pa_console.policy.orderings import WorkflowRun
from pa_console.policy.rulebook import Rulebook, load_rules
from pa_console.resources import find_data
from pa_console.schema.command import Verb
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_console.station.alarms import Cause, causes
from pa_training.order_generator.orders import Order

ConsoleMission = tuple[str, Order, tuple[Verb, ...]]
"""The words, what they mean, and the only commands that may answer them; none means any."""

_PHASE: dict[Verb, Task] = {
    "observe": "look", "identify": "identify", "warn": "warn", "block": "block",
}  # fmt: skip


def console_missions(
    world: World, picture: Picture, rulebook: Rulebook | None = None
) -> list[ConsoleMission]:
    """Return the missions that `picture` would make the console begin by itself.

    Words come from the alarms and the rule file's workflows, by default the installed rules. A
    gate without cover has two alarms: of a console that has seen its guard fail, and of one that
    has not.
    """
    seen = {gate: cover.by for gate, cover in picture.gates.items() if cover.covered}
    known = {gate: seen.get(gate) or _lost(picture, gate) for gate in picture.gates}
    found: dict[str, ConsoleMission] = {}
    for guards in (known, seen):
        for cause in causes(picture, world, guards):
            order = _answer(cause, guards) if cause.command else None
            if order is not None:
                found.setdefault(cause.command, (cause.command, order, ()))
    return [*found.values(), *_phases(world, picture, rulebook or _installed())]


def _lost(picture: Picture, gate: str) -> tuple[str, ...]:
    """Return who has covered the gate and cannot be counted on any more."""
    return tuple(a.id for a in picture.assets.values() if a.post == gate and not a.available)


def _answer(cause: Cause, guards: dict[str, tuple[str, ...]]) -> Order | None:
    """Return what the alarm's words ask for."""
    gate, subject = cause.gate or "", cause.subject
    match cause.kind:
        case "hostile_track" | "unknown_track":
            task: Task = "respond"
        case "defiant_track":
            task = "look"
        case "unauthorized_track":
            task = "warn"
        case "coverage_lost" | "coverage_unknown":
            lost = guards.get(gate, ())
            return Order(asks=(Ask(task="cover", place=gate, leaving=lost[0] if lost else ""),))
        case "low_battery":
            if guards.get(gate) == (subject,):
                return Order(asks=(Ask(task="cover", place=gate, leaving=subject),))
            return Order(asks=(Ask(task="home", who=Who(names=(subject,))),))
        case _:
            return None
    return Order(asks=(Ask(task=task, place=gate),))


def _phases(world: World, picture: Picture, rulebook: Rulebook) -> Iterator[ConsoleMission]:
    """Yield the phase that is due of every track's workflow."""
    now = moment(picture, world, ())
    for track in picture.tracks:
        run = WorkflowRun.start(rulebook, now, track)
        if run is None:
            continue
        run.advance(now)
        phase = run.current
        task = _PHASE.get(phase.verbs[0]) if phase is not None and phase.verbs else None
        if phase is None or task is None:
            continue
        named = track if track in run.command() else ""
        ask = Ask(task=task, who=Who(kind=KIND_FOR[task]), place=run.gate, track_id=named)
        yield run.command(), Order(asks=(ask,)), phase.verbs


@cache
def _installed() -> Rulebook:
    return load_rules(find_data("rules", "checkpoint", "rules.yaml"))
